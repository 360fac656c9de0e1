"""Effects made from columns whose shape is fixed: powers, inverses, products, drift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.units import power, ratio
from rigctl.experiments.table.observe.readings import Category, Column

Choice = Mapping[str, float]

_READINGS_OF_A_LEVEL = 2


class Form(Protocol):
    """One effect of the generic catalogue: linear parameters on a basis that a scanned choice may shape."""

    @property
    def id(self) -> str:
        """As in commands."""
        ...

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        ...

    def untestable(self) -> str:
        """Why these readings cannot be asked; "" when they can."""
        ...

    def names(self) -> tuple[str, ...]:
        """Of the linear parameters, without the effect's id: "", ".cos"."""
        ...

    def units(self, response: str) -> tuple[str, ...]:
        """Of the linear parameters, for a response in this unit."""
        ...

    def basis(self, choice: Choice) -> FloatArray:
        """What one unit of each linear parameter adds, shape (n, d)."""
        ...

    def parts(self, choice: Choice) -> list[FloatArray]:
        """Arrays (n, d) whose sum is the basis, the simplest first: a baseline may hold these already."""
        ...

    def trivial(self) -> list[FloatArray]:
        """Simple functions, shape (n,), that a baseline often holds and this effect is told from."""
        ...


@dataclass(frozen=True)
class Power:
    """p C**k; for k = 1 `linear[C]`, for k = -1 `inverse[C]`."""

    id: str
    column: Column
    exponent: int

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        kind = {1: "is proportional to", 2: "goes as the square of", 3: "goes as the cube of"}
        return f"Something {kind.get(self.exponent, 'goes inversely as')} {self.column.name}."

    def untestable(self) -> str:
        """Why not, or ""."""
        different = self.column.distinct.size
        if self.exponent < 0 and (self.column.values == 0.0).any():
            return f"{self.column.name} is zero in {int((self.column.values == 0.0).sum())} readings"
        needed = abs(self.exponent) + 1
        return too_few(self.column, needed) if different < needed else ""

    def names(self) -> tuple[str, ...]:
        """One, named like the effect."""
        return ("",)

    def units(self, response: str) -> tuple[str, ...]:
        """Response over column**k."""
        return (ratio(response, power(self.column.unit, self.exponent)),)

    def basis(self, choice: Choice) -> FloatArray:
        """C**k as in the column."""
        del choice
        return np.asarray(self.column.values**self.exponent)[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By powers of the distance from the column's mean, so that nothing cancels."""
        centre = self.column.middle
        if self.exponent < 0:
            mean = self.basis(choice).mean()
            return [np.full((self.column.values.size, 1), mean), self.basis(choice) - mean]
        away = (self.column.values - centre)[:, None]
        k = self.exponent
        return [math.comb(k, j) * centre ** (k - j) * away**j for j in range(k + 1)]

    def trivial(self) -> list[FloatArray]:
        """Lower powers."""
        away = self.column.values - self.column.middle
        return [away**j for j in range(max(self.exponent, 1))]


@dataclass(frozen=True)
class Drift:
    """p C, with C the column that orders the readings: `drift`."""

    column: Column | None
    id: str = "drift"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"The response drifts{f' with {self.column.name}' if self.column else ''}."

    def untestable(self) -> str:
        """Why not, or ""."""
        if self.column is None:
            return "the readings are in no order; name the column that tells when in [table] order"
        return ""

    def names(self) -> tuple[str, ...]:
        """One, named like the effect."""
        return ("",)

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
        return Power(self.id, self.column, 1)


@dataclass(frozen=True)
class Interaction:
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

    def untestable(self) -> str:
        """Why not, or ""."""
        return ""

    def names(self) -> tuple[str, ...]:
        """One, named like the effect."""
        return ("",)

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
        a, b = self.one.middle, self.other.middle
        x, y = self.one.values - a, self.other.values - b
        return [each[:, None] for each in (np.full(x.size, a * b), b * x, a * y, x * y)]

    def trivial(self) -> list[FloatArray]:
        """A constant, and each column alone."""
        x, y = self.one.values - self.one.middle, self.other.values - self.other.middle
        return [np.ones(x.size), x, y]


@dataclass(frozen=True)
class Level:
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
        lonely = [level for level, count in zip(levels, counts, strict=True) if count < _READINGS_OF_A_LEVEL]
        if lonely:
            return f"{name} is {lonely[0]} in fewer than {_READINGS_OF_A_LEVEL} readings"
        return ""

    def names(self) -> tuple[str, ...]:
        """What a level has more than the first, such as .B-A."""
        first, *others = self.category.levels
        return tuple(f".{level}-{first}" for level in others)

    def units(self, response: str) -> tuple[str, ...]:
        """The response's."""
        return (response,) * (len(self.category.levels) - 1)

    def basis(self, choice: Choice) -> FloatArray:
        """1 where a reading is of the level, shape (n, levels - 1)."""
        del choice
        return np.asarray(self.category.codes[:, None] == np.arange(1, len(self.category.levels)), dtype=np.float64)

    def parts(self, choice: Choice) -> list[FloatArray]:
        """The basis in one piece."""
        return [self.basis(choice)]

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return [np.ones(self.category.values.size)]


def too_few(column: Column, needed: int) -> str:
    """The reason when a column takes fewer different values than an effect needs."""
    return f"{column.name} takes {column.distinct.size} different values, and {needed} are needed"
