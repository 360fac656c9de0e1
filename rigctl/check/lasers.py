"""What displacement heads see of a known motion: which head, which sign, which scale.

Signs and geometry are those of docs/physics.md: readings grow as a face moves towards its head; a beam tilted by t
reads a motion along the face's normal 1 / cos(t) times too large.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.files.package import HeadSettings, unit_vector
from rigctl.rig import Rig

MOUNTED_WITHIN_RAD = 3 * 15e-3
"""Three standard deviations of how far off a mounted cube may stand."""
CLEARLY = 0.5
"""Of the motion: a head that sees this much sees it, with another sign or scale."""

Readings = Mapping[str, float]


def readings_mm(rig: Rig) -> dict[str, float]:
    """Every head of the rig now; NaN where it has no valid value."""
    values: dict[str, float] = {}
    for meter in rig.by_role("displacement"):
        heads = [channel.name for channel in meter.channels()]
        values |= {head: reading.value for head, reading in zip(heads, meter.displacements(), strict=True)}
    return values


def changes_mm(before: Readings, after: Readings) -> dict[str, float]:
    """By how much every head's reading has changed."""
    return {head: after[head] - before[head] for head in before}


def along_x(heads: Mapping[str, HeadSettings], moved_mm: float, changed_mm: Readings) -> dict[str, Finding]:
    """What each head should have seen of a motion along the lab's x, and what it has."""
    expected = {head: _expected(settings, moved_mm) for head, settings in heads.items() if head in changed_mm}
    found = {head: _seen(head, heads[head], wanted, changed_mm[head], moved_mm) for head, wanted in expected.items()}
    blind = [head for head, wanted in expected.items() if wanted and abs(changed_mm[head]) < CLEARLY * abs(moved_mm)]
    seeing = [
        head for head, wanted in expected.items() if not wanted and abs(changed_mm[head]) > CLEARLY * abs(moved_mm)
    ]
    if len(blind) == len(seeing) == 1:
        del found[seeing[0]]
        found[blind[0]] = _swapped(blind[0], seeing[0], heads, changed_mm)
    return found


def about_z(head: str, settings: HeadSettings, lever_mm: float, turned_deg: float, changed_mm: float) -> Finding:
    """What a head at +-x should have seen of a turn that carries the cube along, which stands on its y axis."""
    item = f"sense, by {head}"
    if math.isnan(changed_mm):
        return unknown("motion", item, "the head has no valid value", "mount the package, or look from above")
    # Counter-clockwise turns +y towards -x: a head at +x sees the face go away.
    along_x_mm = -lever_mm * math.sin(math.radians(turned_deg))
    wanted_mm = along_x_mm * unit_vector(settings.position)[0] / math.cos(settings.tilt_rad)
    ratio = changed_mm / wanted_mm
    told = f"{turned_deg:+g} deg changed it by {changed_mm:+.3f} mm, {wanted_mm:+.3f} mm expected with lever_mm"
    # The lever and the mounting are known to some per cent.
    if abs(ratio - 1.0) < 0.1:
        return ok("motion", item, f"counter-clockwise: {told}")
    if abs(ratio + 1.0) < 0.1:
        return differs("motion", item, f"clockwise: {told}", "reverse the axis in the controller")
    mend = "is the angle in degrees, lever_mm right, and the cube's middle on the turntable's +y?"
    return differs("motion", item, f"{told}: {ratio:.3g} of it", mend)


def _expected(settings: HeadSettings, moved_mm: float) -> float:
    return float(unit_vector(settings.position)[0]) * moved_mm / math.cos(settings.tilt_rad)


def _seen(head: str, settings: HeadSettings, wanted_mm: float, changed_mm: float, moved_mm: float) -> Finding:
    item = head
    if math.isnan(changed_mm):
        mend = "mount the package with its faces before the heads, both stages at 0, and check again"
        return unknown("motion", item, "it has no valid value", mend)
    told = f"{moved_mm:+.4f} mm of the stage changed it by {changed_mm:+.4f} mm, {wanted_mm:+.4f} mm expected"
    # A cube that stands off turns the normal of its face: across it by that angle, along it by the beam's tilt of it.
    allowed = MOUNTED_WITHIN_RAD * (math.tan(abs(settings.tilt_rad)) + MOUNTED_WITHIN_RAD if wanted_mm else 1.0)
    if abs(changed_mm - wanted_mm) <= allowed * abs(moved_mm):
        return ok("motion", item, told)
    if wanted_mm and abs(changed_mm + wanted_mm) <= allowed * abs(moved_mm):
        mend = "reverse the sign of its output in the controller, or is the stage's axis reversed?"
        return differs("motion", item, f"the wrong sign: {told}", mend)
    mend = "is it the head that [lasers] says, its scale that of the rig file, its tilt_deg right?"
    return differs("motion", item, told, mend)


def _swapped(blind: str, seeing: str, heads: Mapping[str, HeadSettings], changed_mm: Readings) -> Finding:
    places = f"{blind} at {heads[blind].position} saw {changed_mm[blind]:+.4f} mm of the motion along x"
    other = f"{seeing} at {heads[seeing].position} saw {changed_mm[seeing]:+.4f} mm"
    return differs(
        "motion", "heads", f"{places}, {other}: the two are exchanged", f"exchange {blind} and {seeing} in `heads`"
    )
