"""A trivial scan of 1000 points, each point on disk before the next, beside the field's own tools.

    python3.11 -m venv out/peers
    out/peers/bin/pip install --require-hashes -r benchmarks/peers.lock
    PYTHONPATH=. out/peers/bin/python benchmarks/scan_peers.py [DIRECTORY]

A motor that is nowhere and a detector that returns a number at once: what is measured is the bookkeeping. Every tool
puts each point into the operating system's hands before it takes the next, so that `kill -9` loses none; where a
tool's default is laxer, the default is shown beside it. rigctl's store (WAL, synchronous NORMAL; FULL at the run's
end) also survives a power cut up to its last finished run. Peers that cannot be imported are named. Exit status 1
when rigctl takes fewer than 5000 points/s.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import logging
import math
import statistics
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from machine import machine

from rigctl.campaign.recording import Header
from rigctl.campaign.store import Store

POINTS = 1000
REPEATS = 5
TARGET_PER_S = 5000.0
SETPOINTS = np.linspace(0.0, 1.0, POINTS)


def detect(x: float) -> float:
    return math.exp(-((x - 0.5) ** 2) / 0.02)


def rigctl_store(directory: Path) -> float:
    """One run, each point appended and committed."""
    with Store.create(directory / "scan.rig.sqlite", Header("sensing-axis")) as store:
        start = time.perf_counter()
        with store.begin_run("scan", "scan", {}) as writer:
            for x in SETPOINTS:
                writer.append({"x": np.array([x]), "y": np.array([detect(x)])})
            writer.finish()
        return time.perf_counter() - start


def bluesky_engine(directory: Path, *, sink: bool) -> float:
    """RunEngine with a scan plan; the sink writes and flushes every document as a line of JSON."""
    import json

    from bluesky import RunEngine
    from bluesky.plans import scan
    from ophyd.sim import SynAxis, SynGauss

    motor = SynAxis(name="motor")
    detector = SynGauss("det", motor, "motor", center=0.5, Imax=1.0, sigma=0.1)
    engine = RunEngine({})
    with (directory / "documents.jsonl").open("w") as file:

        def write(name: str, document: dict[str, object]) -> None:
            file.write(json.dumps([name, document], default=str) + "\n")
            file.flush()

        if sink:
            engine.subscribe(write)
        start = time.perf_counter()
        engine(scan([detector], motor, 0.0, 1.0, POINTS))
        return time.perf_counter() - start


def qcodes_dataset(directory: Path, *, every_point: bool) -> float:
    """A Measurement into QCoDeS' SQLite database; by default it writes every five seconds."""
    import qcodes
    from qcodes.dataset import Measurement, initialise_or_create_database_at, load_or_create_experiment

    initialise_or_create_database_at(directory / "qcodes.db")
    experiment = load_or_create_experiment("scan", "none")
    x, y = qcodes.ManualParameter("x"), qcodes.ManualParameter("y")
    measurement = Measurement(exp=experiment)
    measurement.register_parameter(x)
    measurement.register_parameter(y, setpoints=(x,))
    start = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()), measurement.run() as saver:
        for value in SETPOINTS:
            saver.add_result((x, value), (y, detect(value)))
            if every_point:
                saver.flush_data_to_database()
    return time.perf_counter() - start


def pymeasure_csv(directory: Path) -> float:
    """A Procedure run by a Worker that records into a CSV file, flushed record by record."""
    from pymeasure.experiment import Procedure, Results, Worker

    class Scan(Procedure):
        DATA_COLUMNS = ["x", "y"]

        def execute(self) -> None:
            for value in SETPOINTS:
                self.emit("results", {"x": value, "y": detect(value)})

    results = Results(Scan(), str(directory / "scan.csv"))
    worker = Worker(results)
    start = time.perf_counter()
    worker.start()
    worker.join(timeout=120)
    return time.perf_counter() - start


CONTENDERS: dict[str, tuple[str, Callable[[Path], float]]] = {
    "rigctl store, each point committed": ("rigctl", rigctl_store),
    "bluesky RunEngine, documents on disk": ("bluesky", lambda d: bluesky_engine(d, sink=True)),
    "bluesky RunEngine, no sink": ("bluesky", lambda d: bluesky_engine(d, sink=False)),
    "QCoDeS dataset, each point committed": ("qcodes", lambda d: qcodes_dataset(d, every_point=True)),
    "QCoDeS dataset, default (5 s)": ("qcodes", lambda d: qcodes_dataset(d, every_point=False)),
    "PyMeasure CSV, each point flushed": ("pymeasure", pymeasure_csv),
}


def rate(contender: Callable[[Path], float], base: Path | None) -> list[float]:
    """Points per second of each repeat, in a fresh directory."""
    rates = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory(dir=base) as directory:
            rates.append(POINTS / contender(Path(directory)))
    return rates


def main() -> int:
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    base = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    print(machine())
    print(f"{POINTS} points a run, median of {REPEATS} runs (slowest to fastest)")
    ours = 0.0
    for name, (package, contender) in CONTENDERS.items():
        if importlib.util.find_spec(package) is None:
            print(f"  {name:<38} {package} is not installed here")
            continue
        rates = rate(contender, base)
        median = statistics.median(rates)
        ours = ours or median
        spread = f"{min(rates):8.0f} .. {max(rates):.0f}"
        print(f"  {name:<38} {median:8.0f} points/s  ({spread})  rigctl is {ours / median:.2f} times as fast")
    if ours < TARGET_PER_S:
        print(f"MISSED: {TARGET_PER_S:.0f} points/s")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
