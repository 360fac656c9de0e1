"""What an Ensemble or a Soloist is asked before it moves: its axis, unit, registers, limits and faults.

Where no source has the number of a parameter, it is to be looked up. That a fault is noticed only where its
bit of FaultMask is set stands in the maker's help of later controllers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from drivers.aerotech_axis import FAULTS, AsciiAxis, AxisStatus, fault_text
from drivers.aerotech_commands import AsciiCommands, Commands
from drivers.aerotech_settings import UNIT_UNKNOWN, StageSettings
from drivers.aerotech_setup import ControllerSetup
from drivers.examining import asked, travel
from rigctl.core.errors import InstrumentError, LimitError
from rigctl.core.findings import Finding, Step, differs, ok, unknown

GUARDED = (0, 2, 3, 4, 5, 7, 11)
"""Faults that have to stop the axis: position error, limits, feedback, emergency stop."""
HOME_ASYNC_SINCE = 4, 2
USUAL_PERIOD_S, USUAL_RECORD_S = 0.01, 60.0
"""A record of a campaign: a minute at 100 Hz."""

Longest = Callable[[float], int]


def examined(
    version: str,
    settings: StageSettings,
    setup: ControllerSetup,
    wire: AsciiAxis,
    commands: Callable[[], Commands],
    longest: Longest,
) -> Iterator[Finding]:
    """One thing after the other; `commands` finds out how it oscillates and captures, `longest` its records."""
    numbers, help_file = wire.words.numbers, wire.words.manual
    yield _firmware(version, settings, help_file)
    unit = _unit(setup, wire)
    yield unit
    if unit.outcome == "ok":
        yield asked("limits", "travel", partial(_travel, settings, wire), f"{help_file}, software limits")
    yield _parameter(
        "limits", "fault mask", numbers.fault_mask, partial(_fault_mask, wire), f"{help_file}, FaultMask"
    )
    brakes = partial(_abort, settings, wire)
    yield _parameter("limits", "deceleration", numbers.abort_rate, brakes, f"{help_file}, AbortDecelRate")
    yield asked("capability", "faults", partial(_faults, wire), f"{help_file}, AXISFAULT")
    yield asked("capability", "state", partial(_state, wire), f"{help_file}, AXISSTATUS")
    yield _registers(setup, longest)
    idle = partial(_timeout, wire)
    yield _parameter("capability", "idle time-out", numbers.socket_timeout, idle, f"{help_file}, Socket2Timeout")
    yield from _ways(settings, commands)


def _parameter(step: Step, item: str, number: int | None, look: Callable[[int], Finding], where: str) -> Finding:
    """What a parameter shows; `unknown` where no source has its number."""
    if number is None:
        return unknown(step, item, "no source has the number of its parameter", where)
    return asked(step, item, partial(look, number), where)


def _firmware(version: str, settings: StageSettings, help_file: str) -> Finding:
    try:
        major, minor, *_ = (int(part) for part in version.split("."))
    except ValueError:
        return unknown("identity", "firmware", f"{version!r} is no version as 4.01.000", help_file)
    if (major, minor) >= HOME_ASYNC_SINCE or not settings.home_program:
        return ok("identity", "firmware", version)
    return unknown(
        "identity",
        "firmware",
        f"{version}: {settings.home_program} is known from 4.02 on; without it nothing can be stopped while it homes",
        "the maker's Samples/AeroBasic/HomeAsync.ab; or update the firmware",
    )


def _unit(setup: ControllerSetup, wire: AsciiAxis) -> Finding:
    name, counts = setup.unit()
    if name.lower() == "mm" and counts > 0.0:
        return ok("capability", "unit", f"{name}, {counts:g} counts each")
    mend = wire.words.mend_unit
    if name == UNIT_UNKNOWN:
        return unknown(
            "capability", "unit", f"the controller does not tell in what its axis counts ({counts:g} each)", mend
        )
    return differs("capability", "unit", f"the axis counts in {name!r}, {counts:g} counts each, not in mm", mend)


def _travel(settings: StageSettings, wire: AsciiAxis) -> Finding:
    numbers = wire.words.numbers
    low, high = (wire.ask_number(wire.parameter(number)) for number in (numbers.limit_low, numbers.limit_high))
    called = "SoftwareLimitLow and SoftwareLimitHigh"
    if not low and not high:
        return differs(
            "limits", "travel", f"{called} are both 0: none are set", "set them in the Configuration Manager"
        )
    wanted = settings.position_min_mm, settings.position_max_mm
    return travel(wanted, (low, high), "mm", ("position_min_mm", "position_max_mm"), called)


def _fault_mask(wire: AsciiAxis, number: int) -> Finding:
    mask = round(wire.ask_number(wire.parameter(number))) & 0xFFFFFFFF
    unheeded = [FAULTS[bit] for bit in GUARDED if not mask >> bit & 1]
    if not unheeded:
        return ok("limits", "fault mask", f"{mask:#x}: limits, emergency stop and position error are heeded")
    return differs(
        "limits",
        "fault mask",
        f"FaultMask {mask:#x} lets the axis ignore: {', '.join(unheeded)}",
        f"set bits {', '.join(str(bit) for bit in GUARDED if not mask >> bit & 1)} of FaultMask (parameter {number})",
    )


def _abort(settings: StageSettings, wire: AsciiAxis, number: int) -> Finding:
    rate = wire.ask_number(wire.parameter(number))
    found = f"a stop brakes with {rate:g} mm/s2 (AbortDecelRate), from {settings.speed_mm_s:g} mm/s"
    if rate <= 0.0:
        return differs("limits", "deceleration", found, f"set AbortDecelRate, parameter {number}")
    way_mm = settings.speed_mm_s**2 / (2.0 * rate)
    return ok("limits", "deceleration", f"{found} over {way_mm:.3g} mm")


def _faults(wire: AsciiAxis) -> Finding:
    word = wire.fault_word()
    if not word:
        return ok("capability", "faults", "none")
    return differs(
        "capability", "faults", f"{fault_text(word)} (AXISFAULT {word})", "remove the cause, then `rigctl home` it"
    )


def _state(wire: AsciiAxis) -> Finding:
    status = wire.status()
    bits = {"enabled": AxisStatus.ENABLED, "homed": AxisStatus.HOMED}
    return ok("capability", "state", ", ".join(word if status & bit else f"not {word}" for word, bit in bits.items()))


def _registers(setup: ControllerSetup, longest: Longest) -> Finding:
    there = f"{setup.integer_registers} integer and {setup.double_registers} double registers"
    wanted = round(USUAL_RECORD_S / USUAL_PERIOD_S)
    try:
        most = longest(USUAL_PERIOD_S)
    except LimitError as error:
        return differs("capability", "registers", f"{there}; {error}", "see capture_period_min_s")
    found = f"{there}: {most} captured positions, {most * USUAL_PERIOD_S:g} s at 100 Hz"
    if most >= wanted:
        return ok("capability", "registers", found)
    mend = f"raise GlobalIntegers (parameter 124) by {wanted - most} for a minute at 100 Hz, or record for less long"
    return differs("capability", "registers", found, mend)


def _timeout(wire: AsciiAxis, number: int) -> Finding:
    # The unit of the parameter stands in no source at hand.
    limit = wire.ask_number(wire.parameter(number))
    found = "never" if not limit else f"Socket2Timeout {limit:g}"
    return ok("capability", "idle time-out", f"{found}: the driver connects anew where nothing has been sent")


def _ways(settings: StageSettings, commands: Callable[[], Commands]) -> Iterator[Finding]:
    try:
        found = commands()
    except InstrumentError as error:
        what, _, mend = str(error).rpartition("; ")
        yield differs("capability", "oscillation and capture", what, mend)
        return
    if isinstance(found, AsciiCommands):
        yield ok("capability", "oscillation and capture", "by the ASCII commands OSCILLATE and DATAACQ")
    else:
        yield ok("capability", "oscillation and capture", f"by the program {settings.program}")
