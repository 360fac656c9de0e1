"""Tables in which nothing is hidden: how often is something found all the same?

    python -m tests.foreign.false_alarms --trials 400 --out FILE [--kind KIND ...] [--first SEED]

One line of JSON for each kind of noise and seed; what stands in the file is not tried again. A table is a line (or a
constant) and noise of its kind, 60 to 200 rows and 3 to 5 columns where the kind says nothing else; what the noise is
like is told to nobody. An alarm is a verdict other than `adequate`, at 1 % and at 5 %; compare's p-value is kept
beside it. A summary of the whole file goes to stdout: counts with their 99 % intervals by Clopper and Pearson; the
status is 1 where a kind's lower limit, or 1.5 times the level for all kinds together, is exceeded.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.trials import add_workers, keep_trials, rows_in, workers_of
from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import RigError
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.verdict.account import LEVEL, account_of
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose

LEVELS = (LEVEL, 0.05)
POOLED_MOST = 1.5
FEWER = {"useless-columns": 100, "long-relaxation": 100, "long-flicker": 100}
"""Trials of kinds that take long, of 400."""

Floats = NDArray[np.float64]
Json = dict[str, Any]


@dataclass
class Table:
    """Columns, words and noise of one table; `order` and `sigma` name columns, as [table] does."""

    columns: dict[str, Floats]
    noise: Floats
    words: dict[str, list[str]] = field(default_factory=dict)
    order: str | None = None
    sigma: str | None = None
    resolution: float = 0.0

    @property
    def rows(self) -> int:
        return len(self.noise)


def some_columns(random: np.random.Generator, rows: int, count: int) -> dict[str, Floats]:
    """Conditions of several kinds, independent of each other: spread evenly, normal, skewed, in steps, drifting."""
    made: list[Floats] = [
        random.uniform(0.0, 10.0, rows),
        random.normal(22.0, 1.5, rows),
        random.lognormal(0.0, 0.5, rows),
        random.integers(1, 6, rows).astype(float),
        1000.0 + 8.0 * np.sin(np.linspace(0.0, random.uniform(2.0, 6.0), rows) + random.uniform(0.0, 6.0)),
    ]
    return {name: np.round(values, 5) for name, values in zip("abcde", made[:count], strict=False)}


def plain(random: np.random.Generator, fewest: int = 60, most: int = 200) -> Table:
    """Nothing but columns yet."""
    rows = int(random.integers(fewest, most + 1))
    return Table(some_columns(random, rows, int(random.integers(3, 6))), np.zeros(rows))


def with_noise(random: np.random.Generator, noise_of: Callable[[int], Floats]) -> Table:
    table = plain(random)
    table.noise = noise_of(table.rows)
    return table


def in_time(
    random: np.random.Generator, noise_of: Callable[[Floats], Floats], fewest: int = 60, most: int = 200
) -> Table:
    """Readings one after the other, ordered by their time."""
    table = plain(random, fewest, most)
    time_s = 10.0 * np.arange(table.rows)
    table.columns = {"time_s": time_s, **dict(list(table.columns.items())[1:])}
    table.noise, table.order = noise_of(time_s), "time_s"
    return table


def relaxing(random: np.random.Generator, time_s: Floats, constant_s: float | None = None) -> Floats:
    """First-order autoregressive noise: what is left of it decays with this time constant, else one of 5 to 50 s."""
    decay = np.exp(-np.diff(time_s) / (random.uniform(5.0, 50.0) if constant_s is None else constant_s))
    noise = random.normal(size=len(time_s))
    for i in range(1, len(noise)):
        noise[i] = decay[i - 1] * noise[i - 1] + np.sqrt(1.0 - decay[i - 1] ** 2) * noise[i]
    return noise


def flickering(random: np.random.Generator, time_s: Floats) -> Floats:
    """White noise and 1/f noise of about its size, shaped in the spectrum of a stretch eight times as long."""
    count = 8 * len(time_s)
    frequency = np.fft.rfftfreq(count)[1:]
    spectrum = np.fft.rfft(random.normal(size=count))
    spectrum[1:] *= 0.3 * frequency**-0.5
    spectrum[0] = 0.0
    return random.normal(size=len(time_s)) + np.fft.irfft(spectrum, count)[: len(time_s)]


def white(random: np.random.Generator) -> Table:
    return with_noise(random, lambda rows: random.normal(size=rows))


def ar1(random: np.random.Generator) -> Table:
    return in_time(random, lambda time_s: relaxing(random, time_s))


def flicker(random: np.random.Generator) -> Table:
    return in_time(random, lambda time_s: flickering(random, time_s))


def long_relaxation(random: np.random.Generator) -> Table:
    """White noise and a third to three times as much that relaxes in 3 to 1000 readings, of 500 to 4000."""

    def noise_of(time_s: Floats) -> Floats:
        constant_s, share = 10.0 * 3.0 * 333.0 ** random.random(), 3.0 ** random.uniform(-1.0, 1.0)
        return random.normal(size=len(time_s)) + np.sqrt(share) * relaxing(random, time_s, constant_s)

    return in_time(random, noise_of, 500, 4000)


def long_flicker(random: np.random.Generator) -> Table:
    return in_time(random, lambda time_s: flickering(random, time_s), 500, 4000)


def walk(random: np.random.Generator) -> Table:
    """White noise and a random walk that takes 8 to 200 readings to go as far."""

    def noise_of(time_s: Floats) -> Floats:
        step = random.uniform(8.0, 200.0) ** -0.5
        return random.normal(size=len(time_s)) + np.cumsum(step * random.normal(size=len(time_s)))

    return in_time(random, noise_of, 60, 400)


def student3(random: np.random.Generator) -> Table:
    return with_noise(random, lambda rows: random.standard_t(3, rows))


def heteroscedastic(random: np.random.Generator) -> Table:
    """The scatter grows with the level: at the top of the range three to ten times what it is at the bottom."""
    table = plain(random)
    growth = random.uniform(2.0, 9.0)
    table.noise = (1.0 + growth * table.columns["a"] / 10.0) * random.normal(size=table.rows)
    return table


def quantised(random: np.random.Generator) -> Table:
    """A digit of one to three standard deviations."""
    table = white(random)
    table.resolution = random.uniform(1.0, 3.0)
    return table


def outliers(random: np.random.Generator) -> Table:
    """One reading in thirty is off by 5 to 15 standard deviations."""
    table = white(random)
    bad = random.random(table.rows) < 1.0 / 30.0
    table.noise[bad] += random.choice([-1.0, 1.0], bad.sum()) * random.uniform(5.0, 15.0, bad.sum())
    return table


def batches(random: np.random.Generator) -> Table:
    """Eight to twenty lots share offsets, and two of the conditions; the lot is a word, or a number."""
    table = white(random)
    lots = int(random.integers(8, 21))
    lot = np.sort(np.arange(table.rows) % lots)
    table.noise += random.uniform(0.5, 3.0) * random.normal(size=lots)[lot]
    for name in ("b", "c"):
        table.columns[name] = table.columns[name][:lots][lot]
    if random.random() < 0.5:
        table.words["lot"] = [f"L{each:02d}" for each in lot]
    else:
        table.columns["lot"] = random.permutation(lots)[lot] + 1.0
    return table


def pasted(random: np.random.Generator) -> Table:
    """A block of a fifth to two fifths of the rows stands in the file twice."""
    table = white(random)
    count = int(table.rows * random.uniform(0.2, 0.4))
    first = int(random.integers(0, table.rows - count))
    rows = np.r_[0 : table.rows, first : first + count]
    table.columns = {name: values[rows] for name, values in table.columns.items()}
    table.noise = table.noise[rows]
    return table


def few_rows(random: np.random.Generator) -> Table:
    rows = int(random.integers(5, 9))
    return Table(some_columns(random, rows, int(random.integers(3, 6))), random.normal(size=rows))


def gaps(random: np.random.Generator) -> Table:
    """Relaxing noise at irregular times, with nights left out, and values missing in a column."""
    table = in_time(random, lambda time_s: time_s)
    nights = random.integers(1, table.rows, 3)
    steps = random.exponential(10.0, table.rows)
    steps[nights] += random.uniform(500.0, 3000.0, 3)
    table.columns["time_s"] = np.round(np.cumsum(steps), 1)
    table.noise = relaxing(random, table.columns["time_s"])
    table.columns["c"][random.random(table.rows) < 0.1] = np.nan
    return table


def stated(random: np.random.Generator, times: float) -> Table:
    """Uncertainties that differ by row are stated, `times` what they are."""
    table = white(random)
    sigma = random.uniform(0.5, 2.0, table.rows)
    table.noise *= sigma
    table.columns["u"] = np.round(times * sigma, 6)
    table.sigma = "u"
    return table


def useless_columns(random: np.random.Generator) -> Table:
    table = white(random)
    for number in range(len(table.columns), 50):
        table.columns[f"x{number}"] = np.round(random.normal(size=table.rows), 5)
    return table


def collinear(random: np.random.Generator) -> Table:
    """Columns that repeat each other but for a hundredth."""
    table = white(random)
    first = table.columns["a"]
    for name in list(table.columns)[1:]:
        table.columns[name] = np.round(random.uniform(0.5, 2.0) * (first + 0.03 * random.normal(size=table.rows)), 5)
    return table


KINDS: Mapping[str, Callable[[np.random.Generator], Table]] = {
    "white": white,
    "ar1": ar1,
    "flicker": flicker,
    "student3": student3,
    "heteroscedastic": heteroscedastic,
    "quantised": quantised,
    "outliers": outliers,
    "batches": batches,
    "pasted": pasted,
    "few-rows": few_rows,
    "gaps": gaps,
    "sigma-doubled": lambda random: stated(random, 2.0),
    "sigma-halved": lambda random: stated(random, 0.5),
    "useless-columns": useless_columns,
    "collinear": collinear,
    "long-relaxation": long_relaxation,
    "long-flicker": long_flicker,
    "walk": walk,
}


def recording(kind: str, seed: int) -> Recording:
    """One table of a kind as a recording."""
    random = np.random.default_rng([list(KINDS).index(kind), seed])
    table = KINDS[kind](random)
    first = next(iter(table.columns))
    along = table.columns[first]
    scale = 10.0 ** random.uniform(-6.0, 3.0)
    if seed % 2:
        baseline, response = f"b0 + b1 * {first}", 5.0 + 3.0 * along / np.ptp(along) + table.noise
    else:
        baseline, response = "b0", 5.0 + table.noise
    if table.resolution:
        response = table.resolution * np.rint(response / table.resolution)
    columns = {"y": scale * response, **table.columns}
    if table.sigma:
        columns[table.sigma] = scale * columns[table.sigma]
    spec = {"response": "y", "baseline": baseline, "start": {}, "order": table.order, "sigma": table.sigma}
    header = Header("table", extra={"table": {key: value for key, value in spec.items() if value is not None}})
    run = RunRecord(READINGS, READINGS, "import", table.words)
    return Recording(header, (run,), {READINGS: columns}, ImportReport(1))


def tried(kind: str, seed: int) -> Json:
    """One table from its drawing to what is said of it.

    The store's account of the noise comes with the search at the lower level, whose end is the verdict; what it finds
    is found at the higher level too.
    """
    begun = time.process_time()
    try:
        study = TableStudy(recording(kind, seed))
        account = account_of(study, [()])
        search = account.search(study, ())
        said = [term.effect for term in search.suggested] + ["unknown"] * (search.unexplained is not None)
        comparison = compared(account.attempt(study, ()), account, 1)
        if not said:
            found = diagnose(study, (), LEVELS[1], account=account)
            further = [term.effect for term in found.suggested] + ["unknown"] * (found.verdict == "unknown")
    except RigError as stopped:
        return {"kind": kind, "seed": seed, "stopped": str(stopped)}
    return {
        "kind": kind,
        "seed": seed,
        "rows": len(study.observations.value),
        "said": [said, said or further],
        "compare_p": comparison.p_value,
        "noise": [f"{entry.model} {entry.sigma:g} x {entry.scale:g}" for entry in comparison.noise],
        "processor_s": round(time.process_time() - begun, 2),
    }


def _tried(kind_and_seed: tuple[str, int]) -> Json:
    return tried(*kind_and_seed)


def interval(count: int, of: int, confidence: float = 0.99) -> tuple[float, float]:
    """Limits of a rate by Clopper and Pearson, each one exceeded with (1 - confidence) / 2."""
    tail = (1.0 - confidence) / 2.0
    low = float(stats.beta.ppf(tail, count, of - count + 1)) if count else 0.0
    return low, float(stats.beta.ppf(1.0 - tail, count + 1, of - count)) if count < of else 1.0


def summary(trials: list[Json]) -> tuple[str, bool]:
    """A table of the kinds, and whether what is promised holds."""
    ended = [trial for trial in trials if "stopped" not in trial]
    lines = [f"{'kind':16}{'n':>5}" + "".join(f"{f'alarms at {level:.0%}':>34}" for level in LEVELS) + f"{'s':>7}"]
    holds = True
    for kind in [*KINDS, "all"]:
        rows = [trial for trial in ended if kind in (trial["kind"], "all")]
        if not rows:
            continue
        cells = []
        for place, level in enumerate(LEVELS):
            count = sum(bool(trial["said"][place]) for trial in rows)
            low, high = interval(count, len(rows))
            beyond = count > POOLED_MOST * level * len(rows) if kind == "all" else low > level
            holds = holds and not beyond
            by_compare = sum(trial["compare_p"] < level for trial in rows)
            rate = f"{count:5} {count / len(rows):6.1%} ({low:.1%} to {high:.1%})"
            cells.append(f"{rate}{'!' if beyond else ' '} c{by_compare:<3}")
        seconds = float(np.mean([trial["processor_s"] for trial in rows]))
        lines.append(f"{kind:16}{len(rows):5}" + "".join(f"{cell:>34}" for cell in cells) + f"{seconds:7.2f}")
    lines.append(f"stopped: {len(trials) - len(ended)}; ! beyond what is promised; c: p-values of compare below it")
    return "\n".join(lines), holds


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--trials", type=int, default=400, help="of each kind")
    arguments.add_argument("--first", type=int, default=0, help="seed; others than those that a change was made on")
    arguments.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    arguments.add_argument("--out", type=Path, required=True)
    add_workers(arguments, 1)
    given = arguments.parse_args()
    done = {(trial["kind"], trial["seed"]) for trial in rows_in(given.out)}
    wanted = [
        (kind, given.first + number)
        for number in range(given.trials)
        for kind in given.kind
        if number < given.trials * FEWER.get(kind, 400) // 400
    ]
    keep_trials(_tried, [each for each in wanted if each not in done], given.out, workers_of(given))
    text, holds = summary(rows_in(given.out))
    sys.stdout.write(text + "\n")
    sys.exit(not holds)


if __name__ == "__main__":
    main()
