"""Numbers that name batches are told from set-points, whose readings differ by an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.batches import are_too_many, correlation, level_of
from rigctl.experiments.table.between import Between, shapes_between
from rigctl.experiments.table.explained import significant_between
from rigctl.experiments.table.study import TableStudy
from rigctl.report.quantities import number
from rigctl.report.verdicts import noise_sentence
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.study import SharedOffset
from rigctl.workbench.verdict.compare import compare
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit

SET_POINTS: Mapping[str, tuple[Callable[[FloatArray], FloatArray], set[str]]] = {
    "sine": (lambda x: np.sin(2.0 * np.pi * x / 5.3 + 0.4), {"periodic[x]"}),
    "step": (lambda x: (x > 7.5).astype(np.float64), {"step[x]"}),
    "square": (lambda x: (x - 6.5) ** 2 / 15.0, {"turning[x]", "power2[x]"}),
    "cubic": (lambda x: x**3 / 400.0, {"power3[x]"}),
    "exponential": (lambda x: 3.0 * np.exp(-x / 2.0), {"exponential[x]"}),
}


def study(columns: Mapping[str, Any], baseline: str, words: Mapping[str, list[str]] | None = None) -> TableStudy:
    numbers = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    header = Header("table", extra={"table": {"response": "y", "baseline": baseline, "start": {}}})
    record = RunRecord(READINGS, READINGS, "import", dict(words or {}))
    return TableStudy(Recording(header, (record,), {READINGS: numbers}, ImportReport(1)))


def offsets(table: TableStudy) -> dict[str, float]:
    return {each.name: each.share for each in table.observations.offsets}


def named(found: Diagnosis) -> set[str]:
    return {term.effect for term in found.suggested}


def lots(seed: int, count: int, each: int) -> dict[str, FloatArray]:
    """Lots with an offset of two standard deviations and a humidity, each number drawn at random."""
    rng = np.random.default_rng(seed)
    lot = np.repeat(np.arange(count), each)
    return {
        "y": rng.normal(0.0, 2.0, count)[lot] + rng.normal(size=lot.size),
        "a": rng.uniform(0.0, 10.0, lot.size),
        "humidity": np.round(rng.uniform(30.0, 60.0, count), 1)[lot],
        "lot": rng.permutation(count)[lot] + 1.0,
    }


@pytest.mark.parametrize("shape", SET_POINTS)
@pytest.mark.parametrize("seed", range(3))
def test_set_points_that_hide_an_effect_are_no_batches(shape: str, seed: int) -> None:
    made, names = SET_POINTS[shape]
    x = np.repeat(np.arange(1.0, 13.0), 4)
    table = study({"y": made(x) + 0.1 * np.random.default_rng(seed).normal(size=x.size), "x": x}, "b0")
    assert offsets(table) == {}
    assert named(diagnose(table, ())) & names


@pytest.mark.parametrize("seed", range(3))
def test_lots_that_are_numbered_are_batches_as_if_they_were_words(seed: int) -> None:
    columns = lots(seed, 14, 6)
    numbered = study(columns, "b0")
    words = [f"L{number:02.0f}" for number in columns["lot"]]
    named_lots = study({name: columns[name] for name in ("y", "a", "humidity")}, "b0", {"lot": words})
    assert offsets(numbered) == pytest.approx(offsets(named_lots), rel=0.05)
    assert set(offsets(numbered)) == {"lot"}
    assert diagnose(numbered, ()).verdict == diagnose(named_lots, ()).verdict == "adequate"


def test_a_comparison_and_a_ladder_tell_one_rms_beside_the_noise_of_single_readings() -> None:
    """Of lots whose offsets are twice the readings' own noise of 1."""
    table = study(lots(1, 16, 5), "b0 + b1*a")
    found, fitted = compare(table, ()), fit(table, ())
    (channel,) = found.channels
    assert channel.rms == pytest.approx(fitted.rms["y"].value)
    # The 64 degrees of freedom within lots know it to a tenth.
    assert channel.noise == pytest.approx(1.0, abs=0.3)
    said = noise_sentence(found.as_json())
    assert said.endswith(f", of which readings share {number(found.noise[0].batches['lot'])} by lot.")


def test_a_batch_does_not_depend_on_unit_zero_or_names_of_its_numbers() -> None:
    columns = lots(5, 12, 5)
    order = np.random.default_rng(1).permutation(60)
    changed = {
        "y": columns["y"][order],
        "z": 1e3 * columns["lot"][order] + 77.0,
        "q": columns["humidity"][order] / 7.0,
        "p": columns["a"][order],
    }
    (one,), (other,) = offsets(study(columns, "b0")).values(), offsets(study(changed, "b0")).values()
    assert one == pytest.approx(other, rel=1e-6)


@pytest.mark.parametrize("worded", [False, True])
def test_an_effect_between_batches_is_found_where_it_is_large_against_their_scatter(worded: bool) -> None:
    columns = lots(2, 16, 5)
    lot = columns["lot"]
    columns["y"] = columns["y"] + 1.0 * columns["humidity"]
    words = {"lot": [f"L{number:02.0f}" for number in lot]} if worded else {}
    if worded:
        del columns["lot"]
    table = study(columns, "b0", words)
    assert set(offsets(table)) == {"lot"}
    assert named(diagnose(table, ())) == {"linear[humidity]"}


@pytest.mark.parametrize("worded", [False, True])
def test_of_thousands_of_readings_batches_share_offsets_too(worded: bool) -> None:
    """Taken for independent, 2400 readings of 40 lots show whatever differs between lots."""
    columns = lots(7, 40, 60)
    columns["y"] = columns["y"] + 0.3 * columns["a"]
    words = {"lot": [f"L{number:02.0f}" for number in columns["lot"]]} if worded else {}
    if worded:
        del columns["lot"]
    table = study(columns, "b0", words)
    (share,) = offsets(table).values()
    # The variance of 40 offsets, which is 4 of the 5 in all, is known to 22 % (sqrt(2 / 39)).
    ratio = share**2 / (1.0 - share**2)
    assert ratio == pytest.approx(4.0, rel=3.0 * (2.0 / 39.0) ** 0.5)
    assert named(diagnose(table, ())) == {"linear[a]"}


def test_readings_without_a_common_value_are_groups_of_their_own() -> None:
    rng = np.random.default_rng(4)
    lot, wafer = rng.integers(0, 30, 900), rng.integers(0, 4, 900)
    inner = np.unique(np.stack([lot, wafer], axis=1), axis=0, return_inverse=True)[1].ravel()
    shared = (SharedOffset("lot", lot, 0.6), SharedOffset("wafer", inner, 0.5))
    factors = correlation(shared, 900)
    assert sorted(len(where) for where, _ in factors) == sorted(np.bincount(lot))
    built = np.zeros((900, 900))
    for where, factor in factors:
        built[np.ix_(where, where)] = factor @ factor.T
    wanted = (1.0 - 0.36 - 0.25) * np.eye(900) + 0.36 * np.equal.outer(lot, lot) + 0.25 * np.equal.outer(inner, inner)
    assert built == pytest.approx(wanted, abs=1e-12)
    # What crosses ties all readings together.
    (whole,) = correlation((SharedOffset("lot", lot, 0.6), SharedOffset("operator", wafer, 0.5)), 900)
    assert np.array_equal(whole[0], np.arange(900))


@pytest.mark.parametrize(
    ("readings", "values", "are"),
    [(2_000, 2_000, False), (10_000, 400, False), (10_000, 401, True), (10_001, 40, True), (4_002, 2, True)],
)
def test_beyond_what_can_be_worked_out_offsets_are_refused(readings: int, values: int, are: bool) -> None:
    assert are_too_many([np.arange(readings) % values]) == are


def test_declared_batches_of_too_many_readings_are_refused_in_one_line() -> None:
    rows = 12_000
    rng = np.random.default_rng(0)
    header = Header("table", extra={"table": {"response": "y", "baseline": "b0", "start": {}, "batch": ["lot"]}})
    record = RunRecord(READINGS, READINGS, "import", {"lot": [f"L{number}" for number in np.arange(rows) % 50]})
    numbers = {"y": rng.normal(size=rows)}
    recording = Recording(header, (record,), {READINGS: numbers}, ImportReport(1))
    told = r"\[table\] batch: offsets of 12000 readings with 50 values of lot are too many"
    with pytest.raises(DataError, match=told) as said:
        TableStudy(recording)
    assert "\n" not in str(said.value)


def test_an_effect_within_batches_is_found_beside_them() -> None:
    columns = lots(3, 12, 6)
    columns["y"] = columns["y"] + columns["a"]
    assert named(diagnose(study(columns, "b0"), ())) == {"linear[a]"}


def test_numbers_with_nothing_between_them_are_no_batches() -> None:
    rng = np.random.default_rng(0)
    rows = 96
    called = 0
    for _ in range(40):
        x = rng.permutation(np.repeat(np.arange(1.0, 9.0), rows // 8))
        called += bool(offsets(study({"y": rng.normal(size=rows), "x": x, "a": rng.normal(size=rows)}, "b0")))
    # At 1 % each 40 tables give more than 3 in one case in a thousand.
    assert called <= 3


@pytest.mark.parametrize("seed", range(4))
def test_what_repeats_by_rounding_is_no_batch_whatever_is_hidden_in_another_column(seed: int) -> None:
    """A square of x that half cancels within values read twice or thrice was scatter between them."""
    rng = np.random.default_rng([seed, 21])
    x = rng.uniform(0.0, 10.0, 600)
    columns = {
        "y": 0.5 * (x - 5.0) ** 2 + rng.normal(size=x.size),
        "x": np.round(x, 5),
        "humidity": np.round(rng.uniform(30.0, 60.0, x.size), 1),
        "bin": rng.permutation(np.repeat(np.arange(200.0), 3)),
    }
    # `bin` has three readings each, as lots have: what is known of x from within says what it does between.
    assert offsets(study(columns, "b0")) == {}


@pytest.mark.parametrize(
    ("hidden", "are"),
    [
        (lambda u, rng: rng.normal(size=301)[np.rint(300.0 * u).astype(int)], True),
        (lambda u, rng: np.sin(40.0 * np.pi * u), False),
        (lambda u, rng: 5.0 * u % 1.0, False),
        (lambda u, rng: np.exp(-0.5 * ((u - 0.4) / 0.05) ** 2), False),
    ],
    ids=["offsets", "sine", "saw", "peak"],
)
def test_what_repeats_by_chance_names_batches_where_nothing_else_says_why(
    hidden: Callable[[FloatArray, np.random.Generator], FloatArray], are: bool
) -> None:
    """As often as by rounding, in 600 readings, and 40 sigma of what they share or of an effect along them."""
    rng = np.random.default_rng(7)
    humidity = np.round(rng.uniform(30.0, 60.0, 600), 1)
    shared = hidden((humidity - 30.0) / 30.0, rng)
    shared = shared - shared.mean()
    y = 40.0 * shared / np.linalg.norm(shared) + rng.normal(size=humidity.size)
    found = offsets(study({"y": y, "humidity": humidity, "a": rng.normal(size=humidity.size)}, "b0"))
    assert list(found) == ["humidity"] * are


def in_lots(seed: int, count: int, each: int, offset: float, hidden: float = 0.0) -> dict[str, FloatArray]:
    """Lots with two conditions of their own; `hidden` is an effect of c, in its standard errors between lots."""
    rng = np.random.default_rng([seed, 31])
    lot = np.repeat(np.arange(count), each)
    c = np.round(rng.lognormal(0.0, 0.5, count), 4)
    slope = hidden * np.hypot(offset, each**-0.5) / float(np.linalg.norm(c - c.mean()))
    return {
        "y": (rng.normal(0.0, offset, count) + slope * c)[lot] + rng.normal(size=lot.size),
        "a": rng.uniform(0.0, 10.0, lot.size),
        "b": np.round(rng.normal(22.0, 1.5, count), 4)[lot],
        "c": c[lot],
        "lot": rng.permutation(count)[lot] + 1.0,
    }


def test_numbers_that_share_two_conditions_are_batches_however_few() -> None:
    """Scans in three columns say nearly as much of eight lots as offsets do: they were taken for those in 11."""
    tables = 120
    called = sum(set(offsets(study(in_lots(seed, 8, 8, 2.0), "b0"))) == {"lot"} for seed in range(tables))
    # An effect is significant there by chance in one of a hundred, and may leave too little to be offsets.
    assert tables - called <= stats.binom.isf(1e-3, tables, 0.01)


def test_one_quantity_in_two_units_names_no_batches() -> None:
    x = np.repeat(np.arange(1.0, 13.0), 4)
    rng = np.random.default_rng(4)
    columns = {"y": np.sin(2.0 * np.pi * x / 5.3) + 0.1 * rng.normal(size=x.size), "x": x, "z": 32.0 + 1.8 * x}
    assert offsets(study(columns, "b0")) == {}


@pytest.mark.parametrize("count", [8, 16])
def test_an_effect_between_lots_is_as_rare_by_chance_as_its_level_says(count: int) -> None:
    columns = in_lots(1, count, 4, 0.0)
    table = study(columns, "b0").data
    lot = level_of(table.readings, "lot")
    shapes = shapes_between(table.readings, table.generic, lot)
    indicators = np.equal.outer(lot, np.arange(count)).astype(np.float64)
    constant, draws, level = np.full((lot.size, 1), lot.size**-0.5), 100, 0.05
    rng = np.random.default_rng(7)
    noise = [rng.normal(size=count)[lot] + rng.normal(size=lot.size) for _ in range(draws)]
    found = [significant_between(Between.of(each, constant, indicators), shapes, level) for each in noise]
    assert sum(each is not None for each in found) <= stats.binom.isf(1e-3, draws, level)


def between_lots(columns: Mapping[str, FloatArray]) -> float:
    """The p-value of a line in c, of the lots' means."""
    first = np.unique(columns["lot"], return_index=True)[1]
    means = [columns["y"][columns["lot"] == columns["lot"][row]].mean() for row in first]
    return float(stats.linregress(columns["c"][first], means).pvalue)


@pytest.mark.parametrize("worded", [False, True])
def test_an_effect_that_the_means_of_lots_show_is_found(worded: bool) -> None:
    shown, found = 0, 0
    for seed in range(5):
        columns = in_lots(seed, 14, 6, 1.5, hidden=9.0)
        if between_lots(columns) < 1e-5:
            shown += 1
            words = {"lot": [f"L{number:02.0f}" for number in columns["lot"]]} if worded else {}
            numbers = {name: each for name, each in columns.items() if not (worded and name == "lot")}
            names = named(diagnose(study(numbers, "b0", words), ()))
            found += any(each.endswith("[c]") for each in names)
    assert shown >= 4
    assert found >= stats.binom.ppf(1e-3, shown, 0.98)
