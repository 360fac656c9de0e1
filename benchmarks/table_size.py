"""What compare and diagnose of a table cost as it grows, and how much memory they take.

    python benchmarks/table_size.py [ROWSxCOLUMNS ...]

Columns (two or more) are uniform; one is in the baseline, the square of another is hidden at 15 sigma.
Each size is a process of its own. Times are of the processor, on one core. A candidate is one choice of one effect;
its cost is the whole account and diagnosis over candidates and models tried. Exit status 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from machine import conditions

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.composition import workbench_of

SIZES = ("300x5", "1000x5", "3000x5", "500x50")
TARGETS_S = {"1000x5": 2.0, "500x50": 20.0, "100000x5": 30.0, "1000000x10": 180.0}
MAX_MB = 2000.0
NOISE, SIGMAS = 0.1, 15.0


@dataclass(frozen=True)
class Cost:
    """Of one table: seconds, the peak of memory, candidates of the baseline, what was found."""

    seconds: float
    peak_mb: float
    candidates: int
    told: str


def write(bundle: Path, rows: int, columns: int) -> None:
    rng = np.random.default_rng(1)
    numbers = np.round(rng.uniform(0.0, 10.0, (rows, columns)), 5)
    hidden = numbers[:, 1] ** 2
    bend = hidden - np.polyval(np.polyfit(numbers[:, 1], hidden, 1), numbers[:, 1])
    size = SIGMAS * NOISE / float(np.linalg.norm(bend))
    response = 1.0 + 0.2 * numbers[:, 0] + size * hidden + rng.normal(0.0, NOISE, rows)
    names = [f"c{number}_k" for number in range(columns)]
    bundle.mkdir()
    table = '[table]\nresponse = "reading_v"\nbaseline = "b0 + b1 * c0_k"\n'
    (bundle / "recording.toml").write_text(f'format = 1\nexperiment = "table"\ntitle = "size"\n\n{table}')
    header = ",".join(["reading_v", *names])
    written = np.column_stack([response, numbers])
    np.savetxt(bundle / "readings.csv", written, fmt="%.6f", delimiter=",", header=header, comments="")


def cost(size: str) -> Cost:
    """What a table of `size` costs, all of it read from its store."""
    rows, columns = map(int, size.split("x"))
    with tempfile.TemporaryDirectory() as scratch:
        write(Path(scratch) / "bundle", rows, columns)
        with import_bundle(Path(scratch) / "bundle", Path(scratch) / "size.rig.sqlite") as store:
            began_s = time.process_time()
            bench = workbench_of(store)
            bench.compare()
            found = bench.diagnose()
            seconds = time.process_time() - began_s
            model = bench.study.model(())
            start = np.array([each.start for each in model.parameters])
            candidates = len(bench.study.candidates(model, start)[0])
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return Cost(seconds, peak_mb, candidates, " ".join((found.verdict, *(term.effect for term in found.suggested))))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", default=SIZES, metavar="ROWSxCOLUMNS")
    sizes = parser.parse_args().sizes
    print(conditions())
    print(f"  {'table':>12} {'candidates':>10} {'s':>7} {'us per candidate and 1000 rows':>31} {'MB':>6}")
    missed = False
    for size in sizes:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            spent = pool.apply(cost, (size,))
        each_us = 1e6 * spent.seconds / spent.candidates / (int(size.split("x")[0]) / 1000.0)
        print(
            f"  {size:>12} {spent.candidates:10d} {spent.seconds:7.2f} {each_us:31.0f} {spent.peak_mb:6.0f}"
            f"  {spent.told}",
            flush=True,
        )
        missed |= spent.seconds > TARGETS_S.get(size, np.inf) or spent.peak_mb > MAX_MB
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
