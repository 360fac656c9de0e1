"""Our overhead per run: from the set-point to a run that is durable in the store, over the in-process transport.

    python benchmarks/run_overhead.py [DIRECTORY]

Two runs, each beside its floor: one committed insert of the run's bytes by plain SQLite, in this process, on the same
disk (DIRECTORY, by default the current one) and at the same level (WAL, synchronous FULL).

- One instrument that takes a set-point and answers with its data in one block prepared beforehand: session, driver's
  link, transport and store, nothing else.
- The sensing-axis bench, `Bench.run` in `Session.acquire`, six instruments. Their ends play back what the simulated
  ones answered to the same two set-points before, byte for byte and at the same rig time: nothing of a simulator
  runs, and a driver that said anything else would be found out. What the run stores is compared with what was
  recorded. Its parts are timed apart, in further runs.

The first is the overhead of a run and has the target. The second says what six instruments add: how many exchanges
a run takes is their doing (the Ensemble gives one captured position per question, and takes one question at a
time: a thousand a run), session, bench and store are timed without them too.

Exit status 1 when the first ratio of medians is over 3.
"""

from __future__ import annotations

import math
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import conditions
from benchmarks.paired import Pairs, pairs
from benchmarks.store_overhead import plain_sqlite
from benchmarks.tape import Tape
from benchmarks.twin import CAMPAIGNS
from drivers.scpi import ScpiLink
from drivers.transport import InProcessTransport
from procedures.sensing_axis.bench import Bench, SetPoint
from rigctl.campaign.recording import Header, RunRecord
from rigctl.campaign.session.control import Control
from rigctl.campaign.session.operator import Operator
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.run_writer import RunWriter
from rigctl.campaign.store.store import Store
from rigctl.core.clock import Clock
from rigctl.files.rig_file import RigFile, read_rig
from rigctl.rig import build_simulation, drivers_of
from simulators.clock import VirtualClock
from simulators.rig import LockedInstrument

TARGET = 3.0
BLOCK_COLUMNS = ("t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm", "laser_3_mm")
BLOCK_ROWS = 1000
BLOCK_RUNS = 300
BENCH_RUNS = 100
SETPOINTS = [SetPoint("X", "pendulum", 1, theta_deg, 0.5, 5.0, 10.0, 100.0) for theta_deg in (-0.01, 0.01)]
"""The flight model's runs have 10.7 s at 100 Hz on average."""


class Scripted:
    """Takes anything, answers queries at once: who it is, no error, or the block."""

    def __init__(self, block: bytes) -> None:
        self._replies = {b"*IDN?\n": b"Maker,Model,1,1\n", b"SYST:ERR?\n": b'+0,"No error"\n', b"R?\n": block}
        self._send: Callable[[bytes], None] = lambda _: None

    def connect(self, send: Callable[[bytes], None]) -> Scripted:
        self._send = send
        return self

    def receive(self, data: bytes) -> None:
        if data in self._replies:
            self._send(self._replies[data])

    def close(self) -> None:
        """Nothing to end."""


class Stopwatch:
    """Seconds spent in some calls; those they make of one another count once."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        self._running = False

    def on(self, owner: Any, *names: str) -> None:
        """Time these methods of an object or a class from now on."""
        for name in names:
            setattr(owner, name, self._timed(getattr(owner, name)))

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*values: Any, **named: Any) -> Any:
            if self._running:
                return call(*values, **named)
            self._running, start = True, time.perf_counter()
            try:
                return call(*values, **named)
            finally:
                self.spent_s += time.perf_counter() - start
                self._running = False

        return timed


def session_on(store: Store, clock: Clock) -> Session:
    return Session(store, clock, Operator(None), Control(lambda: None), Progress(store))


def inserts(connection: sqlite3.Connection, data: bytes) -> Callable[[], object]:
    return lambda: connection.execute("INSERT INTO runs (data) VALUES (?)", (data,))


def block_run(plain: sqlite3.Connection, path: Path) -> Pairs:
    """A run that is one set-point and one block."""
    values = np.random.default_rng(1).normal(size=(len(BLOCK_COLUMNS), BLOCK_ROWS))
    data = values.astype(">f8").tobytes()
    block = b"#%d%d" % (len(str(len(data))), len(data)) + data + b"\n"
    clock = VirtualClock()
    link = ScpiLink("source", lambda: InProcessTransport("scripted", Scripted(block), clock), 1.0)
    link.open("Maker", "Model")

    def run(session: Session, number: int) -> None:
        def measure(writer: RunWriter) -> dict[str, float]:
            link.send(f"SOUR:VOLT {1e-3 * number}")
            columns = np.frombuffer(link.query_block("R?"), dtype=">f8").reshape(values.shape)
            writer.stream(dict(zip(BLOCK_COLUMNS, columns, strict=True)))
            return {"temperature_c": 20.0}

        session.acquire(f"run {number}", {"frequency_hz": 0.5, "theta_deg": 1e-3 * number}, measure)

    with Store.create(path, Header("sensing-axis")) as store:
        return pairs(inserts(plain, data), partial(run, session_on(store, clock)), BLOCK_RUNS)


class TapedBench:
    """The shipped rig's bench; after `play` its instruments are tapes of two runs, which follow one another."""

    def __init__(self, store: Store) -> None:
        file = read_rig(CAMPAIGNS / "isa-rig.toml")
        self.clock = VirtualClock()
        self.simulation = build_simulation(file, self.clock)
        self.tapes = {
            name: Tape(LockedInstrument(instrument, self.clock), self.clock)
            for name, instrument in self.simulation.instruments.items()
        }
        self.instruments = {
            name: driver.build(name, driver.settings, partial(self._connect, name), self.clock)
            for name, driver in drivers_of(file).items()
        }
        self._bench = _bench(file, self.instruments, self.clock)
        self._session = session_on(store, self.clock)
        self._runs = 0

    def _connect(self, name: str) -> InProcessTransport:
        return InProcessTransport(name, self.tapes[name], self.clock)

    def play(self) -> dict[str, int]:
        """Tape two runs and play them from now on; returns the exchanges of one run."""
        for instrument in self.instruments.values():
            instrument.open()
        self._bench.prepare()
        self.simulation.request({"remount": {"axis": "X", "configuration": "pendulum", "mounting": 1}})
        self.run_both()
        for tape in self.tapes.values():
            tape.record()
        self.run_both()
        exchanges = {name: tape.play() // len(SETPOINTS) for name, tape in self.tapes.items()}
        while self.clock.next_event_s() < math.inf:  # what the simulated instruments had still in mind
            self.clock.sleep_s(self.clock.next_event_s() - self.clock.now_s())
        return exchanges

    def run_both(self) -> None:
        """One run at each set-point."""
        for _ in SETPOINTS:
            self.run()

    def run(self) -> RunRecord:
        """One run at the next set-point."""
        point = SETPOINTS[self._runs % len(SETPOINTS)]
        self._runs += 1
        return self._bench.run(self._session, f"run {self._runs}", point, before=lambda: None)


def _bench(file: RigFile, instruments: Mapping[str, Any], clock: Clock) -> Bench:
    assert file.package is not None
    return Bench(
        rotation=instruments["rotation"],
        linear=instruments["stage"],
        lasers=(instruments["lasers_a"], instruments["lasers_b"]),
        readout=instruments["accelerometer"],
        thermometer=instruments["thermometer"],
        package=file.package,
        heads=file.heads,
        g_m_s2=file.constant("g_m_s2", 9.80665),
        clock=clock,
    )


def bench_run(plain: sqlite3.Connection, path: Path) -> tuple[Pairs, Pairs, list[str]]:
    """A run of the sensing-axis bench, whole and without its instruments; and where its time goes, line by line."""
    with Store.create(path, Header("sensing-axis")) as store:
        bench = TapedBench(store)
        exchanges = bench.play()
        taped = store.runs()[-1]
        recorded = store.samples(taped.run_id)
        data = b"".join(column.tobytes() for column in recorded.values())
        found = pairs(inserts(plain, data), lambda _: bench.run(), BENCH_RUNS)
        bench.run()  # `pairs` has made an odd number: this is at the taped set-point again
        _require_same(store, taped, store.runs()[-1])
        ours_s, lines = parts(bench, exchanges)
        return found, Pairs(found.floor_s, ours_s), lines


def _require_same(store: Store, taped: RunRecord, played: RunRecord) -> None:
    """`ValueError` unless both hold the same, but for when they were."""
    conditions = ({**run.conditions, "start_s": 0.0} for run in (taped, played))
    columns, others = store.samples(taped.run_id), store.samples(played.run_id)
    if len(set(map(repr, conditions))) > 1 or any((others[name] != columns[name]).any() for name in columns):
        raise ValueError("a run from tape differs from the run that was taped")


def parts(bench: TapedBench, exchanges: Mapping[str, int]) -> tuple[list[float], list[str]]:
    """Seconds of each run outside its instruments; and the mean run's milliseconds, part by part."""
    instruments = {f"{name}, {count} exchanges": Stopwatch() for name, count in exchanges.items()}
    for instrument, watch in zip(bench.instruments.values(), instruments.values(), strict=True):
        watch.on(instrument, *(n for n in dir(instrument) if n[0] != "_" and callable(getattr(instrument, n))))
    store = Stopwatch()
    store.on(Store, "run_by_key", "begin_run")
    store.on(RunWriter, "stream", "finish")
    ours_s = []
    for _ in range(BENCH_RUNS):
        before_s = sum(watch.spent_s for watch in instruments.values())
        start = time.perf_counter()
        bench.run()
        elapsed_s = time.perf_counter() - start
        ours_s.append(elapsed_s - sum(watch.spent_s for watch in instruments.values()) + before_s)
    spent_s = {name: watch.spent_s for name, watch in instruments.items()}
    spent_s |= {"store": store.spent_s, "bench, session": sum(ours_s) - store.spent_s}
    return ours_s, [
        f"    {name:<60} {1e3 * part_s / BENCH_RUNS:7.2f} ms"
        for name, part_s in sorted(spent_s.items(), key=lambda item: -item[1])
    ]


def main() -> int:
    base = Path(sys.argv[1]) if len(sys.argv) > 1 else Path.cwd()
    print(conditions())
    print(f"  {'':44} {'one insert':>10} {'a run':>10} {'ratio':>7}")
    with tempfile.TemporaryDirectory(dir=base) as name, closing(plain_sqlite(Path(name) / "plain.sqlite")) as plain:
        block = block_run(plain, Path(name) / "block.rig.sqlite")
        print(block.line(f"one instrument, {BLOCK_ROWS} x {len(BLOCK_COLUMNS)} samples in a block", TARGET))
        bench, ours, lines = bench_run(plain, Path(name) / "bench.rig.sqlite")
        print(ours.line("sensing-axis bench: session, bench, store", None))
        print(bench.line("the same with its instruments' exchanges", None))
        print("  of which, in the mean")
        print("\n".join(lines))
    return 0 if block.ratio <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
