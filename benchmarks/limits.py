"""What each thing costs beside what it cannot do without, and how the cost grows with the work.

    python benchmarks/limits.py [--only WORD ...] [--figure FILE.svg]

One command for the table and the figure "Limits" of RESULTS.md, some seven minutes. Each row is the median of pairs,
ours and its floor in turn, in processor time of one core where nothing else is said. Goals are those one would want.
A row that misses its goal says so, and the exit status stays 0: this is a record and no test.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks import (
    bias_rejection_stream,
    blind_world,
    diagnose_large,
    flight_model,
    inflight_speed,
    null_search,
    run_overhead,
    store_overhead,
    workbench_size,
)
from benchmarks.blind_sampler import Design
from benchmarks.machine import conditions
from benchmarks.processes import ROOT, Used, python, rigctl
from rigctl.campaign.recording import Header
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.experiments.rotating_platform.observe.patterns import named_pattern
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.style import SOFT

PAIRS = 3
NULLS = 24
STORES = (100, 1000, 10_000, 100_000)
DIAGNOSED = (72, 360, 1440, 5004)
STREAMED = (750_000, 3_000_000, 12_000_000)
APPENDED = (100, 1000, 10_000)


@dataclass(frozen=True)
class Row:
    """One line of the table: `goal` of `ours`, or of the ratio where `of_ratio`."""

    what: str
    ours: float
    unit: str
    floor: float = math.nan
    floor_is: str = ""
    goal: float = math.nan
    of_ratio: bool = False
    at_least: bool = False

    def __str__(self) -> str:
        ratio = self.ours / self.floor
        judged = ratio if self.of_ratio else self.ours
        met = judged >= self.goal if self.at_least else judged <= self.goal
        goal = "" if math.isnan(self.goal) else f"{self.goal:g}{'' if self.of_ratio else f' {self.unit}'}"
        verdict = "" if math.isnan(self.goal) else "yes" if met else "no"
        floor = "" if math.isnan(self.floor) else f"{self.floor:.3g} {self.unit}, {self.floor_is}"
        shown = "" if math.isnan(ratio) else f"{ratio:.3g}"
        return f"| {self.what} | {self.ours:.3g} {self.unit} | {floor} | {shown} | {goal} | {verdict} |"


@dataclass(frozen=True)
class Curve:
    """Cost against size; as many `costs` as `sizes`."""

    what: str
    of: str
    unit: str
    sizes: Sequence[float]
    costs: Sequence[float]

    def __str__(self) -> str:
        pairs = zip(self.sizes, self.costs, strict=True)
        return f"  {self.what}: " + ", ".join(f"{size:g} {self.of} {cost:.3g} {self.unit}" for size, cost in pairs)


Found = Iterator[Row | Curve]


def processor_s(action: Callable[[], object]) -> float:
    began_s = time.process_time()
    action()
    return time.process_time() - began_s


def median(measure: Callable[[], float], times: int = PAIRS) -> float:
    return statistics.median(measure() for _ in range(times))


def null(_: Path) -> Found:
    cases = [(axis, configuration) for axis in "XYZ" for configuration in ("pendulum", "flag")]
    rows = [null_search.search(1000 + number, *cases[number % len(cases)]) for number in range(NULLS)]
    mean = {key: statistics.mean(row[key] for row in rows) for key in rows[0]}
    bound = "Cramer-Rao bound's acquisition"
    yield Row("rig time of a null search, mean", mean["rig_s"], "s", mean["bound_s"], bound, 1.25, of_ratio=True)
    worst = max(rows, key=lambda row: row["ratio"])
    yield Row("the same, worst", worst["rig_s"], "s", worst["bound_s"], bound, 1.5, of_ratio=True)


def campaign(place: Path) -> Found:
    used, floors = list[Used](), list[float]()
    for number in range(PAIRS):
        store = place / f"flight-{number}.rig.sqlite"
        used.append(rigctl("run", flight_model.CAMPAIGN, "--store", store, "--yes"))
        shapes = flight_model.shapes(store)
        floors.append(processor_s(lambda: flight_model.floor_s(place / f"floor-{number}.sqlite", shapes, 100.0)))  # noqa: B023
    with Store.open(store, readonly=True) as opened:
        last = opened.runs()[-1]
        rig_h = (last.conditions["start_s"] + len(opened.samples(last.run_id)["t_s"]) / 100.0) / 3600.0
    ours, floor = statistics.median(each.processor_s for each in used), statistics.median(floors)
    yield Row("flight-model campaign on its twin", ours, "s", floor, "the records made, kept and fitted", 8.0)
    yield Row("its rig time", rig_h, "h", goal=16.4)


def bench_run(place: Path) -> Found:
    with closing(store_overhead.plain_sqlite(place / "plain.sqlite")) as plain:
        whole, _, _ = run_overhead.bench_run(plain, place / "bench.rig.sqlite")
    ours, floor = (1e3 * statistics.median(each) for each in (whole.ours_s, whole.floor_s))
    yield Row("a bench run, six instruments (clock)", ours, "ms", floor, "one durable insert", 6.0, of_ratio=True)


def points(place: Path) -> Found:
    rng, width = np.random.default_rng(2), len(store_overhead.COLUMNS)
    costs = []
    with (
        closing(store_overhead.plain_sqlite(place / "rows.sqlite", "NORMAL")) as plain,
        Store.create(place / "rows.rig.sqlite", Header("sensing-axis")) as store,
    ):
        for number, count in enumerate(APPENDED):
            rows = rng.normal(size=(count, width))
            store_overhead.appends_per_s(store, 1000 + number, rows[:50])
            costs.append(count / median(lambda: store_overhead.appends_per_s(store, next(_NUMBERS), rows)))  # noqa: B023
        rows = rng.normal(size=(1000, width))
        taken = [
            (store_overhead.inserts_per_s(plain, rows), store_overhead.appends_per_s(store, next(_NUMBERS), rows))
            for _ in range(11)
        ]
    floor, ours = (statistics.median(column) for column in zip(*taken, strict=True))
    yield Row("durable single points (clock)", ours, "/s", floor, "SQLite's own", 20_000.0, at_least=True)
    yield Curve("points appended, each committed (clock)", "points", "s", APPENDED, costs)


_NUMBERS = iter(range(1_000_000))


def commands(place: Path) -> Found:
    store = filled(place / "status.rig.sqlite", 20)
    rigctl("status", store)
    floor = median(lambda: python("-c", "pass").processor_s, 7)
    for name, arguments, goal in (
        ("`rigctl --help`", ("--help",), 0.12),
        ("`rigctl status`", ("status", store), 0.2),
        ("`rigctl completion bash`", ("completion", "bash"), 0.2),
    ):
        ours = median(lambda: rigctl(*arguments).processor_s, 7)  # noqa: B023
        yield Row(name, ours, "s", floor, "Python alone", goal)


def draws(_: Path) -> Found:
    study = inflight_speed.MonteCarlo(name="monte-carlo", orbits=2.0)
    ensemble = inflight_speed.Ensemble(inflight_speed.NATURE)
    lanes = tuple(range(ensemble.at_once))
    unit = inflight_speed.Unit(ensemble, study, inflight_speed.ORBIT_S, "ac13", 5, lanes)
    steps = round((2.0 * inflight_speed.ORBIT_S + inflight_speed.SETTLE_S) / inflight_speed.STEP_S)
    inflight_speed.reduce_unit(unit)
    # Memory that is there: pages of a gigabyte asked for anew cost as much as the numbers.
    rng, memory = np.random.default_rng(1), np.empty((len(lanes), steps // 100, 18))
    share = inflight_speed.STEPS_OF_A_DRAW / (steps * len(lanes))
    ours, floor = [], []
    for _ in range(PAIRS):
        ours.append(share * processor_s(lambda: inflight_speed.reduce_unit(unit)))
        floor.append(share * processor_s(lambda: [rng.standard_normal(out=memory) for _ in range(100)]))
    draw_s, noise_s = statistics.median(ours), statistics.median(floor)
    yield Row("in flight: a draw of ten sessions", draw_s, "s", noise_s, "its noise drawn by numpy", 0.35)
    peak = python(ROOT / "benchmarks" / "inflight_speed.py", "--turns", "1", may_miss_targets=True).peak_mb
    yield Row("its memory, forty orbits' weights among it", peak, "MB", goal=200.0)


def calibration(place: Path) -> Found:
    store, bundle = place / "flown.rig.sqlite", place / "flown"
    rigctl("run", ROOT / "campaigns" / "microscope.toml", "--store", store, "--yes")
    rigctl("export", store, bundle)
    imported, diagnosed, read = [], [], []
    for number in range(PAIRS):
        copy = place / f"imported-{number}.rig.sqlite"
        read.append(processor_s(lambda: [each.read_bytes() for each in bundle.rglob("*") if each.is_file()]))
        imported.append(rigctl("import", bundle, "--store", copy).processor_s)
        diagnosed.append(rigctl("diagnose", copy).processor_s)
        copy.unlink()
    floor = statistics.median(read)
    yield Row("in flight: a calibration imported", statistics.median(imported), "s", floor, "its files read", 5.0)
    yield Row("its diagnosis, the first", statistics.median(diagnosed), "s", floor, "its files read", 5.0)


def stream(_: Path) -> Found:
    sampled, costs, fastest_s = named_pattern("c", 60.0).sampled(bias_rejection_stream.RATE_HZ), [], math.nan
    for count in STREAMED:
        columns = bias_rejection_stream.record(sampled, count)
        bias_rejection_stream.demodulated(sampled, columns, 500_000)
        ours, floor = list[float](), list[float]()
        for _ in range(PAIRS):
            floor.append(processor_s(lambda: [column.max() for column in columns.values()]))  # noqa: B023
            ours.append(processor_s(lambda: bias_rejection_stream.demodulated(sampled, columns, 500_000)))  # noqa: B023
        costs.append(statistics.median(ours))
        fastest_s = statistics.median(floor)
    fastest = "numpy's maximum of the columns"
    yield Row("platform: 12 million samples of 8 columns to periods", costs[-1], "s", fastest_s, fastest)
    yield Curve("platform: samples to periods", "samples", "s", STREAMED, costs)


def diagnoses(place: Path) -> Found:
    imports, costs, peaks, again = [], [], [], list[float]()
    for runs in DIAGNOSED:
        here = place / f"diagnosed-{runs}"
        store = here / "x.rig.sqlite"
        imports.append(rigctl("import", recorded(here, runs), "--store", store).processor_s)
        used = rigctl("diagnose", store)
        costs.append(used.processor_s)
        peaks.append(used.peak_mb)
        again.append(rigctl("diagnose", store).processor_s)
    yield Row(f"diagnosis of {DIAGNOSED[-1]} runs x 200 samples", costs[-1], "s", goal=8.0)
    yield Row("its memory", peaks[-1], "MB", goal=400.0)
    yield Row("asked once more", again[-1], "s")
    yield Curve("import of so many runs", "runs", "s", DIAGNOSED, imports)
    yield Curve("diagnosis, two hidden effects", "runs", "s", DIAGNOSED, costs)
    yield Curve("the same asked once more", "runs", "s", DIAGNOSED, again)


def stores(place: Path) -> Found:
    found: dict[str, list[float]] = {"status": [], "mark": []}
    for runs in STORES:
        store = filled(place / f"store-{runs}.rig.sqlite", runs)
        found["status"].append(median(lambda: rigctl("status", store).processor_s))  # noqa: B023
        found["mark"].append(median(lambda: rigctl("mark", store, "5", "a bump", "--invalid").processor_s))  # noqa: B023
        store.unlink()
    for name, costs in found.items():
        yield Row(f"`rigctl {name}` of {STORES[-1]} runs", costs[-1], "s", goal=0.1)
        yield Curve(f"`rigctl {name}`", "runs", "s", STORES, costs)


def filled(path: Path, runs: int) -> Path:
    """A store of so many short runs, nothing reduced."""
    with Store.create(path, Header("sensing-axis")) as store:
        workbench_size.fill(store, runs, 20, 40.0)
    return path


def recorded(place: Path, runs: int) -> Path:
    """A bundle of a simulated bench's runs: six mountings of as many angles as that takes."""
    place.mkdir()
    angles = tuple(float(angle) for angle in np.linspace(-30.0, 30.0, runs // 36).round(3))
    design = Design(axes=("X", "Y", "Z"), angles_deg=angles, dwell_s=10.0, sample_rate_hz=20.0)
    drawn = blind_world.draw(5, "two", diagnose_large.SIZED_FOR, sigma=(8.0, 14.0))
    blind_world.record(blind_world.Trial(drawn.nature, design, drawn.truth), place / "bundle")
    return place / "bundle"


PARTS: dict[str, Callable[[Path], Found]] = {
    "null": null,
    "campaign": campaign,
    "bench-run": bench_run,
    "points": points,
    "commands": commands,
    "draws": draws,
    "calibration": calibration,
    "stream": stream,
    "diagnoses": diagnoses,
    "stores": stores,
}


def drawn(curves: Sequence[Curve]) -> str:
    """A panel per curve, both axes logarithmic; dotted: what grows in proportion, from the largest back."""
    figure = Figure(2.2 * math.ceil(len(curves) / 2))
    panels = figure.subplots(math.ceil(len(curves) / 2), 2, squeeze=False)
    flat = [panel for line in panels for panel in line]
    for panel, curve in zip(flat, curves, strict=False):
        sizes, costs = (np.array(each, dtype=np.float64) for each in (curve.sizes, curve.costs))
        in_proportion: FloatArray = costs[-1] * sizes / sizes[-1]
        panel.plot(sizes, in_proportion, ":", color=SOFT)
        panel.plot(sizes, costs, "o-", titles=[f"{cost:.3g} {curve.unit}" for cost in costs])
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(curve.what.replace("`", ""))
        panel.set_xlabel(curve.of)
        panel.set_ylabel(curve.unit)
    for panel in flat[len(curves) :]:
        panel.set_axis_off()
    return figure.svg("growth", "Cost against size, both logarithmic; dotted: in proportion to the size.")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--figure", type=Path)
    asked = parser.parse_args()
    print(conditions())
    print("| what | ours | floor | ratio | goal | met |\n|---|---|---|---|---|---|")
    curves = []
    with tempfile.TemporaryDirectory() as name:
        for part in asked.only:
            (place := Path(name) / part).mkdir()
            for found in PARTS[part](place):
                if isinstance(found, Row):
                    print(found, flush=True)
                else:
                    curves.append(found)
    print("\n".join(map(str, curves)))
    if asked.figure is not None:
        asked.figure.write_text(drawn(curves), encoding="utf-8")
    print(f"  peak of this process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
