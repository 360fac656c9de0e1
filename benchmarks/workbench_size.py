"""How fast a recording becomes amplitudes, beside reading its samples, and how much memory that takes.

    python benchmarks/workbench_size.py [--large] [DIRECTORY]

Makes a store of 60 runs x 2000 samples x 5 columns, with --large one of 5000 x 40 000 (8 GB in DIRECTORY, by default
the current one), reads all its samples (the floor), reduces them as `rigctl import` does, and once more from what was
kept. Times are of the processor; one core is meant: set OMP_NUM_THREADS=1. Exit status 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import conditions
from rigctl.analysis.lines import find_lines
from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.experiments.sensing_axis.observe.store_reduction import line_scan, reduction

SMALL, LARGE = (60, 2000, 40.0), (5000, 40_000, 100.0)
FREQUENCIES_HZ = (0.3, 0.5, 0.6)
MAX_SMALL_S, MAX_MEMORY_MB = 0.5, 2000.0
LINE_HZ, LINE_V = 3.17, 2e-4


def fill(store: Store, runs: int, samples: int, rate_hz: float) -> None:
    """Runs of a driven stage, with white noise and a weak line of any phase."""
    rng = np.random.default_rng(1)
    t_s = np.arange(samples) / rate_hz
    for number in range(runs):
        axis, configuration = "XYZ"[number % 3], ("pendulum", "flag")[number // 3 % 2]
        nu = FREQUENCIES_HZ[number // 6 % 3]
        part = rng.normal(size=(3, samples))
        turn = np.sin(2 * np.pi * nu * t_s + rng.uniform(0, 2 * np.pi))
        line = LINE_V * np.cos(2 * np.pi * LINE_HZ * t_s + rng.uniform(0, 2 * np.pi))
        given = {"axis": axis, "configuration": configuration, "mounting": 1 + number // 30, "frequency_hz": nu}
        with store.begin_run(f"r{number}", "benchmark", {**given, "theta_deg": rng.uniform(-1, 1)}) as writer:
            writer.append(
                {
                    "t_s": t_s,
                    "stage_x_mm": 5.0 * turn,
                    "accel_v": 0.1 * turn + line + 1e-3 * part[0],
                    "laser_1_mm": 5.0 * turn + 5e-5 * part[1],
                    "laser_2_mm": 0.01 * turn + 5e-5 * part[2],
                }
            )
            writer.finish()


def timed(what: str, runs: int, began_s: float) -> float:
    took_s = time.process_time() - began_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"  {what:<44} {took_s:9.3f} s  {runs / took_s:9.0f} runs/s  peak {peak_mb:6.0f} MB", flush=True)
    return took_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true")
    parser.add_argument("directory", nargs="?", type=Path, default=Path.cwd())
    given = parser.parse_args()
    runs, samples, rate_hz = LARGE if given.large else SMALL
    print(conditions())
    print(f"  {runs} runs x {samples} samples x 5 columns")
    with tempfile.TemporaryDirectory(dir=given.directory) as name:
        path = Path(name) / "size.rig.sqlite"
        with Store.create(path, Header("sensing-axis")) as store:
            began_s = time.process_time()
            fill(store, runs, samples, rate_hz)
            timed("recorded", runs, began_s)
            began_s = time.process_time()
            for record in store.runs():
                store.samples(record.run_id)
            floor_s = timed("samples read: the floor", runs, began_s)
            before = path.stat().st_size
            began_s = time.process_time()
            reduction(store)
            first_s = timed("reduced and kept", runs, began_s)
        with Store.open(path) as store:
            began_s = time.process_time()
            reduction(store)
            timed("reduced again, from what is kept", runs, began_s)
            began_s = time.process_time()
            lines = find_lines(line_scan(store))
            timed("lines found in the kept scan", runs, began_s)
        kept_mb = (path.stat().st_size - before) / 1e6
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    for line in lines:
        print(
            f"  line at {line.frequency_hz:.5f} Hz, {line.amplitude:.3g} +- {line.sigma:.1g} V, p {line.p_value:.1g}"
        )
    print(f"  reduction / floor {first_s / floor_s:.1f}; kept {kept_mb:.1f} MB")
    missed = peak_mb > MAX_MEMORY_MB or (not given.large and first_s > MAX_SMALL_S)
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
