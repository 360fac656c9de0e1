"""A trivial scan of 1000 points, each point on disk before the next, beside the field's own tools.

    python3.11 -m venv out/peers
    out/peers/bin/python -m pip install --require-hashes -r benchmarks/peers.lock
    PYTHONPATH=. out/peers/bin/python benchmarks/scan_peers.py [DIRECTORY]

A motor that is there at once and a detector that returns a number: what is measured is the bookkeeping. Every tool is
used as its documentation says for such a scan, and takes its turn in every round. What each keeps is measured too: it
scans once more in a process of its own, which is killed (SIGKILL) when the detector is asked for point 501, and the
points on disk are counted. Tools that are not installed are named. Exit status 1 when rigctl takes fewer than 5000
points/s, or keeps fewer than the 500.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import logging
import math
import os
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import conditions
from rigctl.campaign.recording import Header
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.clock import RealClock

POINTS = 1000
ROUNDS = 7
KILLED_AT = 501
TARGET_PER_S = 5000.0
SETPOINTS = [float(x) for x in np.linspace(0.0, 1.0, POINTS)]

Detect = Callable[[float], float]


def detect(x: float) -> float:
    """What the detector shows where the motor is."""
    return math.exp(-((x - 0.5) ** 2) / 0.02)


def rigctl_scan(directory: Path, detect: Detect) -> float:
    """A run of a session; every point is appended, and so committed, before the next."""
    with Store.create(directory / "scan.rig.sqlite", Header("sensing-axis")) as store:
        session = Session(store, RealClock(), Operator(None), Control(lambda: None), Progress(store))

        def measure(writer: RunWriter) -> dict[str, Any]:
            for x in SETPOINTS:
                session.checkpoint()
                writer.append({"x": np.array([x]), "y": np.array([detect(x)])})
            return {}

        start = time.perf_counter()
        session.acquire("scan", {"points": POINTS}, measure)
        return time.perf_counter() - start


def rigctl_points(directory: Path) -> int:
    with Store.open(directory / "scan.rig.sqlite", readonly=True) as store:
        (run,) = store.runs() + store.interrupted_runs()
        return len(store.samples(run.run_id)["y"])


class Done:
    """The status of what is done at once, as bluesky's protocols have it."""

    done = success = True

    def add_callback(self, callback: Callable[[Done], None]) -> None:
        callback(self)

    def exception(self, timeout: float | None = 0.0) -> None:  # noqa: ARG002 - the protocol's
        return None


class Device:
    """The least that a RunEngine takes as motor and detector in one: quicker than the devices of ophyd.sim."""

    parent = None

    def __init__(self, name: str, value: Callable[[], float]) -> None:
        self.name = name
        self.position = 0.0
        self._value = value
        self._found = 0.0

    def set(self, value: float) -> Done:
        self.position = value
        return Done()

    def trigger(self) -> Done:
        self._found = self._value()
        return Done()

    def read(self) -> dict[str, Any]:
        return {self.name: {"value": self._found, "timestamp": time.time()}}

    def describe(self) -> dict[str, Any]:
        return {self.name: {"source": "none", "dtype": "number", "shape": []}}

    def read_configuration(self) -> dict[str, Any]:
        return {}

    def describe_configuration(self) -> dict[str, Any]:
        return {}


def bluesky_scan(directory: Path, detect: Detect, *, sink: bool) -> float:
    """The scan plan in a RunEngine; bluesky's own writer appends each document to a file and closes it."""
    from bluesky import RunEngine
    from bluesky.callbacks.json_writer import JSONLinesWriter
    from bluesky.plans import scan

    motor = Device("x", lambda: motor.position)
    detector = Device("y", lambda: detect(motor.position))
    engine = RunEngine({})
    if sink:
        engine.subscribe(JSONLinesWriter(str(directory), "documents.jsonl"))
    start = time.perf_counter()
    engine(scan([detector], motor, SETPOINTS[0], SETPOINTS[-1], POINTS))
    return time.perf_counter() - start


def bluesky_points(directory: Path) -> int:
    file = directory / "documents.jsonl"
    names = [json.loads(line)["name"] for line in file.read_text().splitlines()] if file.exists() else []
    return names.count("event")


def qcodes_scan(directory: Path, detect: Detect, *, every_point: bool, normal: bool = False) -> float:
    """A Measurement into QCoDeS' database; by default it is written to every five seconds, in SQLite's FULL."""
    import qcodes
    from qcodes.dataset import Measurement, initialise_or_create_database_at, load_or_create_experiment

    with contextlib.redirect_stdout(io.StringIO()):
        initialise_or_create_database_at(directory / "qcodes.db")
        measurement = Measurement(exp=load_or_create_experiment("scan", "none"))
        x, y = qcodes.ManualParameter("x"), qcodes.ManualParameter("y")
        measurement.register_parameter(x)
        measurement.register_parameter(y, setpoints=(x,))
        start = time.perf_counter()
        with measurement.run() as saver:
            if normal:
                saver.dataset.conn.execute("PRAGMA synchronous = NORMAL")
            for value in SETPOINTS:
                saver.add_result((x, value), (y, detect(value)))
                if every_point:
                    saver.flush_data_to_database()
        return time.perf_counter() - start


def qcodes_points(directory: Path) -> int:
    with contextlib.closing(sqlite3.connect(directory / "qcodes.db")) as connection:
        (table,) = connection.execute("SELECT result_table_name FROM runs").fetchone()
        return int(connection.execute(f'SELECT COUNT(*) FROM "{table}" WHERE y IS NOT NULL').fetchone()[0])


def pymeasure_scan(directory: Path, detect: Detect) -> float:
    """A Procedure run by a Worker, whose recorder writes and flushes each point as a line."""
    from pymeasure.experiment import Procedure, Results, Worker

    class Scan(Procedure):  # type: ignore[misc]
        DATA_COLUMNS = ["x", "y"]

        def execute(self) -> None:
            for value in SETPOINTS:
                self.emit("results", {"x": value, "y": detect(value)})

    worker = Worker(Results(Scan(), str(directory / "scan.csv")))
    start = time.perf_counter()
    worker.start()
    worker.join(timeout=600)
    return time.perf_counter() - start


def pymeasure_points(directory: Path) -> int:
    lines = (directory / "scan.csv").read_text().split("\n")[:-1]
    return len([line for line in lines if not line.startswith("#")]) - 1


@dataclass(frozen=True)
class Contender:
    """A way to scan: `scan` returns its seconds, `points` counts what is on disk, None where nothing ever is."""

    name: str
    package: str
    scan: Callable[[Path, Detect], float]
    points: Callable[[Path], int] | None


CONTENDERS = (
    Contender("rigctl, each point committed", "rigctl", rigctl_scan, rigctl_points),
    Contender("bluesky RunEngine, JSON lines", "bluesky", lambda d, f: bluesky_scan(d, f, sink=True), bluesky_points),
    Contender("bluesky RunEngine, no sink", "bluesky", lambda d, f: bluesky_scan(d, f, sink=False), None),
    Contender(
        "QCoDeS dataset, each point", "qcodes", lambda d, f: qcodes_scan(d, f, every_point=True), qcodes_points
    ),
    Contender(
        "QCoDeS dataset, each point, NORMAL",
        "qcodes",
        lambda d, f: qcodes_scan(d, f, every_point=True, normal=True),
        qcodes_points,
    ),
    Contender(
        "QCoDeS dataset, default (5 s)", "qcodes", lambda d, f: qcodes_scan(d, f, every_point=False), qcodes_points
    ),
    Contender("PyMeasure Worker, CSV", "pymeasure", pymeasure_scan, pymeasure_points),
)


def rates_per_s(contenders: list[Contender], base: Path | None) -> dict[str, list[float]]:
    """Points per second by round, after one round that does not count; each scan in a fresh directory."""
    rates: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    for number in range(ROUNDS + 1):
        for contender in contenders:
            with tempfile.TemporaryDirectory(dir=base) as name:
                took_s = contender.scan(Path(name), detect)
                found = POINTS if contender.points is None else contender.points(Path(name))
            if found != POINTS:
                raise ValueError(f"{contender.name}: {found} of {POINTS} points on disk")
            if number:
                rates[contender.name].append(POINTS / took_s)
    return rates


def points_after_kill(contender: Contender, base: Path | None) -> int:
    """Points found on disk of a scan whose process was killed at its `KILLED_AT`th."""
    if contender.points is None:
        return 0
    with tempfile.TemporaryDirectory(dir=base) as name:
        command = [sys.executable, __file__, "--doomed", contender.name, name]
        ended = subprocess.run(command, capture_output=True, check=False)
        if ended.returncode != -signal.SIGKILL:
            raise ValueError(f"{contender.name}: {ended.stderr.decode(errors='replace')[-500:]}")
        return contender.points(Path(name))


def doomed(name: str, directory: Path) -> None:
    """Scan until killed."""
    asked = 0

    def detect_or_die(x: float) -> float:
        nonlocal asked
        asked += 1
        if asked == KILLED_AT:
            os.kill(os.getpid(), signal.SIGKILL)
        return detect(x)

    next(contender for contender in CONTENDERS if contender.name == name).scan(directory, detect_or_die)


def main() -> int:
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    if sys.argv[1:2] == ["--doomed"]:
        doomed(sys.argv[2], Path(sys.argv[3]))
        return 1
    base = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    here = [contender for contender in CONTENDERS if importlib.util.find_spec(contender.package)]
    rates = rates_per_s(here, base)
    kept = {contender.name: points_after_kill(contender, base) for contender in here}
    medians = {name: statistics.median(values) for name, values in rates.items()}
    ours = CONTENDERS[0].name
    print(conditions())
    print(f"{POINTS} points, median of {ROUNDS} scans (slowest .. fastest), and what a kill at {KILLED_AT} leaves")
    for name, values in rates.items():
        print(
            f"  {name:<36} {medians[name]:8.0f} points/s  ({min(values):6.0f} .. {max(values):6.0f})"
            f"  rigctl over it {medians[ours] / medians[name]:7.2f}  {kept[name]:5} of {KILLED_AT - 1}"
        )
    for package in dict.fromkeys(c.package for c in CONTENDERS if c not in here):
        print(f"  {package} is not installed here")
    met = medians[ours] >= TARGET_PER_S and kept[ours] == KILLED_AT - 1
    print(f"  target: {TARGET_PER_S:.0f} points/s and {KILLED_AT - 1} points kept{'' if met else '  MISSED'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
