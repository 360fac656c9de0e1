"""Effects that go as a function of one column with a zero that means something: its inverse, root, logarithm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigctl.core.arrays import BoolArray, FloatArray
from rigctl.core.units import power, ratio
from rigctl.experiments.table.model.form import PLAIN, Choice, Form, Spans, smooth_in, too_few
from rigctl.experiments.table.observe.readings import Column


@dataclass(frozen=True)
class _Kind:
    """`value` of a column, the `unit` it has, and where it is `undefined`, with what is then said."""

    words: str
    value: Callable[[FloatArray], FloatArray]
    unit: Callable[[str], str]
    undefined: Callable[[FloatArray], BoolArray]
    reason: str


_KINDS = {
    "inverse": _Kind(
        "goes inversely as", lambda c: 1.0 / c, lambda unit: power(unit, -1), lambda c: c == 0.0, "zero"
    ),
    "sqrt": _Kind("goes as the root of", np.sqrt, lambda unit: power(unit, 0.5), lambda c: c < 0.0, "negative"),
    "log": _Kind("goes as the logarithm of", np.log, str, lambda c: c <= 0.0, "zero or negative"),
}
KINDS = tuple(_KINDS)


@dataclass(frozen=True)
class Function(Form):
    """p / C, p sqrt(C) or p log(C): `inverse[C]`, `sqrt[C]`, `log[C]`."""

    column: Column
    kind: str

    @property
    def id(self) -> str:
        """As in commands."""
        return f"{self.kind}[{self.column.name}]"

    @property
    def sentence(self) -> str:
        """The physics in a sentence."""
        return f"Something {_KINDS[self.kind].words} {self.column.name}."

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
        kind = _KINDS[self.kind]
        if undefined := int(kind.undefined(self.column.values).sum()):
            return f"{self.column.name} is {kind.reason} in {undefined} readings"
        return too_few(self.column, 2) if self.column.distinct.size < 2 else ""

    def unasked(self) -> str:
        """That a clock's zero means nothing, or ""."""
        name = self.column.name
        reason = f"{name} tells when, and its zero means nothing; where it does, add a copy of {name} by another name"
        return reason if self.column.clock else ""

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Response over the function's."""
        del choice
        if self.kind == "log":
            return (response,)
        return (ratio(response, _KINDS[self.kind].unit(self.column.unit)),)

    def choices(self, spans: Spans) -> list[Choice]:
        """As it is; of a logarithm without a constant beside it, over the geometric mean.

        In another unit log C is another by a constant, which there would be nothing to take up.
        """
        values = self.column.values
        if self.kind == "log" and not spans(np.ones(values.size)):
            return [{"unit": float(np.exp(np.mean(np.log(values))))}]
        return [PLAIN]

    def basis(self, choice: Choice) -> FloatArray:
        """The function of the column as it is, or of it over the choice's `unit`, shape (n, 1)."""
        return _KINDS[self.kind].value(self.column.values / choice.get("unit", 1.0))[:, None]

    def parts(self, choice: Choice) -> list[FloatArray]:
        """Mean and what varies, so that nothing cancels."""
        basis = self.basis(choice)
        return [np.full(basis.shape, basis.mean()), basis - basis.mean()]

    def trivial(self) -> list[FloatArray]:
        """A constant."""
        return [np.ones(self.column.values.size)]
