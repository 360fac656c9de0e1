"""How an Ensemble is set up: who answers, in which unit its axis counts, its limits, how many registers it has."""

from __future__ import annotations

import re

from drivers.aerotech_ascii import INVALID, AsciiLink
from drivers.aerotech_axis import AXIS_NAME, AsciiAxis
from drivers.aerotech_settings import EnsembleSettings
from rigctl.core.errors import InstrumentError, WrongInstrument

# Parameter numbers of Aerotech's C header (EnsembleParameterId.h).
UNITS_NAME, COUNTS_PER_UNIT = 129, 2
SOFTWARE_LIMIT_LOW, SOFTWARE_LIMIT_HIGH = 37, 38
GLOBAL_INTEGERS, GLOBAL_DOUBLES = 124, 125


class ControllerSetup:
    """Asked once when the driver connects; what another client may change is asked again."""

    def __init__(self, name: str, settings: EnsembleSettings, link: AsciiLink, wire: AsciiAxis) -> None:
        self.axis_name = settings.axis
        self.counts_per_mm = 1.0
        self.integer_registers = self.double_registers = 0
        self._name = name
        self._settings = settings
        self._axis = settings.axis
        self._link = link
        self._wire = wire

    def check(self) -> None:
        """`WrongInstrument`, or `LimitError` when the controller's limits are narrower than the rig file's."""
        units = self.meet()
        if units.lower() != "mm":
            raise self._wrong(f"axis {self._axis} counts in {units!r}: set UnitsName and CountsPerUnit to mm")
        if self.counts_per_mm <= 0.0:
            raise self._wrong(f"its CountsPerUnit is {self.counts_per_mm:g}")
        self._compare_limits()

    def meet(self) -> str:
        """`WrongInstrument` unless it is an Ensemble with this axis; the name of the unit that the axis counts in."""
        try:
            # No Ensemble knows this word and says `!`; what answers otherwise is something else.
            nonsense = self._link.tell("NONE").status
            version = self._wire.succeed("VERSION", self._link.version())
            self.axis_name = self._wire.ask(f"GETPARM({self._axis}, {AXIS_NAME})").strip('"')
            units, self.counts_per_mm = self.unit()
            self.integer_registers = self._wire.ask_whole(f"GETPARM({self._axis}, {GLOBAL_INTEGERS})")
            self.double_registers = self._wire.ask_whole(f"GETPARM({self._axis}, {GLOBAL_DOUBLES})")
        except InstrumentError as error:
            raise self._wrong(str(error)) from error
        if nonsense != INVALID or not re.match(r"\d+\.\d+", version):
            raise self._wrong(f"it answered 'NONE' with {nonsense!r} and 'VERSION' with {version!r}")
        # An axis addressed by its index has whatever name it was given.
        if not self._axis.startswith("@") and self.axis_name.upper() != self._axis.upper():
            raise self._wrong(f"its axis is called {self.axis_name!r}, not {self._axis!r}: set `axis`")
        return units

    def require_unit(self) -> None:
        """`InstrumentError` when another client has changed the unit since; two questions."""
        name, counts = self.unit()
        if name.lower() != "mm" or counts != self.counts_per_mm:
            raise InstrumentError(
                f"{self._name}: axis {self._axis} counts in {name!r} of {counts:g} counts now, not in mm of "
                f"{self.counts_per_mm:g}; set UnitsName and CountsPerUnit back",
                instrument=self._name,
            )

    def require_program_zero(self) -> None:
        """`InstrumentError` when program positions are shifted against home."""
        # PFBK counts from home, PFBKPROG from the program's zero; soft limits here are relative to home.
        shift_mm = self._wire.ask_number(f"PFBK({self._axis})") - self._wire.position_mm()
        if abs(shift_mm) > self._settings.position_tolerance_mm:
            raise InstrumentError(
                f"{self._name}: program positions of axis {self._axis} are shifted by {shift_mm:g} mm against "
                f"home (POSOFFSET of another client); send POSOFFSET CLEAR {self._axis} or restart it",
                instrument=self._name,
            )

    def _compare_limits(self) -> None:
        low_mm = self._wire.ask_number(f"GETPARM({self._axis}, {SOFTWARE_LIMIT_LOW})")
        high_mm = self._wire.ask_number(f"GETPARM({self._axis}, {SOFTWARE_LIMIT_HIGH})")
        # Both zero: the controller has no soft limits.
        if low_mm or high_mm:
            self._settings.limits.require_inside(
                self._name, low_mm, high_mm, "SoftwareLimitLow and SoftwareLimitHigh (its parameters 37 and 38)"
            )

    def unit(self) -> tuple[str, float]:
        """What the axis counts in, and how many counts it has to the unit."""
        name = self._wire.ask(f"GETPARM({self._axis}, {UNITS_NAME})").strip('"')
        return name, self._wire.ask_number(f"GETPARM({self._axis}, {COUNTS_PER_UNIT})")

    def _wrong(self, why: str) -> WrongInstrument:
        return WrongInstrument(f"{self._name}: no Ensemble to work with: {why}", instrument=self._name)
