"""Wall time and memory of the whole flight-model campaign in virtual time, on one core.

    python benchmarks/flight_model.py [--repeats N] [DIRECTORY]

The command a user types, `rigctl run campaigns/isa-flight-model.toml`, from start to printed axes: six configurations
of ten mountings, every byte through drivers and simulated instruments. It is a process of its own, on the one core
that this one keeps to, so that its memory is all its own.

The floor, in the same minute on the same core, is the least that a program without instruments would do for as many
records: make each channel's sinusoid and noise, put every run in a SQLite file so that it is durable (WAL,
synchronous FULL), read it back and fit a sinusoid to each channel, with numpy. Exit status 1 over 60 s or 500 MB.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

CAMPAIGN = Path(__file__).parent.parent / "campaigns" / "isa-flight-model.toml"
LIMIT_S, LIMIT_MB = 60.0, 500.0

os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from benchmarks.machine import conditions
from benchmarks.processes import rigctl
from benchmarks.store_overhead import plain_sqlite
from rigctl import Store


def shapes(path: Path) -> list[tuple[float, int, int]]:
    """Frequency [Hz], samples and channels of every run."""
    with Store.open(path, readonly=True) as store:
        found = []
        for run in store.runs():
            columns = store.samples(run.run_id)
            found.append((run.conditions["frequency_hz"], len(columns["t_s"]), len(columns) - 1))
        return found


def floor_s(path: Path, runs: list[tuple[float, int, int]], rate_hz: float) -> float:
    """Seconds to make, keep and fit as many records without instruments."""
    rng = np.random.default_rng(1)
    start = time.perf_counter()
    with closing(plain_sqlite(path)) as plain:
        for frequency_hz, samples, channels in runs:
            t = np.arange(samples) / rate_hz
            phase = 2.0 * np.pi * frequency_hz * t
            made = np.sin(phase)[:, np.newaxis] + rng.normal(size=(samples, channels))
            number = plain.execute("INSERT INTO runs (data) VALUES (?)", (made.tobytes(),)).lastrowid
            (kept,) = plain.execute("SELECT data FROM runs WHERE id = ?", (number,)).fetchone()
            design = np.stack([np.ones_like(t), np.cos(phase), np.sin(phase)], axis=1)
            np.linalg.lstsq(design, np.frombuffer(kept).reshape(samples, channels), rcond=None)
    return time.perf_counter() - start


def line(name: str, unit: str, values: list[float], limit: float | None = None) -> str:
    """Median with the extremes."""
    median = statistics.median(values)
    bound = "" if limit is None else f"  <= {limit:g} {unit}{'' if median <= limit else '  MISSED'}"
    return f"  {name:<28} {median:8.2f} {unit:<2}  ({min(values):.2f} .. {max(values):.2f}){bound}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("directory", type=Path, nargs="?")
    arguments = parser.parse_args()
    used, floors = [], []
    for number in range(arguments.repeats):
        with tempfile.TemporaryDirectory(dir=arguments.directory) as name:
            used.append(rigctl("run", CAMPAIGN, "--store", Path(name) / "flight.rig.sqlite", "--yes"))
            runs = shapes(Path(name) / "flight.rig.sqlite")
            floors.append(floor_s(Path(name) / f"floor-{number}.sqlite", runs, 100.0))
    wall_s, peak_mb = [one.wall_s for one in used], [one.peak_mb for one in used]
    samples = sum(count for _, count, _ in runs)
    print(conditions() + ", one core")
    print(f"{len(runs)} runs, {samples} samples of {runs[0][2]} channels; median of {len(used)} (least .. most)")
    print(line("campaign, wall time", "s", wall_s, LIMIT_S))
    print(line("campaign, processor time", "s", [one.processor_s for one in used]))
    print(line("floor without instruments", "s", floors))
    print(line("campaign over floor", "", [a / b for a, b in zip(wall_s, floors, strict=True)]))
    print(line("peak memory", "MB", peak_mb, LIMIT_MB))
    return 0 if statistics.median(wall_s) <= LIMIT_S and max(peak_mb) <= LIMIT_MB else 1


if __name__ == "__main__":
    sys.exit(main())
