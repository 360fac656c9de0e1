"""What the catalogue of a table promises: forms, parameters by words, time stamps, stated uncertainties."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.readings import pasted_rows, seconds_of_stamps
from rigctl.experiments.table.candidates import Derivatives
from rigctl.experiments.table.model.forms import Power
from rigctl.experiments.table.model.model import fitted
from rigctl.experiments.table.model.scanned import Periodic
from rigctl.experiments.table.observe.readings import Column
from rigctl.experiments.table.spanned import Spanned
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit

ROWS = 60
RNG = np.random.default_rng(11)
X = RNG.uniform(0.5, 10.0, ROWS)
Z = RNG.uniform(-1.0, 1.0, ROWS)
NOISE = RNG.standard_normal(ROWS)
HEAD = np.where(RNG.random(ROWS) < 0.5, "A", "B")
WAITS = RNG.uniform(0.0, 1.0, ROWS)


def study(columns: Mapping[str, Any], baseline: str, **spec: Any) -> TableStudy:
    numbers = {name: np.asarray(v, dtype=float) for name, v in columns.items() if not isinstance(v[0], str)}
    texts = {name: list(map(str, v)) for name, v in columns.items() if isinstance(v[0], str)}
    header = Header("table", extra={"table": {"response": "y", "baseline": baseline, "start": {}, **spec}})
    record = RunRecord(READINGS, READINGS, "import", texts)
    return TableStudy(Recording(header, (record,), {READINGS: numbers}, ImportReport(1)))


def named(found: Diagnosis) -> list[str]:
    return [term.effect for term in found.suggested]


MADE: dict[str, tuple[str, FloatArray, dict[str, float]]] = {
    "sqrt[x]": ("b0 + b1 * x", np.sqrt(X), {"sqrt[x]": 1.0}),
    "log[x]": ("b0 + b1 * x", np.log(X), {"log[x]": 1.0}),
    "turning[x]": ("b0", 0.2 * (X - 5.2) ** 2, {"turning[x].curvature": 0.2}),
    "power2[x]": ("b0 + b1 * x", 0.2 * (X - 5.2) ** 2, {"power2[x]": 0.2}),
    "slope[x by head]": ("b0 + b1 * x", 0.1 * X * (HEAD == "B"), {"slope[x by head].B-A": 0.1}),
    "interaction[x,z]": ("b0", 0.3 * (X - X.mean()) * (Z - Z.mean()), {"interaction[x,z]": 0.3}),
    "group[k by head]": ("a * exp(-k * x)", 0.0 * X, {"group[k by head].B-A": 0.1}),
}


def test_a_zero_that_was_never_set_is_called_an_offset() -> None:
    x = np.arange(0.0, 12.0, 0.5)
    y = 2.0 + 3.0 * x + 0.05 * np.random.default_rng(5).standard_normal(24)
    found = diagnose(study({"x": x, "y": y}, "b1 * x"), [])
    assert (found.verdict, named(found)) == ("effect", ["offset"])
    size = found.ranking[0].parameters["offset"]
    assert abs(size.value - 2.0) < 4.0 * size.sigma < 0.2


def test_the_offset_of_nist_s_no_intercept_data_is_found_and_sized() -> None:
    """NoInt1 of the Statistical Reference Datasets: y = x + 70 to the last digit."""
    x = np.arange(60.0, 71.0)
    data = study({"x": x, "y": x + 70.0}, "b1 * x")
    found = diagnose(data, [])
    assert "offset" in {named(found)[0], *found.ranking[0].equivalent_to}
    assert named(found) == ["offset"]
    fitted_to = fit(data, found.suggested)
    assert fitted_to.parameters["offset"].value == pytest.approx(70.0, rel=1e-9)
    assert fitted_to.parameters["b1"].value == pytest.approx(1.0, rel=1e-9)
    assert diagnose(data, found.suggested).verdict == "adequate"


def test_a_model_with_a_constant_is_not_asked_about_an_offset() -> None:
    columns = {"x": X, "y": 1.0 + X + 0.1 * NOISE, "head": HEAD}
    assert "offset" not in study(columns, "b0 + b1 * x").effects()
    assert "offset" not in study(columns, "(b0 + b1 * x) / b2", start={"b0": 1.0, "b1": 1.0, "b2": 1.0}).effects()
    without = study(columns, "b1 * x")
    assert "offset" in without.effects()
    found = diagnose(without, [Term("level[head]")])
    assert found.not_testable["offset"] == "the model has a constant already"


def test_an_offset_is_not_taken_for_the_scatter_of_batches() -> None:
    random, lots = np.random.default_rng(6), np.repeat(np.arange(8), 5)
    x = random.uniform(0.0, 10.0, 40)
    y = 2.0 + 3.0 * x + 0.1 * random.standard_normal(8)[lots] + 0.05 * random.standard_normal(40)
    found = diagnose(study({"x": x, "y": y, "lot": [f"L{lot}" for lot in lots]}, "b1 * x"), [])
    assert named(found) == ["offset"]


def test_one_effect_is_asked_about_as_all_are() -> None:
    beside = study({"y": 1.0 + 0.02 * NOISE, "x": X, "z": Z, "head": HEAD.tolist()}, "b0 + b1 * x")
    model = beside.model([Term("periodic[z]", {"period": 0.7, "origin": 0.0}), Term("level[head]")])
    values = np.array([each.start for each in model.parameters])
    every = beside.candidates(model, values)[0]
    for effect in (*beside.effects(), "periodic[z]#2"):
        one = [each for group in beside.groups_of(model, values, effect) for each in group]
        assert [each.term for each in one] == [each.term for each in every if each.term.effect == effect]
        for mine, others in zip(one, (each for each in every if each.term.effect == effect), strict=True):
            np.testing.assert_array_equal(mine.derivative, others.derivative)
            np.testing.assert_array_equal(mine.typical, others.typical)
    assert {each.term.effect for each in every} >= {"turning[z]", "periodic[z]#2", "slope[x by head]"}


@pytest.mark.parametrize("effect", MADE)
def test_an_effect_of_a_table_is_named_and_sized(effect: str) -> None:
    baseline, added, expected = MADE[effect]
    rate = 0.2 + 0.1 * (HEAD == "B")
    base = 3.0 * np.exp(-rate * X) if "exp" in baseline else 1.0 + (0.5 * X if "b1" in baseline else 0.0)
    columns = {"y": base + added + 0.02 * NOISE, "x": X, "z": Z, "head": HEAD.tolist()}
    found = diagnose(study(columns, baseline), ())
    assert named(found) == [effect]
    sizes = found.ranking[0].parameters
    for name, size in expected.items():
        assert abs(sizes[name].value - size) < 4.0 * sizes[name].sigma


@pytest.mark.parametrize("effect", [*MADE, "group[b by head]"])
def test_derivatives_are_those_of_values(effect: str) -> None:
    baseline = "a * exp(-k * x)" if "group[k" in effect else "a + b * z**2"
    table = study({"y": 3.0 * np.exp(-0.2 * X) + Z**2, "x": X, "z": Z, "head": HEAD.tolist()}, baseline)
    model = table.model([Term(effect), Term("periodic[z]")])
    values = np.array([each.start for each in model.parameters]) + 0.01
    slopes = model.jacobian(values)
    for place in range(len(values)):
        step = np.zeros(len(values))
        step[place] = 1e-6
        change = (model.predict(values + step) - model.predict(values - step)) / 2e-6
        assert slopes[:, place] == pytest.approx(change, rel=1e-5, abs=1e-5 * np.abs(change).max())


def test_what_has_another_name_beside_a_slope_says_so() -> None:
    table = study({"y": X + NOISE, "x": X, "z": Z}, "b0 + b1 * x")
    _, refused = table.candidates(table.model([]), np.array([0.0, 1.0]))
    reasons = {each.effect: each.reason for each in refused}
    assert reasons["turning[x]"] == "the model has a slope in x already, beside which it is power2[x]"
    assert reasons["log[z]"].startswith("z is zero or negative in ")
    assert reasons["sqrt[z]"].startswith("z is negative in ")
    assert "turning[z]" not in reasons


@pytest.mark.parametrize("seed", range(8))
def test_beside_the_square_of_a_column_a_turning_point_is_what_it_adds(seed: int) -> None:
    """And not what the rounding of a function that is spanned already goes along."""
    x = np.random.default_rng(seed).uniform(1.0, 10.0, ROWS)
    columns = {"y": 3.0 + 0.1 * x**2 + 0.02 * NOISE, "x": x}
    beside_constant = study(columns, "b0")
    _, refused = beside_constant.candidates(beside_constant.model([Term("power2[x]")]), np.array([3.0, 0.1]))
    reasons = {each.effect: each.reason for each in refused}
    assert reasons["turning[x]"] == "the model has the square of x already, beside which it is linear[x]"
    # Without a constant, which is all that a turning point adds to slope and square, and has no name of its own.
    through_zero = study({"y": 0.5 * x + 0.1 * x**2 + 0.02 * NOISE, "x": x}, "b1 * x")
    asked, _ = through_zero.candidates(through_zero.model([Term("power2[x]")]), np.array([0.5, 0.1]))
    assert "turning[x]" in {each.term.effect for each in asked}


def test_smooth_functions_of_a_column_are_one_family_and_each_scan_is_its_own() -> None:
    columns = {"y": NOISE, "x": X, "z": Z, "t_s": np.arange(ROWS), "head": HEAD.tolist()}
    ordered = study(columns, "b0", order="t_s")
    families: dict[str, set[str]] = {}
    for effect in (*ordered.effects(), "periodic[x]#2"):
        families.setdefault(ordered.family(effect), set()).add(effect.partition("[")[0])
    smooth = {"linear", "power2", "power3", "turning", "inverse", "sqrt", "log"}
    assert families["smooth[x]"] == smooth
    assert families["smooth[t_s]"] == {*smooth, "drift"}
    assert ordered.family("periodic[x]#2") == ordered.family("periodic[x]") != ordered.family("periodic[z]")
    assert ordered.family("interaction[x,z]") == ordered.family("interaction[x,t_s]")
    assert ordered.family("level[head]") == ordered.family("slope[x by head]")


def test_a_long_scan_costs_a_line_little() -> None:
    """A line of 5.3 sigma in one of six columns: one of hundreds of trials, but of few families."""
    rng = np.random.default_rng(5)
    columns = {f"x{number}": rng.uniform(0.0, 10.0, ROWS) for number in range(6)}
    away = columns["x0"] - columns["x0"].mean()
    fitted = np.linalg.qr(np.stack([np.ones(ROWS), away], axis=1))[0]
    noise = NOISE - fitted @ (fitted.T @ NOISE)
    line = 5.3 * float(np.sqrt(noise @ noise / (ROWS - 2))) * away / np.linalg.norm(away)
    found = diagnose(study({"y": 1.0 + line + noise, **columns}, "b0"), ())
    assert {each.split("[")[1] for each in named(found)} == {"x0]"}


def test_what_is_scanned_for_costs_as_a_parameter_does() -> None:
    attempt = Attempt(study({"y": NOISE, "x": X}, "b0"), ())
    half = 0.5 * np.log(ROWS)
    for effect, parameters in {"linear[x]": 1, "step[x]": 2, "exponential[x]": 2, "periodic[x]": 3}.items():
        scored = attempt.scored_effect(effect)
        assert scored is not None
        choices = sum(each.term.effect == effect for each in attempt.candidates)
        assert attempt.price(scored) == pytest.approx(parameters * half + np.log(choices))
        assert (choices > 1) == (scored.candidate.scanned == 1)


def test_puromycin_s_velocity_differs_by_state() -> None:
    """Treloar 1974, in R's `Puromycin`: published with a further Vmax for the untreated (Bates and Watts 1988)."""
    conc = np.repeat([0.02, 0.06, 0.11, 0.22, 0.56, 1.10], 4)[:-1]
    treated = [76, 47, 97, 107, 123, 139, 159, 152, 191, 201, 207, 200]
    untreated = [67, 51, 84, 86, 98, 115, 131, 124, 144, 158, 160]
    state = ["treated", "treated", "untreated", "untreated"] * 6
    rates = iter(treated), iter(untreated)
    rate = [next(rates[word == "untreated"]) for word in state[:-1]]
    table = study({"y": rate, "conc": conc, "state": state[:-1]}, "vm * conc / (km + conc)")
    found = diagnose(table, ())
    assert named(found) == ["group[vm by state]"]
    size = found.ranking[0].parameters["group[vm by state].untreated-treated"]
    assert abs(size.value - -42.03) < 0.1
    minimum = fitted(table.model(found.suggested))
    assert minimum is not None
    assert minimum.value("vm") == pytest.approx(208.63, abs=0.01)
    assert minimum.value("km") == pytest.approx(0.0579, abs=1e-4)


ECKERLE4_NM = (
    *(400, 405, 410, 415, 420, 425, 430, 435, 436.5, 438, 439.5, 441, 442.5, 444, 445.5, 447, 448.5, 450, 451.5, 453),
    *(454.5, 456, 457.5, 459, 460.5, 462, 463.5, 465, 470, 475, 480, 485, 490, 495, 500),
)
ECKERLE4 = (
    *(0.0001575, 0.0001699, 0.0002350, 0.0003102, 0.0004917, 0.0008710, 0.0017418, 0.0046400, 0.0065895, 0.0097302),
    *(0.0149002, 0.0237310, 0.0401683, 0.0712559, 0.1264458, 0.2073413, 0.2902366, 0.3445623, 0.3698049, 0.3668534),
    *(0.3106727, 0.2078154, 0.1164354, 0.0616764, 0.0337200, 0.0194023, 0.0117831, 0.0074357, 0.0022732, 0.0008800),
    *(0.0004579, 0.0002345, 0.0001586, 0.0001143, 0.0000710),
)


@pytest.mark.parametrize("start", [(1.0, 10.0, 500.0), (1.5, 5.0, 450.0)])
def test_a_narrow_peak_is_fitted_from_its_start(start: tuple[float, float, float]) -> None:
    """NIST's Eckerle4, both certified starts: at modest values of its parameters the peak is zero everywhere."""
    table = study(
        {"y": ECKERLE4, "x": ECKERLE4_NM},
        "(b1 / b2) * exp(-0.5 * ((x - b3) / b2)**2)",
        start=dict(zip(("b1", "b2", "b3"), start, strict=True)),
    )
    certified = [1.5543827178, 4.0888321754, 451.54121844]
    assert [each.start for each in table.model([]).parameters] == pytest.approx(certified, rel=1e-7)
    assert named(diagnose(table, ())) == []


MGH10 = (
    *(34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0, 6005.0, 5147.0, 4427.0),
    *(3820.0, 3307.0, 2872.0),
)
MGH17 = (
    *(0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658, 0.628, 0.603),
    *(0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411),
    *(0.406,),
)


@pytest.mark.parametrize(
    ("y", "x", "baseline", "start", "certified"),
    [
        (
            MGH10,
            50.0 + 5.0 * np.arange(16.0),
            "b1 * exp(b2 / (x + b3))",
            (2.0, 4e5, 25e3),
            (5.6096364710e-3, 6.1813463463e3, 3.4522363462e2),
        ),
        (
            MGH17,
            10.0 * np.arange(33.0),
            "b1 + b2 * exp(-b4 * x) + b3 * exp(-b5 * x)",
            (50.0, 150.0, 1.0, -100.0, 2.0),
            (3.7541005211e-1, 1.9358469127, 1.2867534640e-2, -1.4646871366, 2.2122699662e-2),
        ),
    ],
    ids=["mgh10", "mgh17"],
)
def test_a_start_far_off_in_a_narrow_valley_leads_to_its_end(
    y: Any, x: Any, baseline: str, start: tuple[float, ...], certified: tuple[float, ...]
) -> None:
    """NIST's MGH10 and MGH17 from their first certified starts: one ended far off unsaid, one was refused."""
    names = sorted(dict.fromkeys(re.findall(r"b\d", baseline)), key=baseline.index)
    table = study({"y": y, "x": x}, baseline, start=dict(zip(names, start, strict=True)))
    assert [each.start for each in table.model([]).parameters] == pytest.approx(certified, rel=1e-7)


def test_time_stamps_are_seconds_from_the_earliest() -> None:
    texts = ["2024-05-01T12:00:10Z", "2024-05-01T14:00:00+02:00", "", "2024-05-01 12:01:00"]
    seconds = seconds_of_stamps(texts)
    assert seconds is not None
    assert seconds.tolist()[:2] == [10.0, 0.0]
    assert np.isnan(seconds[2])
    assert seconds[3] == 60.0
    assert seconds_of_stamps(["2024-05-01", "Monday"]) is None
    assert seconds_of_stamps(["", ""]) is None


def test_a_column_of_time_stamps_keeps_its_name_and_may_be_the_order() -> None:
    days = [f"2024-05-{1 + day // 4:02d}T{6 * (day % 4):02d}:00:00" for day in range(ROWS)]
    seconds = 21600.0 * np.arange(ROWS)
    table = study({"y": 1e-6 * seconds + 0.01 * NOISE, "when": days}, "b0", order="when")
    assert table.observations.covariates["when"] == pytest.approx(seconds)
    found, _ = table.candidates(table.model([]), np.zeros(1))
    assert {each.term.effect: each.units for each in found}["linear[when]"] == ("",)
    assert table.data.readings.columns["when"].unit == "s"


def test_stated_uncertainties_weigh() -> None:
    stated = np.where(np.arange(ROWS) % 2, 0.01, 1.0)
    table = study({"y": 1.0 + stated * NOISE, "x": X, "e": stated}, "b0", sigma="e")
    rows = [int(label.removeprefix("row ")) - 1 for label in table.observations.run_ids]
    assert table.observations.sigma.tolist() == stated[rows].tolist()
    assert set(table.observations.covariates) == {"x"}
    assert table.model([]).parameters[0].start == pytest.approx(1.0, abs=4 * 0.01 / np.sqrt(ROWS / 2))
    with pytest.raises(DataError, match="row 3: column e holds 0, which is no standard uncertainty"):
        study({"y": NOISE, "x": X, "e": np.where(np.arange(ROWS) == 2, 0.0, 1.0)}, "b0", sigma="e")
    with pytest.raises(DataError, match="no column f of numbers, which \\[table\\] sigma names"):
        study({"y": NOISE, "x": X}, "b0", sigma="f")


def test_a_table_without_columns_of_numbers_is_one_of_levels() -> None:
    """R's `Rail`: a constant, and words only."""
    travel = [55, 53, 54, 26, 37, 32, 78, 91, 85, 92, 100, 96, 49, 51, 50, 80, 85, 83]
    table = study({"y": travel, "rail": [f"rail {i // 3}" for i in range(18)]}, "b0")
    assert table.model([]).predict(np.array([66.5])).tolist() == [66.5] * 18
    assert sorted(table.observations.value.tolist()) == sorted(travel)


def test_a_slow_period_does_not_become_the_trend_and_stop_the_diagnosis() -> None:
    """As of CO2 at Mauna Loa: a year, its half, and slow structure beside a quadratic trend."""
    year = 1958.0 + np.arange(240) / 12.0
    rng = np.random.default_rng(4)
    slow = np.cumsum(0.12 * rng.standard_normal(240))
    y = 315.0 + 1.3 * (year - 1958.0) + 2.8 * np.cos(2 * np.pi * year) + 0.8 * np.sin(4 * np.pi * year)
    table = study({"y": y + slow + 0.2 * rng.standard_normal(240), "year": year}, "b0 + b1 * (year - 1968)")
    terms = [Term("periodic[year]"), Term("periodic[year]#2", {"period": 39.0, "origin": 1968.0})]
    minimum = fitted(table.model(terms))
    assert minimum is not None
    assert minimum.value("periodic[year]#2.period") <= 2.0 * np.ptp(year)
    found = diagnose(table, ())
    periods = [rank.parameters.get(f"{rank.term.effect}.period") for rank in found.ranking[: len(found.suggested)]]
    (year_term,) = [
        term
        for term, each in zip(found.ranking, periods, strict=False)
        if each is not None and round(each.value, 2) == 1.0
    ]
    assert year_term.parameters[f"{year_term.term.effect}.sin2"].value == pytest.approx(0.8, abs=0.1)


def test_rows_that_were_pasted_count_once_and_repeats_stay() -> None:
    y = np.round(1.0 + 0.5 * X + 0.02 * NOISE, 6)
    twice = np.r_[0:ROWS, 10:30]
    copies, originals = pasted_rows(y[twice], [X[twice].tolist()])
    assert copies.tolist() == list(range(ROWS, ROWS + 20))
    assert originals.tolist() == list(range(10, 30))
    table = study({"y": y[twice], "x": X[twice]}, "b0 + b1 * x")
    assert len(table.observations.value) == ROWS
    coarse = np.round(y[twice] * 5.0) / 5.0
    repeated = np.round(X[twice]).tolist()
    assert len(pasted_rows(coarse, [repeated])[0]) == 0


def test_a_verdict_does_not_depend_on_the_order_of_rows() -> None:
    columns = {"y": 1.0 + 0.5 * X + 0.1 * NOISE, "x": X, "z": Z, "head": HEAD.tolist()}
    shuffled = np.random.default_rng(3).permutation(ROWS)
    again = {name: np.asarray(values)[shuffled].tolist() for name, values in columns.items()}
    one, other = (diagnose(study(each, "b0 + b1 * x"), ()) for each in (columns, again))
    assert [rank.p_value_corrected for rank in one.ranking] == [rank.p_value_corrected for rank in other.ranking]


def test_readings_of_a_batch_share_an_offset() -> None:
    """R's `Rail`, and Snedecor's wafers: published standard deviations, by restricted maximum likelihood."""
    travel = [55, 53, 54, 26, 37, 32, 78, 91, 85, 92, 100, 96, 49, 51, 50, 80, 85, 83]
    table = study({"y": travel, "rail": [f"rail {i // 3}" for i in range(18)]}, "b0")
    found = diagnose(table, ())
    assert named(found) == []
    assert "share an offset" in found.not_testable["level[rail]"]
    (offset,) = table.observations.offsets
    ratio = offset.share / np.sqrt(1.0 - offset.share**2)
    assert ratio == pytest.approx(24.805 / 4.0208, rel=1e-3)


def test_an_effect_that_varies_between_batches_only_is_judged_by_the_batches() -> None:
    """Twelve batches of five readings with conditions of their own: independent readings would show an effect."""
    names = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        batch = np.repeat(np.arange(12), 5)
        humidity = rng.uniform(30.0, 60.0, 12)[batch]
        y = rng.normal(0.0, 0.3, 12)[batch] + rng.normal(0.0, 0.1, 60)
        columns = {"y": y, "humidity": humidity, "lot": [f"L{each:02d}" for each in batch]}
        names += bool(named(diagnose(study(columns, "b0"), ())))
    assert names == 0


def test_numbers_of_many_digits_name_batches_apart() -> None:
    day = np.repeat(np.arange(20240115.0, 20240121.0), 3)
    table = study({"y": np.arange(18.0) % 5, "day": day}, "b0", batch=["day"])
    assert table.data.readings.categories["day"].levels == tuple(str(20240115 + i) for i in range(6))


def test_a_square_far_from_zero_is_fitted() -> None:
    """R's `women`: heights from 58 to 72 in, whose square is a line but for a two-hundredth."""
    height = np.arange(58.0, 73.0)
    weight = [115, 117, 120, 123, 126, 129, 132, 135, 139, 142, 146, 150, 154, 159, 164]
    square = fit(study({"y": weight, "height": height}, "b0 + b1 * height"), [Term("power2[height]")])
    assert square.parameters["power2[height]"].value == pytest.approx(0.08306, abs=1e-5)
    year = np.linspace(1950.0, 2020.0, ROWS)
    bent = study({"y": 1e-3 * (year - 1980.0) ** 2 + 0.1 * NOISE, "year": year}, "b0 + b1 * year")
    assert "power2[year]" in named(diagnose(bent, ()))


def ordered(zero: float, baseline: str) -> TableStudy:
    """Readings along a clock that was set to `zero` at the first of them, which words go with."""
    after = np.cumsum(1.0 + np.round(3.0 * WAITS, 3))
    y = 2.0 * ("b0" in baseline) + 0.5 * X + 2e-5 * after * X + 0.05 * NOISE
    columns = {"y": y, "x": X, "t_s": zero + after, "head": HEAD.tolist()}
    return study(columns, baseline, order="t_s")


@pytest.mark.parametrize("baseline", ["b0 + b1 * x", "b1 * x"])
def test_what_is_found_does_not_depend_on_where_a_clock_was_set_to_zero(baseline: str) -> None:
    here, later = (diagnose(ordered(zero, baseline), ()) for zero in (0.0, 5000.0))
    assert here.verdict == later.verdict
    assert named(here) == named(later)
    ones, others = ({rank.term.effect: rank.p_value for rank in found.ranking} for found in (here, later))
    assert ones.keys() == others.keys() >= {"drift", "power3[t_s]", "interaction[x,t_s]", "slope[t_s by head]"}
    for effect, p_value in ones.items():
        assert others[effect] == pytest.approx(p_value, rel=1e-6), effect
    for kind in ("log", "sqrt", "inverse"):
        assert here.not_testable[f"{kind}[t_s]"].startswith("t_s tells when, and its zero means nothing")
        assert f"{kind}[x]" in ones


def test_powers_of_a_clock_begin_with_the_first_reading_where_that_makes_a_difference() -> None:
    table = ordered(5000.0, "b0 + b1 * x")
    first = float(table.data.readings.columns["t_s"].distinct[0])
    for terms, origin in ((["power2[t_s]"], first), (["drift", "power2[t_s]"], None)):
        model = table.model([Term(effect) for effect in terms])
        assert dict(model.terms[-1].choice).get("origin") == origin
    # What is asked for by name is fitted: who asks knows what the zero is.
    assert table.model([Term("log[t_s]")]).terms


def test_time_stamps_have_no_zero_either() -> None:
    stamps = [f"2024-05-{1 + number % 28:02d}T{number // 28:02d}:00:00Z" for number in range(ROWS)]
    table = study({"y": X + NOISE, "x": X, "when": stamps}, "b0 + b1 * x")
    _, refused = table.candidates(table.model([]), np.array([0.0, 1.0]))
    assert {"log[when]", "sqrt[when]", "inverse[when]"} <= {each.effect for each in refused}


def test_a_wave_that_is_no_sine_is_one_period_with_harmonics() -> None:
    """Every reading of a wave with a fundamental, a third harmonic and a smaller second."""
    t = np.sort(np.random.default_rng(5).uniform(0.0, 30.0, 120))
    phase = 2.0 * np.pi * t / 4.3
    true = {"cos": 1.0, "sin2": 0.3, "cos3": 0.5}
    hidden = np.cos(phase) + 0.3 * np.sin(2.0 * phase) + 0.5 * np.cos(3.0 * phase)
    for seed in range(4):
        noise = 0.1 * np.random.default_rng(seed).standard_normal(t.size)
        waves = study({"y": hidden + noise, "t": t}, "b0")
        found = diagnose(waves, ())
        assert (named(found), found.verdict) == (["periodic[t]"], "effect")
        assert {name for name in found.suggested[0].choice if name.startswith("harmonic")} == {
            "harmonic2",
            "harmonic3",
        }
        parameters = fit(waves, found.suggested).parameters
        assert set(parameters) == {"b0", "periodic[t].period"} | {
            f"periodic[t].{quadrature}{h}" for h in ("", "2", "3") for quadrature in ("cos", "sin")
        }
        assert parameters["periodic[t].period"].value == pytest.approx(4.3, abs=4.0 * 0.01)
        for name, size in true.items():
            each = parameters[f"periodic[t].{name}"]
            # The phase of what is counted from t = 0 goes with the period: both are in the uncertainty.
            assert each.value == pytest.approx(size, abs=4.0 * each.sigma), name


def test_a_sine_has_no_harmonics_and_no_second_period_beside_it() -> None:
    t = np.sort(np.random.default_rng(6).uniform(0.0, 30.0, 120))
    plain = 0
    for seed in range(15):
        noise = np.random.default_rng(seed).standard_normal(t.size)
        (first, *more) = diagnose(study({"y": 3.0 * np.cos(t) + noise, "t": t}, "b0"), ()).suggested
        plain += not more and set(first.choice) == {"period", "origin"}
    # One in a hundred is told more at the default level; two of fifteen would be one in a hundred.
    assert plain >= 14


def test_the_derivative_of_a_wave_by_its_period_is_that_of_its_harmonics_too() -> None:
    form = Periodic(Column("x", X, "s"))
    linear, choice = (
        np.array([1.0, -0.5, 0.3, 0.2, 0.1, -0.4]),
        {"period": 3.1, "origin": 0.5, "harmonic2": 1.0, "harmonic5": 1.0},
    )
    either = [form.basis({**choice, "period": 3.1 + step}) @ linear for step in (1e-6, -1e-6)]
    assert form.slope(choice, linear, form.basis(choice)) == pytest.approx((either[0] - either[1]) / 2e-6, abs=1e-6)


def test_periods_closer_than_one_oscillation_in_the_span_are_one_whose_amplitude_changes() -> None:
    t = np.arange(0.0, 40.0, 0.25)
    waves = study(
        {"y": (1.0 + 0.02 * t) * np.cos(2.0 * np.pi * t / 4.0) + 0.05 * RNG.standard_normal(t.size), "t": t}, "b0"
    )
    model = waves.model([Term("periodic[t]", {"period": 4.0, "origin": 0.0})])
    (offered,) = waves.groups_of(model, np.array([each.start for each in model.parameters]), "periodic[t]#2")
    away = [abs(1.0 / each.term.choice["period"] - 0.25) for each in offered]
    assert min(away) >= 1.0 / np.ptp(t)
    assert len(away) > 100


def test_a_derivative_that_was_made_is_that_beside_the_model_which_asks() -> None:
    x = np.random.default_rng(3).uniform(1950.0, 2020.0, 60)
    square, kept = Power(Column("x", x, "1"), 2), Derivatives()
    beside = [Spanned(np.stack(columns, axis=1)) for columns in ([np.ones(60)], [np.ones(60), x], [x**2])]
    asked = [kept.of(square, {}, each)[0] for each in (*beside, *beside)]
    for number, (found, spanned) in enumerate(zip(asked, (*beside, *beside), strict=True)):
        # As when nothing was asked before, and without what the model spans of the constant and of the line.
        assert np.array_equal(found, Derivatives().of(square, {}, spanned)[0])
        held = [each / np.linalg.norm(each) for each in (np.ones(60), x - x.mean()) if spanned.holds(each[:, None])]
        assert len(held) == (1, 2, 0)[number % 3]
        assert all(abs(each @ found[:, 0]) < 1e-9 * np.linalg.norm(found) for each in held)
    assert asked[3] is asked[0]
