"""Scatter that changes along something is said, with its size; so is how stated uncertainties fail; and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.report.verdicts import noise_sentence, scatter_sentences, stated_sentence
from rigctl.workbench.findings import Comparison
from rigctl.workbench.scatter import LEVEL, StatedSigma
from rigctl.workbench.verdict.account import Account, account_of
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.compare import compared
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fitted as fit_of
from rigctl.workbench.verdict.stated_sigma import stated_sigma
from rigctl.workbench.verdict.uneven_scatter import uneven_scatter

ROWS = 80


def study(columns: Mapping[str, Any], **spec: Any) -> TableStudy:
    numbers = {name: np.asarray(v, dtype=float) for name, v in columns.items() if not isinstance(v[0], str)}
    texts = {name: list(map(str, v)) for name, v in columns.items() if isinstance(v[0], str)}
    header = Header(
        "table", extra={"table": {"response": "y_v", "baseline": "b0 + b1 * load_n", "start": {}, **spec}}
    )
    record = RunRecord(READINGS, READINGS, "import", texts)
    return TableStudy(Recording(header, (record,), {READINGS: numbers}, ImportReport(1)))


def table(seed: int, law: str, noise: str = "normal", rows: int = ROWS) -> dict[str, Any]:
    """Readings over a load and a temperature that is nobody's business, their sigma by a law of `law`."""
    random = np.random.default_rng([seed, 11])
    load_n, temperature_c = random.uniform(0.0, 10.0, rows), random.normal(22.0, 1.5, rows)
    operator = np.where(random.random(rows) < 0.5, "A", "B")
    sigma = {
        "even": np.full(rows, 0.1),
        "load": 0.03 * np.exp(0.2 * load_n),
        "temperature": 0.1 * np.exp(0.4 * (temperature_c - 22.0)),
        "operator": np.where(operator == "B", 0.3, 0.1),
    }[law]
    drawn = random.standard_t(3, rows) if noise == "t3" else random.standard_normal(rows)
    return {
        "y_v": 1.0 - 0.5 * load_n + sigma * drawn,
        "load_n": load_n,
        "temperature_c": temperature_c,
        "humidity_percent": random.uniform(30.0, 60.0, rows),
        "operator": operator.tolist(),
    }


def fitted(columns: Mapping[str, Any], **spec: Any) -> Attempt:
    return Attempt(study(columns, **spec), ())


@pytest.mark.parametrize("noise", ["normal", "t3"])
def test_even_scatter_is_not_said_to_change(noise: str) -> None:
    """At 5 % over all conditions together: of 50 tables more than 6 in one of a hundred such tests."""
    assert sum(bool(uneven_scatter(fitted(table(seed, "even", noise)), 0.05)) for seed in range(50)) <= 6


@pytest.mark.parametrize(
    ("law", "along"), [("load", LEVEL), ("temperature", "temperature_c"), ("operator", "operator")]
)
def test_what_the_scatter_goes_along_is_said_with_its_size(law: str, along: str) -> None:
    found = [uneven_scatter(fitted(table(seed, law)), 0.01) for seed in range(20)]
    right = [each[0] for each in found if each and each[0].along == along]
    assert len(right) >= 19
    assert sum(len(each) > 1 for each in found) <= 2
    if law == "operator":
        ratios = np.array([each.by_word["B"] / each.by_word["A"] for each in right])
        assert np.mean(ratios) == pytest.approx(3.0, rel=0.1)
        return
    pulls = []
    for each in right:
        assert each.low is not None
        assert each.high is not None
        assert each.ratio is not None
        assert each.ratio[0] == pytest.approx(each.high[1] / each.low[1])
        # Along the level, which falls with the load, it is the other way round.
        true = -0.2 * (each.high[0] - each.low[0]) / 0.5 if law == "load" else 0.4 * (each.high[0] - each.low[0])
        pulls.append((np.log(each.ratio[0]) - true) * each.ratio[0] / each.ratio[1])
    assert abs(np.mean(pulls)) < 3.0 / np.sqrt(len(pulls))
    assert 0.5 < np.std(pulls) < 1.6


def test_conditions_in_one_order_are_one_question() -> None:
    (found, *_) = uneven_scatter(fitted(table(2, "load")), 0.01)
    assert (found.along, found.same_as) == (LEVEL, ("load_n",))


def test_an_effect_that_is_found_is_no_scatter() -> None:
    """The scatter is that of the model with all that a search finds, whichever version is compared."""
    columns = table(3, "even")
    columns["operator"] = np.where(np.arange(ROWS) % 7, "A", "B").tolist()
    columns["y_v"] = columns["y_v"] + (np.asarray(columns["operator"]) == "B")
    curved = study(columns)
    account = account_of(curved, [()])
    assert account.richest.terms
    assert uneven_scatter(Attempt(curved, ()), 0.05)
    assert not compared(account.attempt(curved, ()), account, 1).scatter


def stated(seed: int, kind: str, rows: int = ROWS) -> StatedSigma | None:
    """What is said of stated uncertainties that range over a factor of eight."""
    random = np.random.default_rng([seed, 12])
    columns = table(seed, "even", rows=rows)
    u_v = np.exp(random.uniform(np.log(0.03), np.log(0.24), rows))
    true: FloatArray = {
        "right": u_v,
        "doubled": 2.0 * u_v,
        "halved": 0.5 * u_v,
        "jitter": np.hypot(u_v, 0.15),
        "equal": np.full(rows, 0.2),
    }[kind]
    u_v = np.full(rows, 0.1) if kind == "equal" else u_v
    columns["y_v"] = 1.0 - 0.5 * np.asarray(columns["load_n"]) + true * random.standard_normal(rows)
    columns["u_v"] = u_v
    return stated_sigma(fitted(columns, sigma="u_v"))


def test_stated_uncertainties_that_hold_are_not_questioned() -> None:
    assert sum(stated(seed, "right") is not None for seed in range(100)) <= 4  # 1 % each


def test_a_factor_is_told_from_something_added() -> None:
    factors = [stated(seed, "doubled") for seed in range(20)]
    added = [stated(seed, "jitter") for seed in range(20)]
    assert sum(each is not None and each.likelier == "factor" for each in factors) >= 18
    assert sum(each is not None and each.likelier == "added" for each in added) >= 18
    assert not any(each is not None and each.likelier == "added" for each in factors)
    assert not any(each is not None and each.likelier == "factor" for each in added)
    sizes = [(each.factor[0] - 2.0) / each.factor[1] for each in factors if each is not None]
    assert abs(np.mean(sizes)) < 3.0 / np.sqrt(len(sizes))
    sizes = [(each.added[0] - 0.15) / each.added[1] for each in added if each is not None and each.added is not None]
    assert abs(np.mean(sizes)) < 3.0 / np.sqrt(len(sizes))
    assert 0.6 < np.std(sizes) < 1.5


def test_uncertainties_that_are_all_the_same_do_not_tell_a_factor_from_an_addition() -> None:
    either = stated(1, "equal")
    assert either is not None
    assert either.likelier is None
    assert either.added is not None
    assert either.added[0] == pytest.approx(0.1 * np.sqrt(either.factor[0] ** 2 - 1.0), rel=1e-3)


def test_nothing_is_added_where_the_scatter_is_smaller_than_stated() -> None:
    found = stated(1, "halved")
    assert found is not None
    assert (found.added, found.likelier) == (None, "factor")
    assert found.factor[0] == pytest.approx(0.5, abs=4.0 * found.factor[1])


def few(scatter_c: float, u_c: float) -> Account:
    """Six readings of an indication, their uncertainties stated, about a line by a pattern of this size."""
    x = np.arange(0.0, 60.0, 10.0)
    pattern = np.array([0.1, 0.0, 2.0, -1.0, 1.0, 0.0])
    columns = {"y_v": x + scatter_c * pattern, "load_n": x, "u_v": np.full(6, u_c)}
    return account_of(study(columns, sigma="u_v"), [()])


def told(account: Account) -> list[dict[str, Any]]:
    """What compare, diagnose and fit say of it, as JSON."""
    made = account.attempt(account.richest.study, ())
    return [
        compared(made, account, 1).as_json(),
        diagnose(account.richest.study, (), account=account).as_json(),
        fit_of(made, account).as_json(),
    ]


@pytest.mark.parametrize(("scatter_c", "u_c"), [(0.01, 0.5), (0.2, 0.0005)])
def test_of_few_readings_stated_uncertainties_stay_and_what_contradicts_them_is_said(
    scatter_c: float, u_c: float
) -> None:
    for said in told(few(scatter_c, u_c)):
        (noise,) = said["noise"]
        assert (noise["sigma"], noise["scale"], noise["dof"]) == (u_c, 1.0, np.inf)
        assert "as stated; below 20 degrees of freedom" in noise_sentence(said)
        assert stated_sentence(said).startswith("Stated uncertainties do not fit the scatter")


def test_beside_offsets_scatter_is_told_of_what_is_a_readings_own() -> None:
    """Readings of ten lots, whose offsets are ten times as large as their own scatter."""
    columns, lots = table(1, "load"), np.arange(ROWS) % 10
    shared = np.random.default_rng(12).normal(0.0, 1.0, 10)[lots]
    of_lots = {**columns, "y_v": columns["y_v"] + shared, "lot": [f"lot {lot}" for lot in lots]}
    (found,), (alone,) = (uneven_scatter(fitted(each), 0.01) for each in (of_lots, columns))
    assert found.along == alone.along == LEVEL
    for end, without in ((found.low, alone.low), (found.high, alone.high)):
        assert end is not None
        assert without is not None
        assert abs(np.log(end[1] / without[1])) < 1.0


def test_what_an_effect_explains_is_no_fault_of_few_stated_uncertainties() -> None:
    """Twelve readings about a curve, as well as is stated."""
    x = np.linspace(0.0, 60.0, 12)
    noise = 0.1 * np.random.default_rng(1).standard_normal(12)
    account = account_of(
        study({"y_v": x + 0.01 * x**2 + noise, "load_n": x, "u_v": np.full(12, 0.1)}, sigma="u_v"), [()]
    )
    compare, diagnosis, fit = told(account)
    assert diagnosis["suggested"] == ["power2[load_n]"]
    # One account: of the version that lacks it compare and fit say what the diagnosis does.
    assert [said["stated_sigma"] for said in (compare, diagnosis, fit)] == [None] * 3


def test_of_few_readings_chi_square_and_uncertainties_are_those_of_what_is_stated() -> None:
    compare, diagnosis, fit = told(few(0.01, 0.5))
    assert fit["parameters"]["b0"]["sigma"] == pytest.approx(0.5 * np.sqrt(11.0 / 21.0))
    assert fit["chi2_per_dof"] < 0.01
    assert (compare["p_value"], diagnosis["verdict"]) == (1.0, "adequate")
    compare, diagnosis, fit = told(few(0.2, 0.0005))
    assert compare["chi2_per_dof"] > 1e4
    assert compare["p_value"] == fit["p_value"] < 1e-6
    assert diagnosis["verdict"] != "adequate"


def test_few_readings_that_scatter_as_stated_are_not_questioned() -> None:
    found = [stated(seed, "right", rows=12) for seed in range(200)]
    assert sum(each is not None for each in found) <= 7  # 1 % each


def test_few_readings_say_nothing_of_where_they_scatter() -> None:
    assert uneven_scatter(fitted(table(1, "load", rows=20)), 0.05) == ()


def test_it_is_said_in_a_sentence_with_weights() -> None:
    columns = study(table(4, "load"))
    account = account_of(columns, [()])
    comparison: Comparison = compared(account.attempt(columns, ()), account, 1)
    said = scatter_sentences(comparison.as_json())
    assert said[0].startswith("The scatter falls along the fitted level (as along load_n): from ")
    assert " * exp(" in said[0]
    assert "[table] sigma" in said[1]
    assert scatter_sentences({"scatter": [], "stated_sigma": None}) == []
