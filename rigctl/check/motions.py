"""Small motions that somebody watches: a millimetre, a degree, and what only motion tells of an instrument."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rigctl.check import lasers
from rigctl.check.asking import Tell
from rigctl.check.hands import Hands
from rigctl.core.errors import RigError
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.interfaces import LearnsByMoving, LinearStage, RotationStage, Stage
from rigctl.rig import Rig

MILLIMETRE, DEGREE = 1.0, 1.0
ENCODER_TOLERANCE = 0.01
"""Of the motion: how far the position may be off once it has ended."""
AT_ZERO = 0.01
"""Of a millimetre or a degree: what stands so near is not moved there."""
SPARE = "spare"
MOUNTING_S, PATIENCE_S = 900.0, 60.0
"""How long mounting takes, rig time, and how long a check waits for it on the wall clock."""
MOUNTING_ACTION = "Mount the package, its faces before the heads, with both stages where they are now."


class Motions:
    """Moves one stage after the other and back."""

    def __init__(self, rig: Rig, hands: Hands, tell: Tell) -> None:
        self._learned: dict[str, dict[str, str]] = {}
        self._rig = rig
        self._hands = hands
        self._tell = tell
        self._package_mounted = False

    def try_all(self) -> dict[str, dict[str, str]]:
        """Home, move, learn; what fails with one stage keeps nobody from the next.

        Returns what was learned: keys of the rig file with their values, by instrument.
        """
        roles = {name: table.role for name, table in self._rig.file.instruments.items()}
        # A spare one has no part in the experiment, and is left alone.
        stages = [
            (name, each)
            for name, each in self._rig.instruments.items()
            if isinstance(each, Stage) and roles[name] != SPARE
        ]
        homed = [(name, each) for name, each in stages if self._attempt(name, "homing", self._home, each)]
        # To the middle first: there the heads see the cube.
        placed = [(name, each) for name, each in homed if self._attempt(name, "to zero", self._to_zero, each)]
        self._mount()
        for name, stage in placed:
            if isinstance(stage, LinearStage):
                self._attempt(name, "a millimetre", self._millimetre, stage)
            elif isinstance(stage, RotationStage):
                self._attempt(name, "a degree", self._degree, stage)
        for name, stage in placed:
            if isinstance(stage, LearnsByMoving):
                self._attempt(name, "what only motion tells", self._learn, stage)
        if stages:
            self._tell("", self._level())
        return self._learned

    def _attempt(self, name: str, what: str, act: Callable[[Any], bool], stage: Any) -> bool:
        try:
            return act(stage)
        except RigError as error:
            words, _, mend = str(error).rpartition("; ")
            self._tell(name, differs("motion", what, words or mend, mend))
            return False

    def _home(self, stage: Stage) -> bool:
        if not stage.is_homed():
            if not self._hands.confirm(f"MOVES: {stage.name} is homed, and may travel its whole range."):
                self._tell(stage.name, unknown("motion", "homing", "skipped", f"`rigctl home` {stage.name}"))
                return False
            stage.home()
        self._tell(stage.name, ok("motion", "homing", "homed"))
        return True

    def _to_zero(self, stage: Any) -> bool:
        now = stage.position() if isinstance(stage, LinearStage) else stage.angle()
        zero = self._inside(stage, 0.0)
        there = abs(now.value - zero) < AT_ZERO
        if there or self._hands.confirm(f"MOVES: {stage.name} from {now.value:g} to {zero:g} {now.unit}."):
            if not there:
                stage.move_to(zero)
            return True
        self._tell(stage.name, unknown("motion", "to zero", "skipped", "check --move again"))
        return False

    def _mount(self) -> None:
        """The package, where somebody or a simulated operator can; without it the heads see nothing."""
        package, link = self._rig.file.package, self._rig.operator_link
        if package is None or not package.axes or not self._rig.by_role("displacement"):
            return
        # Where every head sees something there is something before it.
        if not any(map(math.isnan, lasers.readings_mm(self._rig).values())):
            return
        if link is None:
            self._hands.confirm(MOUNTING_ACTION)
            return
        # Simulated hands take their time too, which on a slow clock nobody waits for.
        if MOUNTING_S / self._rig.clock.speed > PATIENCE_S:
            return
        seat = {"axis": next(iter(package.axes)), "configuration": next(iter(package.configurations)), "mounting": 1}
        link.request({"remount": seat})

    def _millimetre(self, stage: LinearStage) -> bool:
        start_mm = stage.position().value
        target_mm = self._inside(stage, start_mm + MILLIMETRE)
        if not self._hands.confirm(f"MOVES: {stage.name} from {start_mm:g} to {target_mm:g} mm and back."):
            self._tell(stage.name, unknown("motion", "a millimetre", "skipped", "check --move again"))
            return False
        before = lasers.readings_mm(self._rig)
        stage.move_to(target_mm)
        moved_mm = stage.position().value - start_mm
        changed = lasers.changes_mm(before, lasers.readings_mm(self._rig))
        stage.move_to(start_mm)
        self._tell(stage.name, _arrived("a millimetre", moved_mm, target_mm - start_mm, "mm"))
        for head, finding in lasers.along_x(self._rig.file.heads, moved_mm, changed).items():
            self._tell(self._controller_of(head), finding)
        return True

    def _degree(self, stage: RotationStage) -> bool:
        start_deg = stage.angle().value
        target_deg = self._inside(stage, start_deg + DEGREE)
        if not self._hands.confirm(f"MOVES: {stage.name} from {start_deg:g} to {target_deg:g} deg and back."):
            self._tell(stage.name, unknown("motion", "a degree", "skipped", "check --move again"))
            return False
        before = lasers.readings_mm(self._rig)
        stage.move_to(target_deg)
        turned_deg = stage.angle().value - start_deg
        changed = lasers.changes_mm(before, lasers.readings_mm(self._rig))
        stage.move_to(start_deg)
        self._tell(stage.name, _arrived("a degree", turned_deg, target_deg - start_deg, "deg"))
        self._tell(stage.name, self._sense(turned_deg, changed))
        return True

    def _sense(self, turned_deg: float, changed_mm: dict[str, float]) -> Finding:
        package = self._rig.file.package
        for head, settings in self._rig.file.heads.items():
            if head in changed_mm and settings.position.endswith("x") and package is not None and package.lever_mm:
                return lasers.about_z(head, settings, package.lever_mm, turned_deg, changed_mm[head])
        answer = self._hands.ask("Did it turn counter-clockwise seen from above?", ("yes", "no"))
        if answer == "yes":
            return ok("motion", "sense", "counter-clockwise, somebody saw")
        if answer == "no":
            return differs("motion", "sense", "clockwise, somebody saw", "reverse the axis in the controller")
        return unknown("motion", "sense", "no head sees it, and nobody said", "look from above while it turns")

    def _learn(self, stage: Any) -> bool:
        unknowns = stage.unknown_until_moved()
        if not unknowns:
            return True
        learnt = ", ".join(unknowns)
        if not self._hands.confirm(f"MOVES: {stage.name} by a millimetre at most, to learn {learnt}."):
            return False
        for learned in stage.learn_by_moving():
            self._learned.setdefault(stage.name, {})[learned.key] = learned.value
            found = f"{learned.value}: it went {learned.measured}; kept, and used where the rig file does not say"
            self._tell(stage.name, ok("motion", learned.key, found))
        return True

    def _level(self) -> Finding:
        question = "With a level on the moved stages: does it stay within what their data sheets say?"
        match self._hands.ask(question, ("yes", "no")):
            case "yes":
                return ok("motion", "level", "stays, somebody saw")
            case "no":
                return differs("motion", "level", "does not stay, somebody saw", "level the bench, look at its feet")
            case _:
                mend = "put a level on each stage and move it over its range (`rigctl move`)"
                return unknown("motion", "level", "nobody has looked", mend)

    def _inside(self, stage: Any, target: float) -> float:
        """The target, or as far to the other side, or the nearest that the limits allow."""
        limits = stage.limits
        low, high = (
            (limits.position_min_mm, limits.position_max_mm)
            if isinstance(stage, LinearStage)
            else (limits.angle_min_deg, limits.angle_max_deg)
        )
        return float(min(max(target, low), high))

    def _controller_of(self, head: str) -> str:
        """The instrument that has a head."""
        meters = self._rig.by_role("displacement")
        return next(str(each.name) for each in meters if head in {channel.name for channel in each.channels()})


def _arrived(item: str, moved: float, wanted: float, unit: str) -> Finding:
    found = f"its encoder shows {moved:+.4f} {unit} of {wanted:+g}"
    if abs(moved - wanted) <= ENCODER_TOLERANCE * abs(wanted):
        return ok("motion", item, found)
    return differs("motion", item, found, "look what holds it, and at its counts per unit")
