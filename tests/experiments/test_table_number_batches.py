"""Numbers that name batches are told from set-points, whose readings differ by an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.study import TableStudy
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.verdict.diagnose import diagnose

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
