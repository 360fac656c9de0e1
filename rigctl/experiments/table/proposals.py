"""Readings that could be taken next, and a table's readings with them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.observe.readings import Category, Column, Readings
from rigctl.workbench.study import Proposal

BEYOND = 0.2
"""Of a column's range, how far past its ends values are thought possible."""

PROPOSALS_MAX = 600
# By the number of columns: 29, 15^2 and 8^3 places stay below the most there may be.
_GRID = {1: 29, 2: 15, 3: 8}
_GRID_MIN = 4
_DIGITS = 4


def options(readings: Readings) -> list[Proposal]:
    """Values of the columns to take a reading at: a grid over each column's range and a fifth beyond.

    Of many columns, which would make a grid too large, one varies at a time about a reading that was taken. The
    column that orders the readings goes on: its next value.
    """
    free = [column for column in readings.columns.values() if _is_set(readings, column)]
    if not free:
        return []
    ordered = readings.order
    fixed = {} if ordered is None else {ordered.name: _following(ordered)}
    points = _GRID.get(len(free), _GRID_MIN)
    grids = [_grid(column, points) for column in free]
    small = int(np.prod([len(grid) for grid in grids])) <= PROPOSALS_MAX
    places = list(itertools.product(*grids)) if small else _one_at_a_time(free)
    names = [column.name for column in free]
    return [Proposal({**dict(zip(names, place, strict=True)), **fixed}) for place in places]


def with_proposals(readings: Readings, proposals: Sequence[Proposal]) -> Readings:
    """The readings with more rows; what a proposal does not say is as in the last reading, the response its mean."""
    count = len(proposals)
    columns = {name: _longer(column, proposals) for name, column in readings.columns.items()}
    response = readings.response
    return replace(
        readings,
        response=replace(response, values=_joined(response.values, np.full(count, response.values.mean()))),
        columns=columns,
        categories={name: _as_last(category, count) for name, category in readings.categories.items()},
        labels=(*readings.labels, *(f"proposed {i + 1}" for i in range(count))),
        sigma=_joined(readings.sigma, np.full(count, float(np.median(readings.sigma)))),
        block_of=np.concatenate([readings.block_of, np.full(count, readings.block_of[-1])]),
    )


def _is_set(readings: Readings, column: Column) -> bool:
    """Whether a column's values are chosen: it varies, is known everywhere, and is neither order nor block."""
    not_set = {readings.spec.order, readings.spec.block}
    return column.name not in not_set and bool(np.isfinite(column.values).all()) and column.distinct.size > 1


def _grid(column: Column, points: int) -> list[float]:
    low, high = float(column.distinct[0]), float(column.distinct[-1])
    beyond = BEYOND * (high - low)
    # Where nothing was ever negative, or zero, nothing may be: of a length or a temperature in kelvin the inverse and
    # the logarithm are asked about.
    lowest = low if low >= 0.0 and low <= beyond else low - beyond
    # Four digits of the range: values that somebody can set.
    step = 10.0 ** (np.floor(np.log10(high - low)) - _DIGITS + 1)
    places = {float(f"{round(value / step) * step:.12g}") for value in np.linspace(lowest, high + beyond, points)}
    return sorted(places if np.any(column.distinct == 0.0) else places - {0.0})


def _one_at_a_time(free: Sequence[Column]) -> list[tuple[float, ...]]:
    rows = np.stack([column.values for column in free], axis=1)
    # A reading that was taken: the middle of every column may be a state that cannot be.
    middle = rows[int(np.argmin(np.sum(((rows - np.median(rows, axis=0)) / rows.std(axis=0)) ** 2, axis=1)))]
    places = {tuple(map(float, row)) for row in rows[:: max(len(rows) // (PROPOSALS_MAX // 2), 1)]}
    for place, column in enumerate(free):
        for value in _grid(column, _GRID[1]):
            places.add((*map(float, middle[:place]), value, *map(float, middle[place + 1 :])))
    return sorted(places)


def _following(column: Column) -> float:
    return float(column.values.max() + column.spacing)


def _longer(column: Column, proposals: Sequence[Proposal]) -> Column:
    more = [float(each.settings.get(column.name, column.values[-1])) for each in proposals]
    return replace(column, values=_joined(column.values, np.array(more)))


def _as_last(category: Category, count: int) -> Category:
    return replace(category, values=np.append(category.values, np.repeat(category.values[-1:], count)))


def _joined(values: FloatArray, more: FloatArray) -> FloatArray:
    return np.concatenate([values, more])
