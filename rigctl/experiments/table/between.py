"""What readings say between the values of a column that repeat, and what effects of the catalogue do there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray, IntArray
from rigctl.experiments.table.candidates import at_rows
from rigctl.experiments.table.catalogue import why_not
from rigctl.experiments.table.model.form import Form, TableEffect, smooth_in
from rigctl.experiments.table.model.forms import Interaction, Power
from rigctl.experiments.table.model.scanned import Scanned, Step
from rigctl.experiments.table.model.words import Level, Slope
from rigctl.experiments.table.observe.readings import Readings
from rigctl.workbench.verdict.noise import orthonormal

INDEPENDENT = 1e-6
"""Of a column's length: what is left less of lies in the span already."""

# Points times values of a scan; beyond, its shortest periods are left out.
_SCAN_MAX = 300_000
_FINER = 20


@dataclass(frozen=True)
class Between:
    """Readings in the space between the values of a column, of which a design is free.

    `along` (g,) are their coordinates on an orthonormal basis of that space; `of_values` (g, values) gives those of a
    function of the values. Within values their mean square is `within`, with so many `degrees` of freedom. `counts`
    (values,) are square sums of the indicators.
    """

    along: FloatArray
    of_values: FloatArray
    within: float
    degrees: int
    counts: FloatArray

    @classmethod
    def of(cls, residuals: FloatArray, design: FloatArray, indicators: FloatArray) -> Between:
        """Of residuals (n,) beside an orthonormal `design` (n, p); `indicators` (n, values), in the same units."""
        left = residuals - design @ (design.T @ residuals)
        frame = orthonormal(indicators - design @ (design.T @ indicators), INDEPENDENT)
        along = frame.T @ left
        degrees = len(residuals) - design.shape[1] - frame.shape[1]
        inside = max(float(left @ left - along @ along), 0.0)
        return cls(
            along,
            frame.T @ indicators,
            inside / degrees if degrees > 0 else 0.0,
            degrees,
            np.sum(indicators**2, axis=0),
        )


@dataclass(frozen=True)
class Shape:
    """What one effect does between values, at each of `rows`, in which every value stands once.

    `rivals` effects are of its kind; `family` is that of the catalogue.
    """

    effect: Form
    rows: IntArray
    family: str
    rivals: int

    @property
    def scanned(self) -> bool:
        """Whether it has a parameter that is scanned."""
        return isinstance(self.effect, Scanned)

    def grid(self) -> FloatArray:
        """Values of what is scanned, (points,)."""
        if not isinstance(self.effect, Scanned):
            return np.zeros(1)
        return self.effect.grid(max(_SCAN_MAX // len(self.rows), 1))

    def finer(self, grid: FloatArray, place: int) -> FloatArray:
        """Between the neighbours of a point; of a place between readings nothing is."""
        if not self.scanned or isinstance(self.effect, Step):
            return grid[[place]]
        low, high = grid[max(place - 1, 0)], grid[min(place + 1, len(grid) - 1)]
        return np.linspace(low, high, _FINER + 1)

    def at(self, grid: FloatArray) -> FloatArray:
        """Its columns for such a grid, (values, points, d)."""
        form = self.effect
        if isinstance(form, Scanned):
            # Origins are those of the whole column, whatever the rows.
            return _scan_at(form, self.rows, [form.full_choice(float(each)) for each in grid])
        return form.basis(form.choices(lambda _: True)[0])[self.rows][:, None, :]


@dataclass(frozen=True)
class Cubic(Shape):
    """Slope, curvature and cube in one: each alone may show little."""

    def at(self, grid: FloatArray) -> FloatArray:
        """Three columns, (values, 1, 3)."""
        del grid
        column = self.effect.columns[0]
        away = (column.values[self.rows] - column.mean) / column.span
        return (away[:, None] ** np.arange(1, 4))[:, None, :]


def _scan_at(form: Scanned, rows: IntArray, choices: list[dict[str, float]]) -> FloatArray:
    few = at_rows(form, rows)
    assert isinstance(few, Scanned)
    return few.scan(choices)


def shapes_between(readings: Readings, effects: Mapping[str, TableEffect], level_of: IntArray) -> list[Shape]:
    """Effects of the catalogue that vary only between the values that `level_of` (n,) numbers."""
    rows = np.unique(level_of, return_index=True)[1]
    constant = _constant_within(readings, rows[level_of])
    forms = [form for form in effects.values() if isinstance(form, Form) and _is_asked(form, readings, constant)]
    numbers = sum(name in constant for name in readings.columns)
    products = sum(isinstance(form, Interaction) for form in forms)
    shapes = [
        Shape(form, rows, form.family, products if isinstance(form, Interaction) else max(numbers, 1))
        for form in forms
    ]
    cubes = [form for form in forms if isinstance(form, Power) and form.exponent == 3]
    return [*shapes, *(Cubic(form, rows, smooth_in(form.column), numbers) for form in cubes)]


def _constant_within(readings: Readings, representative: IntArray) -> set[str]:
    """Columns that are the same in each row and in its representative."""
    return {name for name, each in readings.given.items() if np.array_equal(each, each[representative])}


def _is_asked(form: Form, readings: Readings, constant: set[str]) -> bool:
    names = {column.name for column in form.columns}
    if isinstance(form, Level | Slope):
        names.add(form.category.name)
    return bool(names) and names <= constant and not (why_not(form, readings) or form.unasked())
