"""Effects whose shape is fixed: an offset, powers and turning points of columns, products, drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.units import power, ratio
from rigctl.experiments.table.model.form import PLAIN, Choice, Form, Spans, smooth_in, too_few
from rigctl.experiments.table.observe.readings import Column

_POWERS = {
    1: ("linear", "is proportional to"),
    2: ("power2", "goes as the square of"),
    3: ("power3", "goes as the cube of"),
}


@dataclass(frozen=True)
class Offset(Form):
    """p, the same for every reading: `offset`, which a zero that was never set leaves."""

    response: Column

    @property
    def id(self) -> str:
        """As in commands."""
        return "offset"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something is added to every {self.response.name}: its zero is off."

    def basis(self, choice: Choice) -> FloatArray:
        """Ones, shape (n, 1)."""
        del choice
        return np.ones((self.response.values.size, 1))

    def trivial(self) -> list[FloatArray]:
        """Nothing is simpler."""
        return []


@dataclass(frozen=True)
class Power(Form):
    """p C**k; for k = 1 `linear[C]`.

    A clock has no zero of its own; its powers are counted from the first reading, where that makes a difference.
    """

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

    @property
    def family(self) -> str:
        """With all smooth functions of its column."""
        return smooth_in(self.column)

    def untestable(self) -> str:
        """Why not, or ""."""
        needed = self.exponent + 1
        return too_few(self.column, needed) if self.column.distinct.size < needed else ""

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over column**k."""
        del choice
        return (ratio(response, power(self.column.unit, self.exponent)),)

    def choices(self, spans: Spans) -> list[Choice]:
        """As in the column; of a clock since the first reading, unless the model has all lower powers."""
        if not self.column.clock or all(map(spans, self.trivial())):
            return [PLAIN]
        return [{"origin": float(self.column.distinct[0])}]

    def basis(self, choice: Choice) -> FloatArray:
        """(C - origin)**k, the origin zero where the choice has none."""
        return np.asarray((self.column.values - choice.get("origin", 0.0)) ** self.exponent)[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By powers of the distance from the column's mean, so that nothing cancels."""
        centre = self.column.mean - choice.get("origin", 0.0)
        away = (self.column.values - self.column.mean)[:, None]
        k = self.exponent
        return [math.comb(k, j) * centre ** (k - j) * away**j for j in range(k + 1)]

    def trivial(self) -> list[FloatArray]:
        """Lower powers."""
        away = self.column.values - self.column.mean
        return [away**j for j in range(self.exponent)]


@dataclass(frozen=True)
class Turning(Form):
    """p (C - origin) + q (C - origin)**2, the origin in the middle of the column: `turning[C]`.

    A turning point in the middle of the range has neither a slope nor a square as in the column to be found by.
    """

    column: Column

    @property
    def id(self) -> str:
        """As in commands."""
        return f"turning[{self.column.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something is smallest or largest at a value of {self.column.name}."

    @property
    def columns(self) -> tuple[Column, ...]:
        """Its only one."""
        return (self.column,)

    @property
    def family(self) -> str:
        """With all smooth functions of its column."""
        return smooth_in(self.column)

    def untestable(self) -> str:
        """Why not, or ""."""
        return too_few(self.column, 3) if self.column.distinct.size < 3 else ""

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Slope and curvature at the origin."""
        del choice
        return (".slope", ".curvature")

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over the column, and over its square."""
        del choice
        return tuple(ratio(response, power(self.column.unit, k)) for k in (1, 2))

    def choices(self, spans: Spans) -> list[Choice]:
        """The middle of the range."""
        del spans
        return [{"origin": 0.5 * float(self.column.distinct[0] + self.column.distinct[-1])}]

    def basis(self, choice: Choice) -> FloatArray:
        """Shape (n, 2)."""
        away = self.column.values - choice["origin"]
        return np.stack([away, away**2], axis=1)

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return [np.ones(self.column.values.size)]


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

    @property
    def family(self) -> str:
        """With all smooth functions of its column."""
        return smooth_in(self.column)

    def untestable(self) -> str:
        """Why not, or ""."""
        if self.column is None:
            return "the readings are in no order; name the column that tells when in [table] order"
        return ""

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over the column's."""
        return self._line.units(response, choice)

    def choices(self, spans: Spans) -> list[Choice]:
        """As in the column, or since the first reading."""
        return self._line.choices(spans)

    def basis(self, choice: Choice) -> FloatArray:
        """C as in the column, or since the first reading."""
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
    """p (A - a) (B - b), a and b zero or the columns' means: `interaction[A,B]`."""

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

    @property
    def family(self) -> str:
        """With all products."""
        return "products"

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over both columns."""
        del choice
        both = f"{self.one.unit} {self.other.unit}" if self.one.unit and self.other.unit else ""
        return (ratio(response, f"({both})" if both else ""),)

    def choices(self, spans: Spans) -> list[Choice]:
        """As in the columns, clocks since the first reading; from their means, where neither column alone may show
        anything.
        """
        clocks = {name: each for name, each in (("origin_1", self.one), ("origin_2", self.other)) if each.clock}
        if clocks and all(map(spans, self.trivial())):
            clocks = {}
        plain = {name: float(column.distinct[0]) for name, column in clocks.items()}
        return [plain, {"origin_1": self.one.mean, "origin_2": self.other.mean}]

    def basis(self, choice: Choice) -> FloatArray:
        """Shape (n, 1)."""
        a, b = choice.get("origin_1", 0.0), choice.get("origin_2", 0.0)
        return ((self.one.values - a) * (self.other.values - b))[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """By distances from the columns' means, so that nothing cancels."""
        x, y = self.one.values - self.one.mean, self.other.values - self.other.mean
        a, b = self.one.mean - choice.get("origin_1", 0.0), self.other.mean - choice.get("origin_2", 0.0)
        return [each[:, None] for each in (np.full(x.size, a * b), b * x, a * y, x * y)]

    def trivial(self) -> list[FloatArray]:
        """A constant, and each column alone."""
        x, y = self.one.values - self.one.mean, self.other.values - self.other.mean
        return [np.ones(x.size), x, y]
