"""Effects made from columns whose shape is fixed: powers, inverses, products, drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.units import power, ratio
from rigctl.experiments.table.model.form import Choice, Form, too_few
from rigctl.experiments.table.observe.readings import Category, Column

_READINGS_OF_A_LEVEL = 2
_POWERS = {
    1: ("linear", "is proportional to"),
    2: ("power2", "goes as the square of"),
    3: ("power3", "goes as the cube of"),
    -1: ("inverse", "goes inversely as"),
}


@dataclass(frozen=True)
class Power(Form):
    """p C**k; for k = 1 `linear[C]`, for k = -1 `inverse[C]`."""

    column: Column
    exponent: int

    @property
    def id(self) -> str:
        """As in commands."""
        return f"{_POWERS[self.exponent][0]}[{self.column.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something {_POWERS[self.exponent][1]} {self.column.name}."

    @property
    def columns(self) -> tuple[Column, ...]:
        """Its only one."""
        return (self.column,)

    def untestable(self) -> str:
        """Why not, or ""."""
        different = self.column.distinct.size
        if self.exponent < 0 and (self.column.values == 0.0).any():
            return f"{self.column.name} is zero in {int((self.column.values == 0.0).sum())} readings"
        needed = abs(self.exponent) + 1
        return too_few(self.column, needed) if different < needed else ""

    def units(self, response: str) -> tuple[str, ...]:
        """Response over column**k."""
        return (ratio(response, power(self.column.unit, self.exponent)),)

    def basis(self, choice: Choice) -> FloatArray:
        """C**k as in the column."""
        del choice
        return np.asarray(self.column.values**self.exponent)[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By powers of the distance from the column's mean, so that nothing cancels."""
        centre = self.column.mean
        if self.exponent < 0:
            mean = self.basis(choice).mean()
            return [np.full((self.column.values.size, 1), mean), self.basis(choice) - mean]
        away = (self.column.values - centre)[:, None]
        k = self.exponent
        return [math.comb(k, j) * centre ** (k - j) * away**j for j in range(k + 1)]

    def trivial(self) -> list[FloatArray]:
        """Lower powers."""
        away = self.column.values - self.column.mean
        return [away**j for j in range(max(self.exponent, 1))]


@dataclass(frozen=True)
class Drift(Form):
    """p C, with C the column that orders the readings: `drift`."""

    column: Column | None

    @property
    def id(self) -> str:
        """As in commands."""
        return "drift"

    @property
    def columns(self) -> tuple[Column, ...]:
        """The one of time, where there is one."""
        return (self.column,) if self.column else ()

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"The response drifts{f' with {self.column.name}' if self.column else ''}."

    def untestable(self) -> str:
        """Why not, or ""."""
        if self.column is None:
            return "the readings are in no order; name the column that tells when in [table] order"
        return ""

    def units(self, response: str) -> tuple[str, ...]:
        """Response over the column's."""
        return self._line.units(response)

    def basis(self, choice: Choice) -> FloatArray:
        """C as in the column."""
        return self._line.basis(choice)

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By the distance from the column's mean."""
        return self._line.parts(choice)

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return self._line.trivial()

    @property
    def _line(self) -> Power:
        assert self.column is not None
        return Power(self.column, 1)


@dataclass(frozen=True)
class Interaction(Form):
    """p A B: `interaction[A,B]`."""

    one: Column
    other: Column

    @property
    def id(self) -> str:
        """As in commands."""
        return f"interaction[{self.one.name},{self.other.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"What {self.one.name} does depends on {self.other.name}."

    @property
    def columns(self) -> tuple[Column, ...]:
        """Both."""
        return (self.one, self.other)

    def units(self, response: str) -> tuple[str, ...]:
        """Response over both columns."""
        both = f"{self.one.unit} {self.other.unit}" if self.one.unit and self.other.unit else ""
        return (ratio(response, f"({both})" if both else ""),)

    def basis(self, choice: Choice) -> FloatArray:
        """A B as in the columns."""
        del choice
        return (self.one.values * self.other.values)[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By distances from the columns' means, so that nothing cancels."""
        del choice
        a, b = self.one.mean, self.other.mean
        x, y = self.one.values - a, self.other.values - b
        return [each[:, None] for each in (np.full(x.size, a * b), b * x, a * y, x * y)]

    def trivial(self) -> list[FloatArray]:
        """A constant, and each column alone."""
        x, y = self.one.values - self.one.mean, self.other.values - self.other.mean
        return [np.ones(x.size), x, y]


@dataclass(frozen=True)
class Level(Form):
    """One number for each level of a column of words but the first, which it is counted from: `level[C]`."""

    category: Category

    @property
    def id(self) -> str:
        """As in commands."""
        return f"level[{self.category.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something is different for each {self.category.name}."

    def untestable(self) -> str:
        """Why not, or ""."""
        name, levels, counts = self.category.name, self.category.levels, self.category.counts
        if missing := np.count_nonzero(self.category.values == ""):
            return f"{name} has no value in {missing} readings"
        if len(levels) == 1:
            return f"{name} is {levels[0]} in all readings"
        if not self.category.names_groups:
            return f"{name} takes {len(levels)} different values in {sum(counts)} readings: too many for levels"
        rare = [level for level, count in zip(levels, counts, strict=True) if count < _READINGS_OF_A_LEVEL]
        if rare:
            return f"{name} is {rare[0]} in fewer than {_READINGS_OF_A_LEVEL} readings"
        return ""

    def names(self) -> tuple[str, ...]:
        """What a level has more than the first, such as .B-A."""
        first, *others = self.category.levels
        return tuple(f".{level}-{first}" for level in others)

    def basis(self, choice: Choice) -> FloatArray:
        """1 where a reading is of the level, shape (n, levels - 1)."""
        del choice
        return np.asarray(self.category.codes[:, None] == np.arange(1, len(self.category.levels)), dtype=np.float64)

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return [np.ones(self.category.values.size)]
