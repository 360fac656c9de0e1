"""Our overhead per run: from the set-point to a run that is durable in the store, over the in-process transport.

    PYTHONPATH=. python benchmarks/run_overhead.py [DIRECTORY]

The instrument's end is scripted: it takes a set-point and answers at once with a block of doubles prepared beforehand
(2000 samples of 5 columns), so that nothing of a simulator is in the figure. The run goes through session, driver
link, transport and store as any run does, and its progress is kept. Beside it the floor: one committed insert of the
same bytes by plain SQLite on the same disk at the same level (WAL, synchronous FULL). Both are taken in turn, pair by
pair, so that a drifting disk does not tip the ratio. Exit status 1 when the ratio of the medians is over 3.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from machine import machine
from store_overhead import plain_sqlite

from drivers.scpi import ScpiLink
from drivers.transport import InProcessTransport
from rigctl.campaign.control import Control
from rigctl.campaign.operator import SimulatedOperator
from rigctl.campaign.progress import Progress
from rigctl.campaign.recording import Header
from rigctl.campaign.run_writer import RunWriter
from rigctl.campaign.session import Session
from rigctl.campaign.store import Store
from simulators.clock import VirtualClock

SAMPLES, COLUMNS = 2000, ("t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm")
RUNS = 300
TARGET = 3.0


class Scripted:
    """Takes anything, answers queries at once: who it is, no error, or the block."""

    def __init__(self, block: bytes) -> None:
        self._replies = {b"*IDN?\n": b"Maker,Model,1,1\n", b"SYST:ERR?\n": b'+0,"No error"\n', b"R?\n": block}
        self._send: Callable[[bytes], None] = lambda _: None

    def connect(self, send: Callable[[bytes], None]) -> Scripted:
        self._send = send
        return self

    def receive(self, data: bytes) -> None:
        reply = self._replies.get(data)
        if reply is not None:
            self._send(reply)

    def close(self) -> None:
        """Nothing to end."""


def one_run(session: Session, link: ScpiLink, number: int) -> None:
    """Set-point, block, columns, durable."""

    def measure(writer: RunWriter) -> dict[str, float]:
        link.send(f"SOUR:VOLT {1e-3 * number}")
        values = np.frombuffer(link.query_block("R?"), dtype=">f8").reshape(len(COLUMNS), SAMPLES)
        writer.append(dict(zip(COLUMNS, values, strict=True)))
        return {"temperature_c": 20.0}

    session.acquire(f"run {number}", {"frequency_hz": 0.5, "theta_deg": 1e-3 * number}, measure)


def main() -> int:
    data = np.random.default_rng(1).normal(size=(len(COLUMNS), SAMPLES)).astype(">f8").tobytes()
    block = b"#%d%d" % (len(str(len(data))), len(data)) + data + b"\n"
    clock = VirtualClock()
    link = ScpiLink("source", lambda: InProcessTransport("scripted", Scripted(block), clock), 1.0)
    link.open("Maker", "Model")
    base = Path(sys.argv[1]) if len(sys.argv) > 1 else Path.cwd()
    ours, floor = [], []
    with tempfile.TemporaryDirectory(dir=base) as name:
        plain = plain_sqlite(Path(name) / "plain.sqlite")
        with Store.create(Path(name) / "runs.rig.sqlite", Header("sensing-axis")) as store:
            session = Session(store, clock, SimulatedOperator(None), Control(lambda: None), Progress(store))
            for number in range(RUNS):
                start = time.perf_counter()
                plain.execute("INSERT INTO runs (data) VALUES (?)", (data,))
                middle = time.perf_counter()
                one_run(session, link, number)
                ours.append(time.perf_counter() - middle)
                floor.append(middle - start)
        plain.close()
    ratios = sorted(ours[i] / floor[i] for i in range(RUNS))
    ratio = statistics.median(ours) / statistics.median(floor)
    print(machine())
    print(f"{RUNS} runs of {SAMPLES} x {len(COLUMNS)} samples ({len(data) / 1e3:.0f} kB)")
    print(f"  one committed insert, plain SQLite   {1e3 * statistics.median(floor):.2f} ms")
    print(f"  a run, set-point to durable          {1e3 * statistics.median(ours):.2f} ms")
    print(f"  ratio of medians                     {ratio:.2f}  (quartiles {ratios[75]:.2f} .. {ratios[225]:.2f})")
    print(f"  target                               <= {TARGET:g}")
    return 0 if ratio <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
