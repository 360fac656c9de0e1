"""What the campaign store costs beside plain SQLite: a whole run, its checksums, and a thousand one-row appends.

    python benchmarks/store_overhead.py [DIRECTORY]

Both files lie on the same disk (DIRECTORY, by default the current one), in WAL mode. A run's bytes are made durable
on both sides (`synchronous = FULL`), the rows are committed one by one (NORMAL), ours and plain in turn. Exit status
1 when a target is missed.
"""

from __future__ import annotations

import random
import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.machine import conditions
from benchmarks.paired import Pairs, pairs, timed_s
from rigctl.campaign.recording import Header
from rigctl.campaign.store import checked_rows, ledger, synced
from rigctl.campaign.store.checksums import ColumnSums
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray

ROWS, COLUMNS = 2000, ("t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm")
RUNS = 200
CHECKED_RUNS = 1000
CHUNKS = 4
APPENDS = 1000
SCANS = 11
MAX_RUN_RATIO = 3.0
MAX_CHECKED_RATIO = 1.05
MIN_APPENDS_PER_S = 5000.0
CONDITIONS = {"axis": "X", "configuration": "pendulum", "mounting": 1, "theta_deg": 0.25, "frequency_hz": 0.5}


def plain_sqlite(path: Path, synchronous: str = "FULL") -> sqlite3.Connection:
    """A WAL-mode file with a table of blobs."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    connection.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, data BLOB)")
    return connection


SAMPLES = dict(zip(COLUMNS, np.random.default_rng(1).normal(size=(len(COLUMNS), ROWS)), strict=True))
DATA = b"".join(column.tobytes() for column in SAMPLES.values())
PARTS = [
    dict(zip(SAMPLES, parts, strict=True))
    for parts in zip(*(np.array_split(column, CHUNKS) for column in SAMPLES.values()), strict=True)
]


def record(store: Store, key: str) -> None:
    """A run in chunks."""
    with store.begin_run(key, "benchmark", CONDITIONS) as writer:
        for part in PARTS:
            writer.append(part)
        writer.finish({"temperature_c": 22.0})


def whole_runs(plain: sqlite3.Connection, store: Store) -> Pairs:
    """A run against an insert of its bytes."""
    insert = "INSERT INTO runs (data) VALUES (?)"
    return pairs(lambda: plain.execute(insert, (DATA,)), lambda number: record(store, f"run {number}"), RUNS)


CHECKSUMS = ((ColumnSums, "add"), (checked_rows, "row_sum"))
VANISHED_ROWS = ((ledger, "enter"), (synced.Note, "write"))
"""What shows that a whole row is gone."""


@contextmanager
def without(parts: Iterable[tuple[object, str]]) -> Iterator[None]:
    """These functions do nothing."""
    with ExitStack() as patches:
        for owner, name in parts:
            patches.enter_context(patch.object(owner, name, lambda *_, **__: 0))
        yield


def checked_runs(store: Store) -> tuple[Pairs, Pairs]:
    """A run without checksums, ledger and note; with checksums; with all three: the second and third by the first."""
    levels = ((*CHECKSUMS, *VANISHED_ROWS), VANISHED_ROWS, ())
    durations_s: list[list[float]] = [[], [], []]
    dice = random.Random(2)
    for number in range(CHECKED_RUNS):
        for level, left_out in enumerate(levels):
            with without(left_out):
                duration_s = timed_s(lambda: record(store, f"checked {number} {level}"), dice)  # noqa: B023
            durations_s[level].append(duration_s)
    bare_s, checksums_s, all_s = durations_s
    return Pairs(bare_s, checksums_s), Pairs(bare_s, all_s)


def appends_per_s(store: Store, number: int, rows: FloatArray) -> float:
    """Rows a second into a run of the store, each committed."""
    with store.begin_run(f"rows {number}", "benchmark", CONDITIONS) as writer:
        start = time.perf_counter()
        for row in rows:
            writer.append({name: row[i : i + 1] for i, name in enumerate(COLUMNS)})
        took_s = time.perf_counter() - start
        writer.finish()
    return len(rows) / took_s


def inserts_per_s(plain: sqlite3.Connection, rows: FloatArray) -> float:
    """Rows a second into plain SQLite, each committed."""
    start = time.perf_counter()
    for row in rows:
        plain.execute("INSERT INTO runs (data) VALUES (?)", (row.tobytes(),))
    return len(rows) / (time.perf_counter() - start)


def main() -> int:
    parent = Path(sys.argv[1]) if len(sys.argv) > 1 else Path.cwd()
    rows = np.random.default_rng(2).normal(size=(APPENDS, len(COLUMNS)))
    with (
        tempfile.TemporaryDirectory(dir=parent) as name,
        closing(plain_sqlite(Path(name) / "plain.sqlite")) as durable,
        closing(plain_sqlite(Path(name) / "rows.sqlite", "NORMAL")) as plain,
        Store.create(Path(name) / "campaign.rig.sqlite", Header("sensing-axis")) as store,
    ):
        runs = whole_runs(durable, store)
        checksums, checked = checked_runs(store)
        rates = [(inserts_per_s(plain, rows), appends_per_s(store, i, rows)) for i in range(SCANS)]
    plain_rate, rate = (statistics.median(column) for column in zip(*rates, strict=True))
    slowest, fastest = min(ours for _, ours in rates), max(ours for _, ours in rates)
    print(conditions())
    print(f"  {'':44} {'plain':>10} {'store':>10} {'ratio':>7}")
    print(runs.line(f"run of {ROWS} x {len(COLUMNS)} in {CHUNKS} chunks, durable", MAX_RUN_RATIO))
    print(checksums.line("the same, without checksums and with", MAX_CHECKED_RATIO))
    print(checked.line("the same, and with the ledger and the note", None))
    print(
        f"  {'one-row appends, each committed':<44} {plain_rate:8.0f}/s {rate:8.0f}/s  {plain_rate / rate:6.2f}"
        f"  ({slowest:.0f} .. {fastest:.0f}/s)  >= {MIN_APPENDS_PER_S:.0f}/s"
        f"{'' if rate >= MIN_APPENDS_PER_S else '  MISSED'}"
    )
    return (
        0 if runs.ratio <= MAX_RUN_RATIO and checksums.ratio <= MAX_CHECKED_RATIO and rate >= MIN_APPENDS_PER_S else 1
    )


if __name__ == "__main__":
    sys.exit(main())
