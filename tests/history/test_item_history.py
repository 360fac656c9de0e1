"""Calibrations put together by item and quantity: what is compared with what, and whatever their order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rigctl.analysis.measurement_result import Quantity
from rigctl.files.item import Item
from rigctl.history.calibration import Calibration, Kind
from rigctl.history.catalogue import Catalogue
from rigctl.history.item_history import ItemHistory, QuantityHistory, histories_of
from rigctl.history.kept_result import KeptResult, SourceParts
from rigctl.history.tables import document_of, terminal_tables, warnings_of

FIRST = datetime(2020, 3, 1, tzinfo=UTC)


def _calibration(
    number: int,
    values: Mapping[str, float],
    *,
    u: float = 1.0,
    b: float = 0.0,
    unit: str = "V",
    equipment: str | None = "rig",
    serial: str = "S-1",
    **quantity: Any,
) -> Calibration:
    quantities = tuple(Quantity(name, value, unit, **quantity) for name, value in values.items())
    ones = np.ones(len(quantities))
    sources = (SourceParts("noise", False, 30.0, u * ones), SourceParts("reference", True, np.inf, b * ones))
    return Calibration(
        Path(f"{number}.rig.sqlite"),
        Kind(serial, "table", "y = b0", False),
        Item(serial=serial),
        FIRST + timedelta(days=365.25 * number),
        equipment,
        (),
        KeptResult(quantities, sources),
    )


def _only(calibrations: Sequence[Calibration]) -> ItemHistory:
    (history,) = histories_of(calibrations)
    return history


def _one(calibrations: Sequence[Calibration]) -> QuantityHistory:
    (quantity,) = _only(calibrations).quantities
    return quantity


def test_two_items_with_one_serial_number_are_said() -> None:
    items = [Item(serial="S-1", name=name, model="QA-2000") for name in ("Alpha", "", "Beta", "Alpha")]
    alike = [_calibration(number, {"gain": 1.0}) for number in range(4)]
    told = [replace(each, item=item) for each, item in zip(alike, items, strict=True)]
    (remark,) = _only(told).remarks
    assert remark.startswith(
        "Its name is stated as 'Alpha' in 0.rig.sqlite, 'Beta' in 2.rig.sqlite: are these one item?"
    )
    assert _only(told[:2]).remarks == _only(alike).remarks == ()


SERIES = [
    *(_calibration(n, {"b0": value, "b1": value**2}, b=5.0) for n, value in enumerate((0.1, 0.3, -0.2, 0.4, 6.0))),
    *(_calibration(n, {"b0": 2.0 * n}, u=0.1, serial="S-2", equipment=None) for n in range(4)),
]


@settings(max_examples=20)
@given(st.permutations(SERIES))
def test_the_order_of_stores_changes_nothing(calibrations: list[Calibration]) -> None:
    documents = [document_of(Catalogue(Path(), 9, (), ()), histories_of(each)) for each in (SERIES, calibrations)]
    assert documents[0] == documents[1]


def test_a_jump_is_warned_of_in_one_line_that_says_where_and_by_how_much() -> None:
    of_b0, of_b1 = warnings_of(_only(SERIES[:5]))
    assert of_b0.startswith(
        "S-1: b0 of 2024-03-01 (4.rig.sqlite) disagrees with the 4 former calibrations: 5.9 ± 1.1 V"
    )
    assert "from their mean, 4.6 sigma (p = 4.7e-06, 9.5e-06 over 2 quantities)" in of_b0
    assert of_b1.startswith("S-1: b1 of 2024-03-01")
    assert warnings_of(_only(SERIES[5:])) == []


def test_a_steady_drift_is_told_and_the_newest_lies_on_it() -> None:
    drifting = _one(SERIES[5:])
    assert drifting.consistency is not None
    assert drifting.consistency.model == "drift"
    assert drifting.drift is not None
    assert drifting.drift.slope.value == pytest.approx(2.0, rel=1e-3)
    assert drifting.reference == pytest.approx([0.0, 2.0, 4.0, 6.0], abs=1e-3)
    (summary,) = [each for each in terminal_tables(_only(SERIES[5:])) if each.title.startswith("Newest")]
    assert any(note.startswith("b0: drifts by 2.000 ± 0.0") for note in summary.notes)


def test_many_quantities_together_raise_no_more_alarms_than_one() -> None:
    rng = np.random.default_rng(7)
    alarms = 0
    for _ in range(60):
        drawn = rng.normal(size=(2, 20))
        names = [f"at {number} Hz" for number in range(20)]
        history = _only([_calibration(n, dict(zip(names, values, strict=True))) for n, values in enumerate(drawn)])
        alarms += bool(warnings_of(history))
    # Each tested by itself at one per cent, 18 % of the items would be warned of: eleven of sixty.
    assert alarms <= stats.binom.isf(1e-4, 60, 0.01)
    assert stats.binom.sf(stats.binom.isf(1e-4, 60, 0.01), 60, 0.18) > 0.9


def test_what_the_same_equipment_adds_is_no_scatter() -> None:
    def tested(equipment: Sequence[str | None]) -> QuantityHistory:
        return _one(
            [
                _calibration(n, {"b0": value}, b=10.0, equipment=each)
                for n, (value, each) in enumerate(zip((0.0, 0.0, 9.0), equipment, strict=True))
            ]
        )

    assert tested(["rig", "rig", "rig"]).disagrees
    assert not tested(["rig", "rig", "another rig"]).disagrees
    assert not tested([None, None, None]).disagrees


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("rad", 2.0 * math.pi)])
def test_angles_are_compared_across_zero(unit: str, turn: float) -> None:
    phases = [-0.001 * turn, 0.001 * turn, 0.999 * turn, 0.0]
    history = _one(
        [_calibration(n, {"phase": each % turn}, u=0.002 * turn, unit=unit) for n, each in enumerate(phases)]
    )
    assert history.consistency is not None
    assert history.consistency.difference.value == pytest.approx(turn * 0.001 / 3.0, rel=1e-6)
    assert [each.value for each in history.entries] == [each % turn for each in phases]
    volts = _one([_calibration(n, {"phase": each % turn}, u=0.002 * turn) for n, each in enumerate(phases)])
    assert volts.former_disagree


def test_other_units_are_not_compared_and_other_spellings_are() -> None:
    mixed = [
        _calibration(n, {"gain": 1.0 + n}, unit=unit) for n, unit in enumerate(("V/(m/s2)", "V s2/m", "mV s2/m"))
    ]
    volts, millivolts = _only(mixed).quantities
    assert [len(each.entries) for each in (volts, millivolts)] == [2, 1]
    assert millivolts.untested == "one calibration"
    assert _only(mixed).remarks == ("gain is in V s2/m and mV s2/m: not compared with each other.",)


def test_a_component_along_its_direction_is_left_to_the_others() -> None:
    def axis(number: int, tilt: float) -> Calibration:
        u = 1e-4
        quantities = tuple(
            Quantity(f"axis X, {name}", value, "1", group="axis X")
            for name, value in (("x", math.sqrt(1.0 - tilt**2)), ("y", tilt))
        )
        source = SourceParts("noise", False, 30.0, np.array([tilt * u, u]))
        plain = _calibration(number, {})
        return Calibration(**{**vars(plain), "result": KeptResult(quantities, (source,))})

    along, across = _only([axis(n, tilt) for n, tilt in enumerate((1e-5, -2e-5, 1.5e-4))]).quantities
    assert along.untested == "the other components of its direction determine it"
    assert across.consistency is not None
    # Tested by itself it would be off by many times its uncertainty of first order.
    assert abs(along.entries[2].value - along.entries[0].value) > 5.0 * along.entries[0].standard_uncertainty


def test_without_an_uncertainty_of_its_own_nothing_is_tested() -> None:
    history = _one([_calibration(n, {"b0": float(n)}, u=0.0, b=1.0) for n in range(3)])
    assert history.consistency is None
    assert history.untested.startswith("no uncertainty of its own")


def test_a_chart_shows_each_value_on_its_side_of_the_reference() -> None:
    chart = list(terminal_tables(_only(SERIES[:5])))[2]
    bars = [row[2] for row in chart.rows]
    assert all(len(bar) == 33 and bar[16] in "|o" for bar in bars)
    # The newest is off by more than twice what is its own: its bar does not reach the line.
    assert bars[4].index("o") > 16
    assert bars[4][17] == " "
    assert all("-" in (bar[15], bar[17]) for bar in bars[:4])
    assert list(chart.marks) == [False] * 4 + [True]
    assert chart.rows[4][1] == "6.0 ± 5.1"
