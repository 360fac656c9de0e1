"""What the campaign store costs beside plain SQLite: a whole run, and a thousand one-row appends.

    python benchmarks/store_overhead.py [DIRECTORY]

Both files lie on the same disk (DIRECTORY, by default the current one), in WAL mode; a run's bytes are made
durable (`synchronous = FULL`) on both sides. Exit status 1 when a target is missed.
"""

from __future__ import annotations

import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rigctl.campaign.recording import Header
from rigctl.campaign.store import Store

ROWS, COLUMNS = 2000, ("t_s", "stage_x_mm", "accel_v", "laser_1_mm", "laser_2_mm")
RUNS = 200
CHUNKS = 4
APPENDS = 1000
MAX_RUN_RATIO = 3.0
MIN_APPENDS_PER_S = 5000.0
CONDITIONS = {"axis": "X", "configuration": "pendulum", "mounting": 1, "theta_deg": 0.25, "frequency_hz": 0.5}


def median_s(action: Callable[[int], None], repeats: int) -> float:
    times = []
    for i in range(repeats):
        start = time.perf_counter()
        action(i)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def plain_sqlite(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, data BLOB)")
    return connection


def one_insert_s(directory: Path, data: bytes) -> float:
    connection = plain_sqlite(directory / "plain.sqlite")
    median = median_s(lambda _: connection.execute("INSERT INTO runs (data) VALUES (?)", (data,)), RUNS)
    connection.close()
    return median


def one_run_s(store: Store, samples: dict[str, np.ndarray]) -> float:
    chunks = [
        dict(zip(samples, parts, strict=True))
        for parts in zip(*(np.array_split(column, CHUNKS) for column in samples.values()), strict=True)
    ]

    def record(i: int) -> None:
        with store.begin_run(f"run {i}", "benchmark", CONDITIONS) as writer:
            for chunk in chunks:
                writer.append(chunk)
            writer.finish({"temperature_c": 22.0})

    return median_s(record, RUNS)


def appends_per_s(store: Store) -> float:
    rows = np.random.default_rng(2).normal(size=(APPENDS, len(COLUMNS)))
    with store.begin_run("rows", "benchmark", CONDITIONS) as writer:
        start = time.perf_counter()
        for row in rows:
            writer.append({name: row[i : i + 1] for i, name in enumerate(COLUMNS)})
        took_s = time.perf_counter() - start
        writer.finish()
    return APPENDS / took_s


def inserts_per_s(directory: Path) -> float:
    connection = plain_sqlite(directory / "rows.sqlite")
    connection.execute("PRAGMA synchronous = NORMAL")
    data = bytes(8 * len(COLUMNS))
    start = time.perf_counter()
    for _ in range(APPENDS):
        connection.execute("INSERT INTO runs (data) VALUES (?)", (data,))
    took_s = time.perf_counter() - start
    connection.close()
    return APPENDS / took_s


def main() -> int:
    rng = np.random.default_rng(1)
    samples = {name: rng.normal(size=ROWS) for name in COLUMNS}
    parent = Path(sys.argv[1]) if len(sys.argv) > 1 else Path.cwd()
    with tempfile.TemporaryDirectory(dir=parent) as name:
        directory = Path(name)
        insert_s = one_insert_s(directory, b"".join(column.tobytes() for column in samples.values()))
        plain_rate = inserts_per_s(directory)
        with Store.create(directory / "campaign.rig.sqlite", Header("sensing-axis")) as store:
            run_s = one_run_s(store, samples)
            rate = appends_per_s(store)
    ratio = run_s / insert_s
    print(f"{'':34}{'plain SQLite':>14}{'store':>12}{'ratio':>8}{'target':>12}")
    print(
        f"{f'run of {ROWS} x {len(COLUMNS)}, durable':34}{insert_s * 1e3:>11.2f} ms{run_s * 1e3:>9.2f} ms"
        f"{ratio:>8.2f}{f'<= {MAX_RUN_RATIO:g}':>12}"
    )
    print(
        f"{'one-row appends, own commit':34}{plain_rate:>12.0f}/s{rate:>10.0f}/s"
        f"{plain_rate / rate:>8.2f}{f'>= {MIN_APPENDS_PER_S:.0f}/s':>12}"
    )
    return 0 if ratio <= MAX_RUN_RATIO and rate >= MIN_APPENDS_PER_S else 1


if __name__ == "__main__":
    sys.exit(main())
