"""Which terms are missing from a table's model? The workbench beside the tools that practitioners use.

    python3.11 -m venv out/table-peers
    out/table-peers/bin/python -m pip install --require-hashes -r benchmarks/table_peers.lock
    PYTHONPATH=. out/table-peers/bin/python benchmarks/table_peers.py [--tables N]

Two kinds of tables, drawn by seed; nobody is told the noise. In the first, readings of four correlated columns hide
none, one or two terms: a column, its square, the product of two. In the second, readings at irregular times hide a
sine or nothing. A term's size is what the least-squares fit that knows the truth would find, in its sigmas.

Every tool names terms. A linear term that comes with its square or its product is not counted, neither as right nor
as false, as where a square has its zero is a matter of origins. Parameters are those of an ordinary least-squares fit
of the terms named, in sigmas of the fit that knows the truth, where all names are right.

- stepwise BIC: forward and backward over all fourteen terms, statsmodels' OLS
- lasso with stability selection: scikit-learn, Meinshausen and Buhlmann, J. R. Stat. Soc. B 72 (2010) 417
- symbolic regression: gplearn with sums, differences and products; the terms of the winning program, multiplied out,
  that are a hundredth of the scatter at least
- Lomb-Scargle with a bootstrapped false-alarm probability of 1 %: astropy

Exit status 1 when another tool has more right names, or fewer false terms, in significantly more tables than the
workbench has: of those where the two differ, by an exact sign test at 5 %.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import binomtest

from benchmarks.machine import conditions
from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.verdict.account import account_of
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit

ALPHA, SIGNIFICANT = 0.01, 0.05
COLUMNS = ("a", "b", "c", "d")
CORRELATION = 0.5
ROWS, TIMES, SPAN_D = 100, 80, 100.0
SIZES = (5.0, 12.0)
PERIODS_D = (3.0, 40.0)
SUBSAMPLES, KEPT_SHARE = 100, 0.7
BOOTSTRAPS = 200
PARSIMONY = 0.01
"""What a node of a program costs, in squares of the noise: gplearn's "auto" leaves programs of one node here."""

Names = frozenset[str]


@dataclass(frozen=True)
class Table:
    """Readings, and what is hidden in them: names and parameters, with the sigmas of the fit that knows the names."""

    columns: Mapping[str, FloatArray]
    y: FloatArray
    truth: Mapping[str, float]
    sigma: Mapping[str, float]


@dataclass(frozen=True)
class Answer:
    """The terms a tool names, with their parameters."""

    parameters: Mapping[str, float]


Tool = Callable[[Table], Answer]


def dictionary(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Every column, square and product, by the names of the workbench."""
    terms = {f"linear[{name}]": values for name, values in columns.items()}
    terms |= {f"power2[{name}]": values**2 for name, values in columns.items()}
    pairs = itertools.combinations(columns, 2)
    return terms | {f"interaction[{one},{two}]": columns[one] * columns[two] for one, two in pairs}


def least_squares(terms: Mapping[str, FloatArray], y: FloatArray) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of terms beside a constant, and their sigmas for noise of 1."""
    design = np.column_stack([np.ones(len(y)), *terms.values()])
    values = np.linalg.lstsq(design, y)[0]
    sigma = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    return dict(zip(terms, values[1:].tolist(), strict=True)), dict(zip(terms, sigma[1:].tolist(), strict=True))


def terms_table(seed: int) -> Table:
    """None, one or two terms beside a constant."""
    rng = np.random.default_rng([1, seed])
    mixing = np.linalg.cholesky(np.full((4, 4), CORRELATION) + (1.0 - CORRELATION) * np.eye(4))
    columns = dict(zip(COLUMNS, mixing @ rng.normal(size=(4, ROWS)), strict=True))
    terms = dictionary(columns)
    names = rng.choice(list(terms), size=seed % 3, replace=False).tolist()
    hidden = {name: terms[name] for name in names}
    sigma = least_squares(hidden, np.zeros(ROWS))[1]
    truth = {name: float(rng.choice([-1.0, 1.0]) * rng.uniform(*SIZES) * sigma[name]) for name in names}
    y = 3.0 + rng.normal(size=ROWS) + sum((truth[name] * hidden[name] for name in names), np.zeros(ROWS))
    return Table(columns, y, truth, sigma)


def period_table(seed: int) -> Table:
    """A sine at irregular times, or none; its parameter is the frequency."""
    rng = np.random.default_rng([2, seed])
    day = np.sort(rng.uniform(0.0, SPAN_D, TIMES))
    y = 10.0 + rng.normal(size=TIMES)
    if seed % 3 == 0:
        return Table({"day": day}, y, {}, {})
    per_day = 1.0 / np.exp(rng.uniform(*np.log(PERIODS_D)))
    phase = 2.0 * np.pi * (per_day * day + rng.random())
    amplitude = rng.uniform(*SIZES) * np.sqrt(2.0 / TIMES)
    # Of a frequency; Bretthorst, Bayesian Spectrum Analysis and Parameter Estimation (1988), equation 2.12.
    sigma = np.sqrt(6.0 / TIMES) / (np.pi * np.ptp(day) * amplitude)
    return Table({"day": day}, y + amplitude * np.sin(phase), {"periodic[day]": per_day}, {"periodic[day]": sigma})


def workbench(table: Table) -> Answer:
    """The verdict of `rigctl diagnose`, and the fit of what it suggests."""
    header = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}}})
    columns = {READINGS: {"y": table.y, **table.columns}}
    study = TableStudy(Recording(header, (RunRecord(READINGS, READINGS, "import", {}),), columns, ImportReport(1)))
    account = account_of(study, [()])
    found = fit(study, diagnose(study, (), ALPHA, account=account).suggested, account).as_json()["parameters"]
    values = {name: each["value"] for name, each in found.items()}
    periods = {name.partition(".")[0]: 1.0 / value for name, value in values.items() if name.endswith(".period")}
    return Answer({name: value for name, value in values.items() if name.endswith("]")} | periods)


def refitted(table: Table, names: Names) -> Answer:
    """Terms named, fitted by ordinary least squares."""
    terms = dictionary(table.columns)
    return Answer(least_squares({name: terms[name] for name in sorted(names)}, table.y)[0])


def stepwise_bic(table: Table) -> Answer:
    """Add or drop what lowers the criterion most, until nothing does."""
    from statsmodels.api import OLS

    terms = dictionary(table.columns)

    def bic(names: Names) -> float:
        design = np.column_stack([np.ones(len(table.y)), *(terms[name] for name in sorted(names))])
        return float(OLS(table.y, design).fit().bic)

    chosen: Names = frozenset()
    lowest = bic(chosen)
    while True:
        best, chosen_next = min(
            ((bic(each), each) for each in (chosen ^ {name} for name in terms)), key=lambda p: p[0]
        )
        if best >= lowest:
            return refitted(table, chosen)
        lowest, chosen = best, chosen_next


def stable_lasso(table: Table) -> Answer:
    """Terms that the lasso keeps in most of many halves of the rows, at the penalty of cross-validation."""
    from sklearn.linear_model import Lasso, LassoCV
    from sklearn.preprocessing import StandardScaler

    terms = dictionary(table.columns)
    design = StandardScaler().fit_transform(np.column_stack(list(terms.values())))
    penalty = LassoCV(cv=5, random_state=0).fit(design, table.y).alpha_
    rng, half = np.random.default_rng(0), len(table.y) // 2
    kept = np.zeros(len(terms))
    for _ in range(SUBSAMPLES):
        rows = rng.choice(len(table.y), size=half, replace=False)
        kept += Lasso(alpha=penalty * np.sqrt(2.0)).fit(design[rows], table.y[rows]).coef_ != 0.0
    return refitted(table, frozenset(itertools.compress(terms, kept >= KEPT_SHARE * SUBSAMPLES)))


def symbolic(table: Table) -> Answer:
    """The terms of gplearn's winning program."""
    from gplearn.genetic import SymbolicRegressor

    names = tuple(table.columns)
    design, scatter = np.column_stack(list(table.columns.values())), float(np.std(table.y))
    regressor = SymbolicRegressor(
        population_size=1000,
        generations=20,
        function_set=("add", "sub", "mul"),
        metric="mse",
        parsimony_coefficient=PARSIMONY,
        const_range=(-10.0, 10.0),
        random_state=0,
    )
    program = iter(regressor.fit(design, table.y - np.mean(table.y))._program.program)
    monomials = multiplied_out(program)
    terms = dictionary(table.columns)
    named = {}
    for variables, factor in monomials.items():
        name = term_name([names[place] for place in variables])
        size = abs(factor) * float(np.std(np.prod(design[:, list(variables)], axis=1))) if variables else 0.0
        if size > 0.01 * scatter:
            named[name] = factor
    return Answer({**named, **refitted(table, frozenset(named) & frozenset(terms)).parameters})


Polynomial = dict[tuple[int, ...], float]


def multiplied_out(program: Iterator[object]) -> Polynomial:
    """A program of gplearn, a prefix list of functions, places of columns and constants, as a polynomial."""
    node = next(program)
    if isinstance(node, int | np.integer):
        return {(int(node),): 1.0}
    if isinstance(node, float):
        return {(): node}
    one, two = multiplied_out(program), multiplied_out(program)
    product: Polynomial = {}
    match getattr(node, "name"):  # noqa: B009 - gplearn's functions have no public type
        case "mul":
            pairs = [(p + q, x * y) for (p, x), (q, y) in itertools.product(one.items(), two.items())]
        case "add":
            pairs = [*one.items(), *two.items()]
        case _:
            pairs = [*one.items(), *((variables, -factor) for variables, factor in two.items())]
    for variables, factor in pairs:
        key = tuple(sorted(variables))
        product[key] = product.get(key, 0.0) + factor
    return product


def term_name(variables: list[str]) -> str:
    """As the workbench would call it; another name for what its catalogue does not have."""
    match variables:
        case [one]:
            return f"linear[{one}]"
        case [one, two]:
            return f"power2[{one}]" if one == two else f"interaction[{one},{two}]"
        case _:
            return "*".join(variables)


def lomb_scargle(table: Table) -> Answer:
    """The highest peak, if noise of the same readings in any order is as high in one of a hundred."""
    from astropy.timeseries import LombScargle

    day, y = table.columns["day"], table.y
    scan = LombScargle(day, y)
    per_day, power = scan.autopower(minimum_frequency=0.5 / SPAN_D, maximum_frequency=1.0, samples_per_peak=10)
    rng = np.random.default_rng(0)
    drawn = [rng.choice(y, len(y)) for _ in range(BOOTSTRAPS)]
    highest = [LombScargle(day, each).power(per_day).max() for each in drawn]
    if np.mean(np.array(highest) >= power.max()) > ALPHA:
        return Answer({})
    return Answer({"periodic[day]": float(per_day[np.argmax(power)])})


@dataclass
class Score:
    """How a tool did, table by table."""

    right: list[bool] = field(default_factory=list)
    false: list[int] = field(default_factory=list)
    pulls: dict[int, list[float]] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)

    def take(self, seed: int, table: Table, answer: Answer, seconds: float) -> None:
        """Judge one answer."""
        implied = _lower(frozenset(table.truth)) | _lower(frozenset(answer.parameters))
        named, truth = frozenset(answer.parameters) - implied, frozenset(table.truth) - implied
        self.right.append(named == truth)
        self.false.append(len(named - truth))
        self.seconds.append(seconds)
        if named == truth and truth:
            errors = [answer.parameters[name] - table.truth[name] for name in sorted(truth)]
            self.pulls[seed] = [e / table.sigma[name] for e, name in zip(errors, sorted(truth), strict=True)]


def _lower(names: Names) -> Names:
    """The linear terms that come with squares and products."""
    inside = (name[name.index("[") + 1 : -1].split(",") for name in names if name[:2] in {"po", "in"})
    return frozenset(f"linear[{column}]" for columns in inside for column in columns)


def contest(draw: Callable[[int], Table], tools: Mapping[str, Tool], tables: int) -> dict[str, Score]:
    """Every tool on every table, one after the other."""
    scores = {name: Score() for name in tools}
    for seed in range(tables):
        table = draw(seed)
        for name, tool in tools.items():
            start = time.process_time()
            answer = tool(table)
            scores[name].take(seed, table, answer, time.process_time() - start)
    return scores


def print_scores(title: str, scores: Mapping[str, Score]) -> None:
    """A line for each tool; parameter errors over the tables that both it and the workbench name rightly."""
    print(f"  {title:<46} {'right':>7} {'false':>7} {'error':>7} {'ours':>7} {'s':>8}")
    ours = scores["workbench"]
    for name, score in scores.items():
        both = sorted(score.pulls.keys() & ours.pulls.keys())
        error, beside = (
            float(np.sqrt(np.mean([pull**2 for seed in both for pull in each.pulls[seed]]))) if both else np.nan
            for each in (score, ours)
        )
        right, false = np.mean(score.right), np.mean(score.false)
        print(f"    {name:<44} {right:7.3f} {false:7.3f} {error:7.2f} {beside:7.2f} {np.median(score.seconds):8.3f}")


def beaten(scores: Mapping[str, Score]) -> list[str]:
    """The tools that are better than the workbench in significantly more tables than it is better than they."""
    ours, better = scores["workbench"], []
    for name, score in scores.items():
        for more, less in ((score.right, ours.right), (ours.false, score.false)):
            difference = np.asarray(more, dtype=float) - np.asarray(less, dtype=float)
            for_it, for_us = int((difference > 0.0).sum()), int((difference < 0.0).sum())
            # Exact: they differ in few tables, of which an interval by the normal law is too narrow.
            if for_it > for_us and binomtest(for_it, for_it + for_us).pvalue < SIGNIFICANT:
                better.append(name)
    return better


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--tables", type=int, default=90)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    print(conditions())
    terms = {
        "workbench": workbench,
        "stepwise BIC": stepwise_bic,
        "lasso, stability selection": stable_lasso,
        "symbolic regression": symbolic,
    }
    ends = [
        ("terms", contest(terms_table, terms, asked.tables)),
        ("a period", contest(period_table, {"workbench": workbench, "Lomb-Scargle": lomb_scargle}, asked.tables)),
    ]
    for title, scores in ends:
        print_scores(title, scores)
    better = [name for _, scores in ends for name in beaten(scores)]
    print(f"better than the workbench: {', '.join(better) or 'none'}")
    return 1 if better else 0


if __name__ == "__main__":
    sys.exit(main())
