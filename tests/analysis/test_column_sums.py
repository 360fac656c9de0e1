"""Scans by sums over the rows say what the columns themselves say; a sketch keeps products but for a few per cent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigctl.analysis.column_sums import ColumnSums, SmoothSums, StepSums
from rigctl.analysis.sketch import BUCKETS, Sketch
from rigctl.analysis.summed_columns import SummedScan
from rigctl.analysis.unit_columns import Scan
from rigctl.core.arrays import FloatArray

ROWS = 700
RNG = np.random.default_rng(5)
VALUES = {
    "uniform": RNG.uniform(3.0, 10.0, ROWS),
    "skewed": RNG.lognormal(0.0, 0.8, ROWS),
    "clustered": np.repeat(RNG.uniform(-5.0, -4.0, 35), 20) + 1e-3 * RNG.standard_normal(ROWS),
    "rounded": np.round(RNG.uniform(0.0, 4.0, ROWS), 1),
}
WEIGHT = RNG.uniform(0.5, 2.0, ROWS)
CYCLES, E_FOLDS = 25.0, np.array([-40.0, -3.0, 0.5, 8.0])


def waves(values: FloatArray) -> tuple[ColumnSums, FloatArray]:
    frequencies = np.linspace(0.5, CYCLES, 40) / np.ptp(values)

    def at(where: FloatArray, some: slice) -> FloatArray:
        phase = 2.0 * np.pi * np.outer(where, frequencies[some])
        return np.stack([np.cos(phase), np.sin(phase)], axis=2)

    return SmoothSums(values, len(frequencies), at, int(48 * CYCLES)), at(values, slice(None))


def growths(values: FloatArray) -> tuple[ColumnSums, FloatArray]:
    rates = E_FOLDS / np.ptp(values)

    def at(where: FloatArray, some: slice) -> FloatArray:
        return np.asarray(np.exp(rates[some] * (where[:, None] - values.mean())))[:, :, None]

    return SmoothSums(values, len(rates), at, 8 * 40), at(values, slice(None))


def steps(values: FloatArray) -> tuple[ColumnSums, FloatArray]:
    # Places on readings too: one is past a place when it is larger.
    places = np.unique(np.concatenate([np.quantile(values, [0.1, 0.4, 0.7]), values[:5]]))
    return StepSums(values, places), (values[:, None] > places).astype(float)[:, :, None]


KINDS: dict[str, Callable[[FloatArray], tuple[ColumnSums, FloatArray]]] = {
    "waves": waves,
    "growths": growths,
    "steps": steps,
}


def spaces(values: FloatArray) -> FloatArray:
    return np.linalg.qr(np.stack([np.ones(ROWS), values - values.mean()], axis=1))[0]


@pytest.mark.parametrize("spread", VALUES)
@pytest.mark.parametrize("kind", KINDS)
def test_sums_are_those_of_the_columns(kind: str, spread: str) -> None:
    sums, columns = KINDS[kind](VALUES[spread])
    vectors = np.random.default_rng(1).standard_normal((ROWS, 3))
    longest = np.sqrt(np.einsum("nki,nki->ki", columns, columns))
    # Interpolated functions are off by 1e-6 of their size at most.
    exact = np.einsum("nq,nki->qki", vectors, columns)
    assert np.max(np.abs(sums.along(vectors) - exact) / longest) < 1e-5
    squares = np.einsum("n,nki,nkj->kij", WEIGHT, columns, columns)
    product = longest[:, :, None] * longest[:, None, :]
    assert np.max(np.abs(sums.squares(WEIGHT) - squares) / product) < 1e-5
    for place in range(sums.choices):
        np.testing.assert_array_equal(sums.of(place), columns[:, place])


@pytest.mark.parametrize("spread", VALUES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_summed_scan_is_the_scan(kind: str, spread: str) -> None:
    values = VALUES[spread]
    sums, columns = KINDS[kind](values)
    space = spaces(values)
    free = columns - np.einsum("nt,tki->nki", space, np.einsum("nt,nki->tki", space, columns))
    plain, summed = Scan(free), SummedScan(sums, ROWS, lambda: space)
    np.testing.assert_allclose(summed.rms, plain.rms, rtol=1e-4, atol=1e-6)
    noise = object()

    def whiten(columns: FloatArray) -> FloatArray:
        return columns * WEIGHT[:, None]

    one, other = plain.whitened(noise, whiten), summed.whitened(noise, whiten)
    vectors = np.random.default_rng(2).standard_normal((ROWS, 2))
    np.testing.assert_allclose(other.along(vectors), one.along(vectors), atol=1e-4)
    np.testing.assert_allclose(other.gram, one.gram, atol=1e-4)
    for place in range(sums.choices):
        np.testing.assert_allclose(other.columns(place), one.columns(place), atol=1e-5)
        np.testing.assert_allclose(summed.of(place), plain.of(place), atol=1e-9 * np.abs(columns).max())


def test_long_columns_and_many_choices_come_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.analysis.column_sums._ROWS_AT_ONCE", 64)
    monkeypatch.setattr("rigctl.analysis.column_sums._KEPT", 0)
    monkeypatch.setattr("rigctl.analysis.column_sums._CHOICES_AT_ONCE", 7)
    sums, columns = waves(VALUES["uniform"])
    vectors = np.random.default_rng(3).standard_normal((ROWS, 2))
    np.testing.assert_allclose(sums.along(vectors), np.einsum("nq,nki->qki", vectors, columns), atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_sketch_keeps_lengths_and_angles(kind: str) -> None:
    sums, columns = KINDS[kind](VALUES["uniform"])
    sketch = Sketch(ROWS)
    drawn = sums.sketched(sketch, WEIGHT).reshape(BUCKETS, -1)
    whole = (WEIGHT[:, None, None] * columns).reshape(ROWS, -1)
    # Between nodes a sketch is a line: two parts in a thousand of 24 nodes to a period.
    np.testing.assert_allclose(drawn, sketch.of(whole), atol=3e-3 * np.abs(whole).max() * np.sqrt(ROWS))
    lengths = np.linalg.norm(whole, axis=0)
    off = (drawn.T @ drawn - whole.T @ whole) / np.outer(lengths, lengths)
    # Five standard deviations, sqrt(2 / buckets) each.
    assert np.abs(off).max() < 5.0 * np.sqrt(2.0 / BUCKETS)


def test_a_sketch_of_some_rows_is_that_of_columns_which_are_zero_elsewhere() -> None:
    sketch, rows = Sketch(ROWS), np.arange(100, 300)
    columns = np.zeros((ROWS, 2))
    columns[rows] = RNG.standard_normal((200, 2))
    np.testing.assert_allclose(sketch.of(columns[rows], rows), sketch.of(columns))
