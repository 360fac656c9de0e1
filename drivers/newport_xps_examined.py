"""What an XPS is asked before it moves anything: its names, its limits, its state and its errors.

Every function here is in the maker's programmer's manual and in the public drivers; none changes anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial

from drivers.examining import asked, at_most, refused, travel
from drivers.newport_xps_group import DISABLED, NOT_INITIALISED, NOT_REFERENCED, READY, XpsGroup
from rigctl.core.errors import InstrumentError
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.limits import RotationLimits

KNOWN = re.compile(r"XPS-(?:C8|Q8|D\d*|RL\d*)\b")
"""Families of firmware that the sources of this driver were written for."""
MANUAL = "the XPS programmer's manual of this firmware"
UNKNOWN_POSITIONER, UNKNOWN_GROUP = -18, -19
NAMES = "write the names of system.ini, [GROUPS] and its PositionerInUse (the controller's web pages show them)"
SENSE = (
    "look whether it turns counter-clockwise seen from above, or `rigctl check --move`; reverse the axis in the "
    "controller if not"
)


def examined(firmware: str, group: str, positioner: str, limits: RotationLimits, wire: XpsGroup) -> Iterator[Finding]:
    """One thing after the other; without its names nothing else can be asked."""
    yield _family(firmware)
    unknown_names = list(_unknown_names(group, positioner, wire))
    yield from unknown_names
    if unknown_names:
        return
    yield ok("capability", "names", f"group {group}, positioner {positioner}")
    yield asked("capability", "state", partial(_state, wire), MANUAL)
    yield asked("capability", "positioner error", partial(_error, positioner, wire), MANUAL)
    yield asked("capability", "profile", partial(_profile, positioner, wire), MANUAL)
    yield asked("limits", "travel", partial(_travel, positioner, limits, wire), MANUAL)
    yield from _maxima(positioner, limits, wire)
    yield unknown("motion", "sense and unit", "no question tells which way the angle grows, and in what unit", SENSE)


def _family(firmware: str) -> Finding:
    if KNOWN.search(firmware):
        return ok("identity", "firmware", firmware)
    return unknown("identity", "firmware", f"{firmware!r} is of no family known here", MANUAL)


def _unknown_names(group: str, positioner: str, wire: XpsGroup) -> Iterator[Finding]:
    if wire.query(f"GroupStatusGet({group},int *)").code == UNKNOWN_GROUP:
        yield differs("capability", "group", f"there is no group {group}", f"{NAMES}: group = ...")
    elif wire.query(f"PositionerErrorRead({positioner},int *)").code == UNKNOWN_POSITIONER:
        yield differs(
            "capability", "positioner", f"no positioner {positioner} is there", f"{NAMES}: positioner = ..."
        )


def _state(wire: XpsGroup) -> Finding:
    status = wire.status()
    found = f"{status}, {wire.status_text(status)}"
    if wire.safety_text(status):
        return differs("capability", "state", found, "remove what has stopped it, then `rigctl home` it")
    if status in READY or status in NOT_INITIALISED | DISABLED | {NOT_REFERENCED}:
        return ok("capability", "state", found if status in READY else f"{found}: to be homed")
    return differs("capability", "state", found, "look who moves it, and stop it")


def _error(positioner: str, wire: XpsGroup) -> Finding:
    # Read, and not cleared as PositionerErrorGet does: whoever mends it may want to see it as well.
    (word,) = wire.numbers(f"PositionerErrorRead({positioner},int *)", 1)
    if not word:
        return ok("capability", "positioner error", "none")
    text = wire.query(f"PositionerErrorStringGet({word:.0f},char *)").text or f"{word:.0f}"
    return differs("capability", "positioner error", text, "remove the cause, then `rigctl home` it")


def _profile(positioner: str, wire: XpsGroup) -> Finding:
    outputs = ",".join(["double *"] * 4)
    speed, acceleration, least_s, most_s = wire.numbers(f"PositionerSGammaParametersGet({positioner},{outputs})", 4)
    jerk = f"jerk times {least_s:g} and {most_s:g} s, which are kept"
    return ok("capability", "profile", f"{speed:g} deg/s, {acceleration:g} deg/s2, {jerk}")


def _travel(positioner: str, limits: RotationLimits, wire: XpsGroup) -> Finding:
    low_deg, high_deg = wire.numbers(f"PositionerUserTravelLimitsGet({positioner},double *,double *)", 2)
    wanted = limits.angle_min_deg, limits.angle_max_deg
    keys = "angle_min_deg", "angle_max_deg"
    return travel(wanted, (low_deg, high_deg), "deg", keys, "the stage's user travel limits")


def _maxima(positioner: str, limits: RotationLimits, wire: XpsGroup) -> Iterator[Finding]:
    request = f"PositionerMaximumVelocityAndAccelerationGet({positioner},double *,double *)"
    try:
        speed_deg_s, acceleration_deg_s2 = wire.numbers(request, 2)
    except InstrumentError as error:
        yield refused("limits", "speed", error, MANUAL)
        return
    yield at_most("speed", limits.speed_deg_s, speed_deg_s, "deg/s", "speed_deg_s")
    yield at_most("acceleration", limits.acceleration_deg_s2, acceleration_deg_s2, "deg/s2", "acceleration_deg_s2")
