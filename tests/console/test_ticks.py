"""Ticks stand at round values within the axis, as many as there is room for, and their labels tell them apart."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rigctl.console.widgets.drawing import drawn
from rigctl.console.widgets.ticks import Tick, linear_ticks, log_ticks, on_scale, symlog_ticks
from rigctl.report.picture import Line, Picture

ENDS = st.floats(-1e9, 1e9, allow_nan=False)


def labels(found: Sequence[Tick]) -> list[str]:
    return [each.label for each in found]


@given(ENDS, ENDS, st.integers(2, 12))
def test_linear_ticks_are_few_round_and_told_apart(one: float, other: float, most: int) -> None:
    low, high = sorted((one, other))
    # Beyond, neighbours differ in no digit that there is room for.
    assume(high - low > 1e-5 * max(abs(low), abs(high), 1e-3))
    found = linear_ticks(low, high, most)
    assert 1 <= len(found) <= most
    margin = 1e-9 * (high - low)
    assert all(low - margin <= each.at <= high + margin for each in found)
    assert len(set(labels(found))) == len(found)
    steps = np.diff([each.at for each in found])
    for each in found:
        assert float(each.label) == pytest.approx(each.at, rel=1e-5, abs=1e-6 * (high - low))
    if len(steps):
        mantissa = steps[0] / 10.0 ** math.floor(math.log10(steps[0]) + 1e-9)
        assert round(mantissa, 6) in (1.0, 2.0, 5.0)


@given(st.floats(-30.0, 30.0), st.floats(0.1, 40.0), st.integers(2, 12))
def test_ticks_of_a_logarithmic_axis_are_the_numbers_written_there(low: float, span: float, most: int) -> None:
    found = log_ticks(low, low + span, most)
    assert len(found) <= most
    assert len(set(labels(found))) == len(found)
    for each in found:
        assert low - 1e-6 <= each.at <= low + span + 1e-6
        assert math.log10(float(each.label)) == pytest.approx(each.at, abs=1e-3)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.integers(2, 12))
def test_ticks_of_an_axis_that_is_logarithmic_to_either_side(one: float, other: float, most: int) -> None:
    low, high = on_scale("symlog", np.array(sorted((one, other)))).tolist()
    for each in symlog_ticks(low, high, most):
        assert low <= each.at <= high
        assert on_scale("symlog", np.array([float(each.label)]))[0] == pytest.approx(each.at)


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (-12.2, 76.3, 7, ["0", "20", "40", "60"]),
        (0.13008, 0.13266, 5, ["0.1305", "0.1310", "0.1315", "0.1320", "0.1325"]),
        (1e-9, 3e-9, 4, ["1e-9", "2e-9", "3e-9"]),
        (5.0, 5.0, 3, ["5"]),
    ],
)
def test_labels_of_ticks(low: float, high: float, most: int, expected: list[str]) -> None:
    assert labels(linear_ticks(low, high, most)) == expected


def test_a_spectrum_has_decades_on_both_axes() -> None:
    hz = np.geomspace(0.1, 50.0, 40)
    picture = Picture("density", (Line(hz, 1e-6 / hz),), "f / Hz", x_scale="log", y_scale="log")
    text = ["".join(piece for piece, _ in row) for row in drawn(picture, 60, 16)]
    upright = [row[:8].strip() for row in text[1:-1]]
    assert [each for each in upright if each] == ["1e-5", "1e-6", "1e-7"]
    assert text[-1].split() == ["0.1", "1", "10", "f", "/", "Hz"]
    # A power law is a straight line: its dots descend evenly.
    rows = [number for number, row in enumerate(text[1:-1]) if any("\u2800" < sign <= "\u28ff" for sign in row)]
    assert all(b - a == 1 for a, b in itertools.pairwise(rows))


@given(ENDS, st.floats(1e-6, 1.0))
def test_long_labels_leave_the_axis_in_one_column_and_the_plot_within_its_width(value: float, share: float) -> None:
    """A quiet voltmeter: 0.1313714 V and a microvolt more."""
    spread = share * max(abs(value), 1e-3)
    picture = Picture("quiet", (Line(np.array([0.0, 1.0]), np.array([value, value + spread])),), "t / s")
    text = ["".join(piece for piece, _ in row) for row in drawn(picture, 40, 12)]
    assert all(len(row) <= 40 for row in text)
    places = {min(row.find(sign) for sign in "┤│" if sign in row) for row in text[1:-1]}
    assert len(places) == 1


def test_what_is_counted_has_whole_numbers_only() -> None:
    counts = np.array([1.0, 2.0, 3.0])
    counted = Picture("σ", (Line(counts, counts, mark="o"),), "runs")
    # The third tick is where the name of the axis stands.
    assert "".join(piece for piece, _ in drawn(counted, 80, 12)[-1]).split() == ["1", "2", "runs"]
    # Between them something was measured: halves mean something.
    halves = Picture("σ", (Line(counts / 2.0, counts, mark="o"),), "f / Hz")
    assert "0.6" in "".join(piece for piece, _ in drawn(halves, 80, 12)[-1])
