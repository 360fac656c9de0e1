"""What compare and diagnose of a table cost as it grows, and how much memory they take.

    python benchmarks/table_size.py [ROWSxCOLUMNS[-slow] | BUNDLE ...]

A curve: by the column before the last no candidate costs more than in proportion to the rows. 1000000x10 takes
minutes and is measured when it is asked for, and so are bundles such as tests/foreign/data/hd-164922.

Columns, two or more, are uniform; one is in the baseline, the square of another is hidden at 15 sigma. `-slow`: the
noise wanders from reading to reading, by a fiftieth of its white part, and a column of time is their order. Each size
is a process of its own. Times are of the processor, on one core. A candidate is one choice of one effect; its cost is
the whole account and diagnosis over candidates and models tried. Exit status 1 when a target is missed.
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

from benchmarks.machine import conditions
from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.recording import READINGS, Header
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.experiments.table import analysis
from rigctl.workbench.next import recommend
from rigctl.workbench.verdict import compare, diagnose

IMPORTED = (compare, diagnose, recommend, analysis)
"""A workbench imports them where it needs them first: what that takes is no work on the table."""

SIZES = ("300x5", "1000x5", "3000x5", "10000x5", "30000x5", "100000x5", "500x50")
TARGETS_S = {"hd-164922": 3.0, "1000x5": 2.0, "500x50": 20.0, "100000x5": 30.0, "1000000x10": 180.0}
MAX_MB = 2000.0
NOISE, SIGMAS = 0.1, 15.0
SLOW = "-slow"


@dataclass(frozen=True)
class Cost:
    """Of one table: seconds, the peak of memory, candidates of the baseline, what was found."""

    rows: int
    seconds: float
    peak_mb: float
    candidates: int
    told: str

    @property
    def each_us(self) -> float:
        """Of a candidate and 1000 rows."""
        return 1e6 * self.seconds / self.candidates / (self.rows / 1000.0)


def fill(path: str, size: str) -> None:
    """A store with a made table: a .csv of a million rows is larger than `rigctl import` reads."""
    if Path(size).is_dir():
        import_bundle(Path(size), Path(path)).close()
        return
    rows, columns = map(int, size.removesuffix(SLOW).split("x"))
    rng = np.random.default_rng(1)
    numbers = np.round(rng.uniform(0.0, 10.0, (rows, columns)), 5)
    hidden = numbers[:, 1] ** 2
    bend = hidden - np.polyval(np.polyfit(numbers[:, 1], hidden, 1), numbers[:, 1])
    amplitude = SIGMAS * NOISE / float(np.linalg.norm(bend))
    response = 1.0 + 0.2 * numbers[:, 0] + amplitude * hidden + rng.normal(0.0, NOISE, rows)
    samples = {f"c{number}_k": numbers[:, number] for number in range(columns)}
    asked = {"response": "reading_v", "baseline": "b0 + b1 * c0_k", "start": {}}
    if size.endswith(SLOW):
        response += np.cumsum(rng.normal(0.0, 0.02 * NOISE, rows))
        samples["time_s"], asked["order"] = np.arange(float(rows)), "time_s"
    samples["reading_v"] = np.round(response, 6)
    header = Header("table", extra={"table": asked})
    with Store.create(Path(path), header) as store, store.begin_run(READINGS, "import", {}, READINGS) as writer:
        writer.append(samples)
        writer.finish()


def cost(path: str) -> Cost:
    """What the table in a store costs, all of it read from there."""
    with Store.open(Path(path)) as store:
        began_s = time.process_time()
        bench = workbench_of(store)
        bench.compare()
        found = bench.diagnose()
        seconds = time.process_time() - began_s
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        model = bench.study.model(())
        start = np.array([each.start for each in model.parameters])
        candidates = len(bench.study.candidates(model, start)[0])
    told = " ".join((found.verdict, *(term.effect for term in found.suggested)))
    return Cost(len(model.observations.value), seconds, peak_mb, candidates, told)


def measured(size: str) -> Cost:
    """Of a size, made in one process and measured in another: what making takes is not counted."""
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as scratch:
        path = str(Path(scratch) / "size.rig.sqlite")
        with spawn.Pool(1) as pool:
            pool.apply(fill, (path, size))
        with spawn.Pool(1) as pool:
            return pool.apply(cost, (path,))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", default=SIZES, metavar="ROWSxCOLUMNS")
    sizes = parser.parse_args().sizes
    print(conditions())
    print(f"  {'table':>12} {'candidates':>10} {'s':>7} {'us per candidate and 1000 rows':>31} {'MB':>6}")
    missed = False
    for size in sizes:
        spent = measured(size)
        name = Path(size).name
        print(
            f"  {name:>12} {spent.candidates:10d} {spent.seconds:7.2f} {spent.each_us:31.0f} {spent.peak_mb:6.0f}"
            f"  {spent.told}",
            flush=True,
        )
        missed |= spent.seconds > TARGETS_S.get(name, np.inf) or spent.peak_mb > MAX_MB
    print("  MISSED" if missed else "  targets met")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
