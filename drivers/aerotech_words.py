"""How lines for Aerotech's controllers name the axis, and which number each parameter has.

Ensemble: an axis has a name, numbers stand in the maker's EnsembleParameterId.h. Soloist: its one axis is never
named; `D` stands before a position and `F` before a speed (EPICS motorAerotech drvSoloist.cc and devSoloist.cc by
Aerotech; the microscope program cockpit and a NASA profilometer, on Soloists of their own). EPICS gives parameters
numbers of their own; cockpit, with a later Soloist, those of the Ensemble.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self


@dataclass(frozen=True)
class ParameterNumbers:
    """Numbers for GETPARM and SETPARM; None for what no source has."""

    axis_name: int
    counts_per_unit: int
    limit_low: int
    limit_high: int
    ramp_rate: int
    units_name: int | None = None
    global_integers: int | None = None
    global_doubles: int | None = None
    fault_mask: int | None = None
    abort_rate: int | None = None
    socket_timeout: int | None = None


ENSEMBLE_NUMBERS = ParameterNumbers(140, 2, 37, 38, 72, 129, 124, 125, 26, 73, 138)
FIRST_SOLOIST_NUMBERS = ParameterNumbers(257, 3, 47, 48, 103)


class Words(Protocol):
    """How one family of controllers is spoken to."""

    @property
    def model(self) -> str:
        """What the maker calls it."""

    @property
    def manual(self) -> str:
        """The maker's help file."""

    @property
    def source(self) -> str:
        """Our program for it, to be compiled and loaded."""

    @property
    def mend_unit(self) -> str:
        """What to do about another unit than mm."""

    @property
    def page(self) -> str:
        """Where our documentation speaks of it."""

    @property
    def numbers(self) -> ParameterNumbers:
        """Which number each parameter has."""

    @property
    def axis(self) -> str:
        """What the axis is called in a line; "" where it is never named."""

    @property
    def number(self) -> int | None:
        """By which number programs know the axis; None when it has to be asked."""

    @property
    def plane(self) -> int | None:
        """The plane of coordinated motion that the axis is in; None where there are no planes."""

    def __str__(self) -> str:
        """The axis, for messages."""

    def named(self, name: str) -> Self:
        """The same once it is known what AxisName says."""

    def order(self, verb: str, *rest: str) -> str:
        """A command to the axis."""

    def listed(self, verb: str, *numbers: str) -> str:
        """A command to the axis with numbers between commas."""

    def question(self, function: str, *arguments: int) -> str:
        """A question about the axis."""

    def move(self, position: str, speed: str) -> str:
        """An absolute move."""


@dataclass(frozen=True)
class NamedAxis:
    """An axis of an Ensemble: by its name, or by its number, such as `@0`; `name` is what AxisName says."""

    axis: str
    plane: int
    name: str
    numbers: ParameterNumbers = ENSEMBLE_NUMBERS
    model: ClassVar[str] = "Ensemble"
    manual: ClassVar[str] = "Ensemble.chm"
    source: ClassVar[str] = "drivers/aerobasic/rigctl.ab"
    page: ClassVar[str] = "docs/hardware.md#aerotech-ensemble"
    mend_unit: ClassVar[str] = (
        "set UnitsName to mm and CountsPerUnit to the counts in a mm (Configuration Manager), then restart it"
    )

    def __str__(self) -> str:
        return f"axis {self.axis}"

    @property
    def number(self) -> int | None:
        """It is known of an axis that is called by it."""
        return int(self.axis[1:]) if self.axis.startswith("@") else None

    def named(self, name: str) -> Self:
        """The name stands before the speed of a move."""
        return replace(self, name=name)

    def order(self, verb: str, *rest: str) -> str:
        """As in `RAMP RATE X 100`."""
        return " ".join((verb, self.axis, *rest))

    def listed(self, verb: str, *numbers: str) -> str:
        """As in `OSCILLATE X, 0.5, 1, 1`."""
        return f"{verb} {', '.join((self.axis, *numbers))}"

    def question(self, function: str, *arguments: int) -> str:
        """As in `GETPARM(X, 140)`."""
        return f"{function}({', '.join((self.axis, *map(str, arguments)))})"

    def move(self, position: str, speed: str) -> str:
        """As in `MOVEABS X 5 XF20`: the bare `F` is seen in one source only."""
        return f"MOVEABS {self.axis} {position} {self.name}F{speed}"


@dataclass(frozen=True)
class SoleAxis:
    """The axis of a Soloist; `calls` says how a question without arguments ends."""

    calls: str = "()"
    numbers: ParameterNumbers = FIRST_SOLOIST_NUMBERS
    axis: ClassVar[str] = ""
    number: ClassVar[int] = 0
    plane: ClassVar[None] = None
    model: ClassVar[str] = "Soloist"
    manual: ClassVar[str] = "Soloist.chm"
    source: ClassVar[str] = "drivers/aerobasic/soloist.ab"
    page: ClassVar[str] = "docs/hardware.md#aerotech-soloist"
    mend_unit: ClassVar[str] = "look up its unit in Soloist.chm or the Configuration Manager, and set `unit`"

    def __str__(self) -> str:
        return "the axis"

    def named(self, name: str) -> Self:  # noqa: ARG002 - as of an axis that has to be named
        """The name is never said."""
        return self

    def order(self, verb: str, *rest: str) -> str:
        """As in `RAMP RATE 100`."""
        return " ".join((verb, *rest))

    def listed(self, verb: str, *numbers: str) -> str:
        """As in `OSCILLATE 0.5, 1, 1`."""
        return f"{verb} {', '.join(numbers)}"

    def question(self, function: str, *arguments: int) -> str:
        """As in `GETPARM(257)`, `AXISSTATUS()` or, where that is not understood, `AXISSTATUS`."""
        return f"{function}({', '.join(map(str, arguments))})" if arguments else f"{function}{self.calls}"

    def move(self, position: str, speed: str) -> str:
        """As in `MOVEABS D5 F20`."""
        return f"MOVEABS D{position} F{speed}"
