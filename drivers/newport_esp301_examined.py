"""What an ESP301 is asked before it moves anything: its unit, its stage, its limits, and what it does at them.

ZH is the hardware limit configuration. Of ZS, that of the software limits, the ESP300 user's manual says (page 3-169)
that nothing is done where bit 0 is off, or bits 1 and 2 both are; that ZH is alike is believed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial

from drivers.examining import asked, at_most, travel
from drivers.newport_esp301_line import EspLine, QueuedError
from rigctl.core.errors import BadReply
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.limits import RotationLimits

UNIT_DEGREE = 7
UNITS = (
    "counts", "motor steps", "mm", "um", "inches", "mils", "micro-inches", "deg", "grad", "rad", "mrad", "urad"
)  # fmt: skip
"""By the number that SN has for them."""
MANUAL = "ESP301 user's manual, section 3"
OLDEST = 3, 0
"""The oldest firmware that the sources of this driver had."""
LIMITS_HEEDED, MOTOR_OFF, ABORT = 1 << 0, 1 << 1, 1 << 2


def examined(
    version: str, axis: int, limits: RotationLimits, line: EspLine, queued: Sequence[QueuedError], *, keypad: bool
) -> Iterator[Finding]:
    """One thing after the other; `queued` are errors that were in its queue, from before."""
    yield _firmware(version)
    yield _queue(queued)
    yield asked("capability", "stage", lambda: ok("capability", "stage", line.ask(f"{axis}ID?")), MANUAL)
    yield ok("capability", "keypad", "can be locked (LC)" if keypad else "cannot be locked: nobody may touch it")
    unit = asked("capability", "unit", partial(_unit, axis, line), MANUAL)
    yield unit
    if unit.outcome == "ok":
        yield asked("limits", "travel", partial(_travel, axis, limits, line), MANUAL)
        most_deg_s = line.ask_number(f"{axis}VU?")
        yield at_most("speed", limits.speed_deg_s, most_deg_s, "deg/s", "speed_deg_s")
        most_deg_s2 = line.ask_number(f"{axis}AU?")
        yield at_most("acceleration", limits.acceleration_deg_s2, most_deg_s2, "deg/s2", "acceleration_deg_s2")
    yield asked("limits", "hardware limits", partial(_limit_switches, axis, line), f"{MANUAL}, ZH")
    yield unknown(
        "motion", "sense", "no question tells which way the angle grows", "look from above, or `rigctl check --move`"
    )


def _firmware(version: str) -> Finding:
    number = re.search(r"(\d+)\.(\d+)", version)
    if number is None:
        return unknown("identity", "firmware", f"{version!r} names no version", MANUAL)
    if (int(number[1]), int(number[2])) < OLDEST:
        return differs(
            "identity",
            "firmware",
            f"{version}: older than {OLDEST[0]}.{OLDEST[1]}, which the driver was written for",
            "have it updated by the maker, or compare its commands with those of this driver and run --unchecked",
        )
    return ok("identity", "firmware", version)


def _queue(queued: Sequence[QueuedError]) -> Finding:
    if not queued:
        return ok("capability", "error queue", "empty")
    texts = "; ".join(f"{error.code} {error.text}" for error in queued)
    return ok("capability", "error queue", f"emptied of old errors: {texts}")


def _unit(axis: int, line: EspLine) -> Finding:
    number = round(line.ask_number(f"{axis}SN?"))
    called = UNITS[number] if 0 <= number < len(UNITS) else f"unit {number}"
    if number == UNIT_DEGREE:
        return ok("capability", "unit", called)
    mend = f"send {axis}SN{UNIT_DEGREE} and SM, then look whether its limits and speeds are those of the stage"
    return differs("capability", "unit", f"axis {axis} counts in {called}, not in deg", mend)


def _travel(axis: int, limits: RotationLimits, line: EspLine) -> Finding:
    there = line.ask_number(f"{axis}SL?"), line.ask_number(f"{axis}SR?")
    wanted = limits.angle_min_deg, limits.angle_max_deg
    return travel(wanted, there, "deg", ("angle_min_deg", "angle_max_deg"), "the controller's SL and SR")


def _limit_switches(axis: int, line: EspLine) -> Finding:
    answer = line.ask(f"{axis}ZH?").strip().upper()
    try:
        word = int(answer.removesuffix("H"), 16)
    except ValueError:
        raise BadReply(f"{line.name}: '{axis}ZH?' gave {answer!r}, no hexadecimal number") from None
    heeded, acted_on = bool(word & LIMITS_HEEDED), bool(word & (MOTOR_OFF | ABORT))
    if heeded and acted_on:
        return ok("limits", "hardware limits", f"ZH {answer}: heeded, and motion ends there")
    missing = "what to do at a limit switch (bits 1, 2)" if heeded else "heeding the limit switches (bit 0)"
    return unknown("limits", "hardware limits", f"ZH {answer}: {missing} may be switched off", f"{MANUAL}, ZH")
