"""The two ways to have an Ensemble oscillate and capture: our program in the controller, or the ASCII commands.

Which of them a controller has is found out before anything moves, and asked again whenever the driver is opened.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.aerotech_ascii import FAULT, INVALID, SUCCESS
from drivers.aerotech_axis import AsciiAxis, AxisStatus
from drivers.aerotech_program import DECIMALS, ProgramCommands
from drivers.aerotech_settings import StageSettings
from drivers.numbers import plain
from rigctl.core.clock import Clock
from rigctl.core.errors import InstrumentError

ONE_FREQUENCY = "1"
"""The fourth number, which the maker's library has and the one program seen has not."""


class Commands(Protocol):
    """How an oscillation is started and positions are captured."""

    def oscillation(self, distance_mm: float, frequency_hz: float, cycles: int) -> str:
        """Make it ready; the line that starts it."""

    def begun(self, check: Callable[[], None]) -> None:
        """Return when the controller has come to it, after its answer; `check` raises when it was stopped."""

    def halt(self) -> None:
        """No further motion is commanded by what was started; the axis is aborted apart from this."""

    def arm(self, samples: int) -> None:
        """Wait for so many edges."""

    def read(self, first: int, count: int) -> bool:
        """Put so many counts into the registers from `first`; False when there are fewer."""

    def end(self) -> None:
        """Wait for no more edges."""


class AsciiCommands:
    """OSCILLATE and DATAACQ as lines of the ASCII interface."""

    def __init__(self, settings: StageSettings, wire: AsciiAxis, frequencies: tuple[str, ...]) -> None:
        self._settings = settings
        self._wire = wire
        self._frequencies = frequencies

    def oscillation(self, distance_mm: float, frequency_hz: float, cycles: int) -> str:
        """The line; nothing has to be made ready."""
        numbers = plain(distance_mm, DECIMALS), plain(frequency_hz, DECIMALS), str(cycles)
        return self._wire.words.listed("OSCILLATE", *numbers, *self._frequencies)

    def begun(self, check: Callable[[], None]) -> None:
        """The answer has told."""

    def halt(self) -> None:
        """There is nothing but the motion."""

    def arm(self, samples: int) -> None:
        """Wait for so many edges."""
        s = self._settings
        for what in (f"INPUT {s.capture_input}", f"TRIGGER {s.capture_trigger}", f"ON {samples}"):
            self._wire.tell(self._wire.words.order("DATAACQ", what))

    def read(self, first: int, count: int) -> bool:
        """Put so many counts into the registers from `first`; False when there are fewer."""
        command = self._wire.words.order("DATAACQ", f"READ {first}, {count}")
        answer = self._wire.link.tell(command)
        # `#` although the axis has no fault: the read itself cannot be done, for want of points.
        if answer.status == FAULT and not self._wire.fault_word():
            return False
        self._wire.succeed(command, answer)
        return True

    def end(self) -> None:
        """Wait for no more edges."""
        # Switching it off does no harm when given twice.
        self._wire.insist(self._wire.words.order("DATAACQ", "OFF"))


def find_commands(
    name: str, settings: StageSettings, wire: AsciiAxis, clock: Clock, *, integers: int, doubles: int
) -> Commands:
    """What this controller, with so many registers, has; `InstrumentError` for nothing.

    The axis has to be at rest, and stays there.
    """
    if settings.program:
        by_program = ProgramCommands(name, settings.program, settings, wire, clock)
        if by_program.check(integers, doubles):
            return by_program
    words = wire.words
    if wire.link.tell(words.order("DATAACQ", "OFF")).status != INVALID:
        ending = _oscillate_ending(wire)
        if ending is not None:
            return AsciiCommands(settings, wire, ending)
    raise InstrumentError(
        f"{name}: the controller has no program {settings.program!r} and does not understand OSCILLATE and "
        f"DATAACQ as ASCII commands; compile {words.source} and load it ({words.page})",
        instrument=name,
    )


def _oscillate_ending(wire: AsciiAxis) -> tuple[str, ...] | None:
    """What OSCILLATE has behind its three numbers: the number of frequencies or nothing; None when it is unknown."""
    enabled = wire.status() & AxisStatus.ENABLED
    # Only a disabled axis can be told to oscillate without any risk that it does.
    if enabled:
        wire.tell(wire.words.order("DISABLE"))
    try:
        for ending in ((ONE_FREQUENCY,), ()):
            line = wire.words.listed("OSCILLATE", "0.001", "1", "1", *ending)
            if wire.link.tell(line).status in (FAULT, SUCCESS):
                return ending
        return None
    finally:
        if enabled:
            wire.enable()
