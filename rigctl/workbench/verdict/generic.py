"""Shapes without physics that residuals may have: functions of the conditions, one series at a time.

A shape is a harmonic of the angle, times a power of the frequency, times a covariate. Where no effect of the
catalogue explains what is left, the strongest shape describes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.lengths import lengths
from rigctl.analysis.sketch import Sketch, sketch_of
from rigctl.core.arrays import FloatArray, IntArray
from rigctl.workbench.study import Observations
from rigctl.workbench.verdict.noise import Noise
from rigctl.workbench.verdict.score import ABSORBED, Projector, corrected, p_of, smallest_p
from rigctl.workbench.verdict.shapes import (
    ANGLE_HARMONICS,
    Factor,
    Part,
    Shape,
    distinct,
    factors_of,
    normalised,
    plain,
)
from rigctl.workbench.verdict.trials import trials_of

SHAPE_DRAWS = 1000
# Numbers drawn at most: 16 MB in single precision.
_MANY = 1 << 22
# Beyond, the columns of all shapes would take gigabytes: a few of them are made at a time, and not kept.
_FEW_DATA, _TOGETHER = 20_000, 6
_HARDLY = 30
"""So many columns of shapes for each that is fitted."""

_NONE = np.zeros((0, 0))
_NO_SMALLER = 1e-12
"""P-values below are no longer compared: evidence is."""


@dataclass(frozen=True)
class Best:
    """The strongest shape left, with its p-value and that corrected for all shapes; `columns` (n, 1 or 2).

    `described_by` is the strongest where every shape may have a constant part beside it: a factor that follows a
    covariate is not mistaken for a function that is merely flat. Its `described_columns` have the constant last.
    """

    shape: Shape
    statistic: float
    p_value: float
    p_value_corrected: float
    n_eff: float
    dimension: int
    columns: FloatArray
    described_by: Shape
    described_columns: FloatArray


class Generic:
    """All shapes of a set of observations."""

    def __init__(self, given: Observations) -> None:
        self._given = given
        self._kept: dict[int, Part] = {}
        self._main: dict[bytes, FloatArray] = {}
        self._streams: dict[tuple[int, ...], tuple[np.random.Generator, list[NDArray[np.float32]]]] = {}

    def _parts(self) -> Iterator[Part]:
        """Series by series, and kept, where that takes little memory; else some shapes at a time."""
        yield from self._in_turn() if self._long else self._of_each()
        for number in range(len(self._given.series)):
            if names := [name for series, name in self._given.templates if series == number]:
                columns = np.stack([self._given.templates[number, name] for name in names], axis=1)
                rows = np.flatnonzero(np.any(columns != 0.0, axis=1))
                shapes = [Shape(number, 0, 0, name) for name in names]
                yield rows, shapes, normalised(columns[rows]), np.full(len(names), -1, dtype=np.intp)

    def _of_each(self) -> Iterator[Part]:
        for number, rows in self._rows.items():
            if number not in self._kept:
                self._kept[number] = distinct(self._given, number, rows, factors_of(self._given, number, rows))
            yield self._kept[number]

    def _in_turn(self) -> Iterator[Part]:
        """Shapes of long series, each time beside the constant; made once for all series of the same runs."""
        for (constant, *others), series in self._alike:
            first = series[0]
            for place in range(0, max(len(others), 1), _TOGETHER):
                factors = [constant, *others[place : place + _TOGETHER]]
                _, shapes, stack, second = distinct(self._given, first, self._rows[first], factors)
                for number in series:
                    yield self._rows[number], [replace(each, series=number) for each in shapes], stack, second

    @cached_property
    def _alike(self) -> list[tuple[list[Factor], list[int]]]:
        """Series that have the same factors in the same runs."""
        alike: dict[tuple[bytes, tuple[Factor, ...]], list[int]] = {}
        for number, rows in self._rows.items():
            factors = tuple(factors_of(self._given, number, rows))
            alike.setdefault((self._given.run_of[rows].tobytes(), factors), []).append(number)
        return [(list(factors), series) for (_, factors), series in alike.items()]

    @cached_property
    def _rows(self) -> dict[int, IntArray]:
        """Of each series that has any."""
        rows = {number: np.flatnonzero(self._given.series_of == number) for number in range(len(self._given.series))}
        return {number: each for number, each in rows.items() if len(each)}

    @property
    def _long(self) -> bool:
        return len(self._given.value) > _FEW_DATA

    def main_columns(self, where: IntArray) -> FloatArray:
        """The shapes one at a time, products left out, at some data: what saturates a small pool; (data, k)."""
        key = where.tobytes()
        if key not in self._main:
            self._main[key] = self._main_columns(where)
        return self._main[key]

    def _main_columns(self, where: IntArray) -> FloatArray:
        blocks = [np.zeros((len(where), 0))]
        for number in np.unique(self._given.series_of[where]):
            members = np.flatnonzero(self._given.series_of[where] == number)
            rows = where[members]
            factors = factors_of(self._given, int(number), rows)
            _, shapes, stack, second = distinct(self._given, int(number), rows, factors)
            main = [
                place
                for place, shape in enumerate(shapes)
                if (shape.harmonic > 0) + (shape.power != 0) + (shape.covariate != "") <= 1
            ]
            places = [*main, *(second[place] for place in main if second[place] >= 0)]
            columns = np.zeros((len(where), len(places)))
            columns[members] = stack[:, places]
            blocks.append(columns)
        return np.hstack(blocks)

    def best(self, noise: Noise, projector: Projector, stream: tuple[int, ...], number: int = 0) -> Best | None:
        """The strongest shape in the residuals; None where all shapes are absorbed. Trials are counted in draws of
        this `number` in a random `stream`, of long data once for all models."""
        shapes: list[Shape] = []
        scored: list[_Scored] = []
        count = None if self._hardly_fitted(projector) else _Count(self, projector, stream, number)
        for part in self._parts():
            of_series = self._scored(part, noise, projector)
            if count is not None:
                count.add(of_series)
            shapes += part[1]
            # Columns of all series together would be many times the data: they are made again for the one that wins.
            scored.append(replace(of_series, columns=_NONE, shadow=_NONE))
        if not scored:
            return None
        statistics = np.concatenate([each.statistic for each in scored])
        dimensions = np.concatenate([each.dimension for each in scored])
        dof = np.concatenate([each.dof for each in scored])
        p_values = p_of(statistics, dimensions, dof)
        n_eff = self._trials if count is None else count.trials
        top = _strongest(statistics, dimensions, p_values, projector.data)
        p_value = float(p_values[top])
        beside = statistics + np.concatenate([each.constant_statistic for each in scored])
        beside_dimensions = dimensions + np.concatenate([each.constant_statistic > 0.0 for each in scored])
        p_beside = p_of(beside, beside_dimensions, dof)
        described = shapes[_strongest(beside, beside_dimensions, p_beside, projector.data)]
        described_columns = columns = self._columns(shapes[top])
        if described != shapes[top]:
            constant = self._columns(Shape(described.series, 0, 0, ""))
            described_columns = np.hstack([self._columns(described), constant])
        return Best(
            shapes[top],
            float(statistics[top]),
            p_value,
            corrected(p_value, n_eff),
            n_eff,
            int(dimensions[top]),
            columns,
            described,
            described_columns,
        )

    def _hardly_fitted(self, projector: Projector) -> bool:
        """Whether what is fitted takes next to nothing from shapes of long data: as many trials as in any model."""
        return self._long and _HARDLY * projector.basis.shape[1] < self._tried

    @cached_property
    def _tried(self) -> int:
        """Columns of all shapes."""
        wide = 1 if self._given.angle is None else 2 * ANGLE_HARMONICS + 1
        return sum(wide * len(factors) * len(series) for factors, series in self._alike)

    @cached_property
    def _trials(self) -> float:
        """How many independent trials all shapes amount to where nothing is fitted."""
        rows = len(self._given.value)
        noise = Noise(self._given.sigma, np.full(rows, np.inf), (), ())
        nothing = Projector(np.zeros((rows, 0)), np.zeros(rows), noise.dof, rows)
        count = _Count(self, nothing, (0,), 0)
        for part in self._parts():
            count.add(self._scored(part, noise, nothing))
        return count.trials

    def draws(self, stream: tuple[int, ...], number: int, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Draws (rows, draws) from their `shape` (draws, rows): all models of the same data are asked in the same."""
        rng, made = self._streams.setdefault((*stream, *shape), (np.random.default_rng(stream), []))
        while len(made) <= number:
            # Row by row in memory: those of a series are gathered in one piece.
            made.append(np.ascontiguousarray(rng.standard_normal(shape, dtype=np.float32).T))
        return made[number]

    def smallest(self, noise: Noise, projector: Projector, draws: NDArray[np.float32]) -> FloatArray:
        """The smallest p over all shapes in each draw (draws, n + priors) of what is left."""
        draws = np.ascontiguousarray(draws.T)
        fitted = projector.basis.T.astype(np.float32) @ draws
        found = [_smallest(self._scored(part, noise, projector), draws, fitted) for part in self._parts()]
        return np.asarray(np.min(found, axis=0))

    def _columns(self, shape: Shape) -> FloatArray:
        """Columns (n, 1 or 2) of one shape, the angle's cosine and sine as they are."""
        template = self._given.templates.get((shape.series, shape.covariate))
        if template is not None:
            return template[:, None]
        rows = np.flatnonzero(self._given.series_of == shape.series)
        columns = np.zeros((len(self._given.value), 2 if shape.harmonic else 1))
        columns[rows] = plain(self._given, rows, shape)
        return columns

    def _scored(self, part: Part, noise: Noise, projector: Projector) -> _Scored:
        rows, shapes, stack, second = part
        where, white = noise.whiten_rows(rows, stack)
        basis = projector.basis[where]
        # Q is never made: on the rows of the series it is columns less B shadow, elsewhere B shadow alone.
        columns = white[:, : len(second)]
        shadow = basis.T @ columns
        columns, shadow, size = _unit(columns, shadow, lengths(columns))
        along = projector.left[where] @ columns
        statistic, dimension = along**2, (size > 0.0).astype(np.intp)
        pairs = np.flatnonzero(second >= 0)
        beside = white[:, second[pairs]]
        beside_shadow = basis.T @ beside
        length = lengths(beside)
        overlap = np.einsum("nk,nk->k", columns[:, pairs], beside) - np.sum(shadow[:, pairs] * beside_shadow, axis=0)
        beside, beside_shadow, beside_size = _unit(
            beside - columns[:, pairs] * overlap, beside_shadow - shadow[:, pairs] * overlap, length
        )
        along_beside = projector.left[where] @ beside
        statistic[pairs] += along_beside**2
        dimension[pairs] += beside_size > 0.0
        # What is left of the constant beside each shape, and how far the residuals go along that.
        constant_statistic = np.zeros(len(shapes))
        alone = Shape(shapes[0].series, 0, 0, "")
        if alone in shapes:  # templates have no mean of their own
            constant = shapes.index(alone)
            shared = columns[:, constant] @ columns - shadow[:, constant] @ shadow
            shared_beside = columns[:, constant] @ beside - shadow[:, constant] @ beside_shadow
            free, rest = shared[constant] - shared**2, along[constant] - shared * along
            free[pairs] -= shared_beside**2
            rest[pairs] -= shared_beside * along_beside
            seen = free > ABSORBED**2
            constant_statistic = np.where(seen, rest**2 / np.where(seen, free, 1.0), 0.0)
        known = noise.dof[rows][np.isfinite(noise.dof[rows])]
        # A shape may vary between shared offsets only: the fewest degrees of freedom count.
        dof = min([float(np.median(known)) if known.size else np.inf, *(few for _, few in noise.between)])
        return _Scored(
            statistic,
            np.maximum(dimension, 1),
            np.full(len(second), dof),
            where,
            np.hstack([columns, beside]),
            np.hstack([shadow, beside_shadow]),
            pairs,
            constant_statistic,
        )


class _Count:
    """Of shapes, scored part by part, how many independent trials they amount to beside what a projector has fitted:
    in draws of this `number` in a random `stream`."""

    def __init__(self, generic: Generic, projector: Projector, stream: tuple[int, ...], number: int) -> None:
        rows = len(projector.left)
        self._sketch = sketch_of(rows) if rows > _FEW_DATA else None
        drawn = rows if self._sketch is None else self._sketch.buckets
        # Single precision, and fewer draws of long data: the count of trials needs no more.
        self._draws = generic.draws(stream, number, (min(SHAPE_DRAWS, max(_MANY // drawn, 200)), drawn))
        basis = projector.basis if self._sketch is None else self._sketch.of(projector.basis)
        self._fitted = basis.T.astype(np.float32) @ self._draws
        self._smallest = np.ones(self._draws.shape[1])

    def add(self, each: _Scored) -> None:
        tried = each if self._sketch is None else _sketched(each, self._sketch)
        self._smallest = np.minimum(self._smallest, _smallest(tried, self._draws, self._fitted))

    @property
    def trials(self) -> float:
        return trials_of(self._smallest)


@dataclass(frozen=True)
class _Scored:
    """Shapes of one series: Q = columns less B shadow, the second columns of `pairs` after the first of all.

    `constant_statistic` is what a constant of the series explains beside each of them.
    """

    statistic: FloatArray
    dimension: IntArray
    dof: FloatArray
    where: IntArray
    columns: FloatArray
    shadow: FloatArray
    pairs: IntArray
    constant_statistic: FloatArray


def _strongest(statistics: FloatArray, dimensions: IntArray, p_values: FloatArray, data: int) -> int:
    evidence = 0.5 * statistics - 0.5 * dimensions * np.log(data)
    return int(np.argmax(np.where(p_values <= max(float(p_values.min()), _NO_SMALLER), evidence, -np.inf)))


def _unit(columns: FloatArray, shadow: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Columns whose part outside B has unit length, their shadows, and that length; zero where B imitates them."""
    free = np.einsum("nk,nk->k", columns, columns) - np.sum(shadow**2, axis=0)
    kept = free > (ABSORBED * size) ** 2
    scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, free, 1.0)), 0.0)
    return columns * scale, shadow * scale, np.where(kept, np.sqrt(np.abs(free)), 0.0)


def _smallest(each: _Scored, draws: NDArray[np.float32], fitted: NDArray[np.float32]) -> FloatArray:
    """Smallest p of each draw of noise, (rows, draws), over the shapes of a series."""
    count, pairs = len(each.statistic), len(each.pairs)
    single = np.ones(count, dtype=np.bool_)
    single[each.pairs] = False
    # Pairs, their second columns, the others: squares are then added and compared in one piece.
    order = np.concatenate([each.pairs, np.arange(count, count + pairs), np.flatnonzero(single)])
    # Gathered, draws of all rows would be copied for each series.
    there = draws if len(each.where) == len(draws) else draws[each.where]
    # In single precision as the draws are: the count of trials needs no more.
    along = each.columns.T[order].astype(np.float32) @ there
    along -= each.shadow.T[order].astype(np.float32) @ fitted
    squares = np.square(along, out=along)
    both = squares[:pairs]
    both += squares[pairs : 2 * pairs]
    smallest = smallest_p(both.T, each.dimension[each.pairs])
    return np.minimum(smallest, smallest_p(squares[2 * pairs :].T, each.dimension[single]))


def _sketched(each: _Scored, sketch: Sketch) -> _Scored:
    """In a sketch of the rows."""
    return replace(each, where=np.arange(sketch.buckets), columns=sketch.of(each.columns, each.where))
