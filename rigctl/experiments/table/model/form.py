"""What an effect of the generic catalogue is: the name, units and shape of what it adds to the response."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from types import MappingProxyType

from rigctl.core.arrays import FloatArray
from rigctl.experiments.table.observe.readings import Column

Choice = Mapping[str, float]
"""Values of what was scanned, and of what goes with them."""

PLAIN: Choice = MappingProxyType({})
"""Nothing is chosen."""

Spans = Callable[[FloatArray], bool]
"""Whether a model spans a function of the readings, (n,)."""


class TableEffect(ABC):
    """One effect of the generic catalogue: what it is called, what it looks at, what it asks of the readings."""

    @property
    @abstractmethod
    def id(self) -> str:
        """As in commands."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """The physics in a sentence."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns of numbers it looks at."""
        return ()

    @property
    def family(self) -> str:
        """Effects of one family are much the same question and share one portion of the level."""
        return self.id

    def untestable(self) -> str:
        """Why these readings cannot be asked; "" when they can."""
        return ""

    def unasked(self) -> str:
        """Why readings that could be are not asked about it unless it is named; "" when they are."""
        return ""

    def names(self, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Of the linear parameters, without the effect's id: "" for one that is named like the effect, ".cos"."""
        del choice
        return ("",)

    def units(self, response: str, choice: Choice = PLAIN) -> tuple[str, ...]:
        """Of the linear parameters, for a response in this unit."""
        return (response,) * len(self.names(choice))


class Form(TableEffect):
    """An effect that adds to the response: linear parameters on a basis that a choice may shape."""

    def choices(self, spans: Spans) -> list[Choice]:
        """What it is tried with beside a model; the first where nothing else is asked for."""
        del spans
        return [PLAIN]

    def settled(self, choice: Choice, spans: Spans) -> Choice:
        """A choice with what it leaves open, beside a model."""
        return {**self.choices(spans)[0], **choice}

    @abstractmethod
    def basis(self, choice: Choice) -> FloatArray:
        """What one unit of each linear parameter adds, shape (n, d)."""

    def parts(self, choice: Choice) -> list[FloatArray]:
        """Arrays (n, d) whose sum is the basis, the simplest first: a baseline may hold these already."""
        return [self.basis(choice)]

    @abstractmethod
    def trivial(self) -> list[FloatArray]:
        """Simple functions, shape (n,), that a baseline often holds: the effect is what remains beside them."""


def too_few(column: Column, needed: int) -> str:
    """The reason when a column takes fewer different values than an effect needs."""
    return f"{column.name} takes {column.distinct.size} different values, and {needed} are needed"


def smooth_in(column: Column | None) -> str:
    """The family of smooth functions of a column."""
    return f"smooth[{column.name}]" if column else "drift"
