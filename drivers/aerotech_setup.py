"""How a controller is set up: who answers, in which unit its axis counts, its limits, how many registers it has."""

from __future__ import annotations

import re

from drivers.aerotech_ascii import INVALID, SUCCESS, AsciiLink
from drivers.aerotech_axis import AsciiAxis
from drivers.aerotech_settings import StageSettings
from rigctl.core.errors import InstrumentError, WrongInstrument

REGISTERS_MAX = 1 << 20
"""More than any controller has."""


class ControllerSetup:
    """Asked once when the driver connects; what another client may change is asked again."""

    def __init__(self, name: str, settings: StageSettings, link: AsciiLink, wire: AsciiAxis) -> None:
        self.counts_per_mm = 1.0
        self.integer_registers = self.double_registers = 0
        self._name = name
        self._settings = settings
        self._link = link
        self._wire = wire

    def check(self) -> None:
        """`WrongInstrument`, or `LimitError` when the controller's limits are narrower than the rig file's."""
        units = self.meet()
        if units.lower() != "mm":
            raise self._wrong(f"{self._wire.words} counts in {units!r}: {self._wire.words.mend_unit}")
        if self.counts_per_mm <= 0.0:
            number = self._wire.words.numbers.counts_per_unit
            raise self._wrong(f"its CountsPerUnit is {self.counts_per_mm:g} (parameter {number})")
        self._compare_limits()

    def meet(self) -> str:
        """`WrongInstrument` unless it is the controller it should be; the unit that the axis counts in."""
        try:
            # No controller knows this word and says `!`; what answers otherwise is something else.
            nonsense = self._link.tell("NONE").status
            version = self._wire.succeed("VERSION", self._link.version())
            self.learn_words()
            units, self.counts_per_mm = self.unit()
            self.integer_registers, self.double_registers = self.registers()
        except InstrumentError as error:
            raise self._wrong(str(error)) from error
        if nonsense != INVALID or not re.match(r"\d+\.\d+", version):
            raise self._wrong(f"it answered 'NONE' with {nonsense!r} and 'VERSION' with {version!r}")
        return units

    def learn_questions(self) -> None:
        """Find out how it wants to be asked for its state: a stop comes before anything else may be known."""

    def learn_words(self) -> None:
        """Find out how it wants to be spoken to; `WrongInstrument` when that is not to be found out."""
        words = self._wire.words
        name = self._wire.ask(self._wire.parameter(words.numbers.axis_name)).strip('"')
        # An axis addressed by its index has whatever name it was given.
        if words.number is None and name.upper() != words.axis.upper():
            raise self._wrong(f"its axis is called {name!r}, not {words.axis!r}: set `axis`")
        self._wire.words = words.named(name)

    def unit(self) -> tuple[str, float]:
        """What the axis counts in, and how many counts it has to the unit."""
        counts_per_unit = self._wire.words.numbers.counts_per_unit
        return self._unit_name(), self._wire.ask_number(self._wire.parameter(counts_per_unit))

    def registers(self) -> tuple[int, int]:
        """How many integer and double registers it has."""
        numbers = self._wire.words.numbers
        integers, doubles = numbers.global_integers, numbers.global_doubles
        if integers is None or doubles is None:
            return self._count("IGLOBAL"), self._count("DGLOBAL")
        there = [self._wire.ask_whole(self._wire.parameter(number)) for number in (integers, doubles)]
        return there[0], there[1]

    def require_unit(self) -> None:
        """`InstrumentError` when another client has changed the unit since; two questions."""
        name, counts = self.unit()
        if name.lower() != "mm" or counts != self.counts_per_mm:
            raise InstrumentError(
                f"{self._name}: {self._wire.words} counts in {name!r} of {counts:g} counts now, not in mm of "
                f"{self.counts_per_mm:g}; set UnitsName and CountsPerUnit back",
                instrument=self._name,
            )

    def require_program_zero(self) -> None:
        """`InstrumentError` when program positions are shifted against home."""
        # PFBK counts from home, PFBKPROG from the program's zero; soft limits here are relative to home.
        words = self._wire.words
        shift_mm = self._wire.ask_number(words.question("PFBK")) - self._wire.position_mm()
        if abs(shift_mm) > self._settings.position_tolerance_mm:
            raise InstrumentError(
                f"{self._name}: program positions of {words} are shifted by {shift_mm:g} mm against "
                f"home (POSOFFSET of another client); send {words.order('POSOFFSET CLEAR')} or restart it",
                instrument=self._name,
            )

    def _compare_limits(self) -> None:
        numbers = self._wire.words.numbers
        low_mm = self._wire.ask_number(self._wire.parameter(numbers.limit_low))
        high_mm = self._wire.ask_number(self._wire.parameter(numbers.limit_high))
        # Both zero: the controller has no soft limits.
        if low_mm or high_mm:
            called = f"its soft limits (its parameters {numbers.limit_low} and {numbers.limit_high})"
            self._settings.limits.require_inside(self._name, low_mm, high_mm, called)

    def _unit_name(self) -> str:
        number = self._wire.words.numbers.units_name
        return self._settings.unit_said if number is None else self._wire.ask(self._wire.parameter(number)).strip('"')

    def _count(self, registers: str) -> int:
        """How many there are, where no parameter tells: a question beyond the last is not understood."""
        there, beyond = 0, REGISTERS_MAX
        while there < beyond:
            middle = (there + beyond) // 2
            if self._link.ask(f"{registers}({middle})").status == SUCCESS:
                there = middle + 1
            else:
                beyond = middle
        return there

    def _wrong(self, why: str) -> WrongInstrument:
        model = self._wire.words.model
        return WrongInstrument(f"{self._name}: no {model} to work with: {why}", instrument=self._name)
