"""The emergency stop, pressed by hand: does the program see it at every stage?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rigctl.check.asking import Tell
from rigctl.check.hands import Hands
from rigctl.core.clock import Clock
from rigctl.core.errors import RigError
from rigctl.core.findings import Finding, differs, ok, unknown
from rigctl.core.interfaces import Stage
from rigctl.rig import Rig

PRESS_S = 60.0
"""How long a press is waited for where nobody can type."""
DONE_S = 2.0
"""How long after 'done' the controller may take to tell."""
WIRING = "docs/wiring.md"


def try_interlocks(rig: Rig, hands: Hands, tell: Tell) -> None:
    """Ask for the emergency stop at every stage, then about interlocks."""
    stages = [each for each in rig.instruments.values() if isinstance(each, Stage)]
    for stage in stages:
        try:
            tell(stage.name, _pressed(stage, rig.clock, hands))
        except RigError as error:
            tell(stage.name, differs("interlock", "emergency stop", str(error), WIRING))
    if stages:
        tell("", _interlock(hands))


def _pressed(stage: Stage, clock: Clock, hands: Hands) -> Finding:
    item = "emergency stop"
    if already := stage.safety_stop():
        return differs(
            "interlock",
            item,
            f"stopped already: {already}",
            f"release it, then `rigctl home` {stage.name}",
        )
    if not stage.is_homed():
        mend = f"home it first (`rigctl home`, or --move with --interlocks): {stage.name} shows it only when it is on"
        return unknown("interlock", item, "not tested: the stage is not homed", mend)
    request = f"{stage.name}: press its emergency stop now, and release it when told."
    answer = hands.ask(request, ("done", "skip"), stage.safety_stop, PRESS_S)
    if answer == "done":
        answer = _within(clock, DONE_S, stage.safety_stop) or "done"
    if answer == "done":
        mend = "does it cut this stage's power alone? Wire it to the controller as well"
        return differs("interlock", item, "pressed, and the controller does not tell", f"{mend} ({WIRING})")
    if answer in ("skip", ""):
        return unknown("interlock", item, "not tested: nobody pressed it", f"press it when asked; {WIRING}")
    moves = stage.is_moving()
    hands.say(f"{stage.name}: seen ({answer}). Release it; `rigctl home` makes the stage ready again.")
    if moves:
        return differs("interlock", item, f"seen ({answer}), but it MOVES", f"cut its power; {WIRING}")
    return ok("interlock", item, f"pressed by hand and seen: {answer}")


def _within(clock: Clock, wait_s: float, look: Callable[[], str]) -> str:
    end_s = clock.now_s() + wait_s
    while not (seen := look()) and clock.now_s() < end_s:
        clock.sleep_s(wait_s / 20.0)
    return seen


def _interlock(hands: Hands) -> Finding:
    ask = partial(hands.ask, "Does every interlock (door, cover, travel switch), tried by hand, stop the stages?")
    match ask(("yes", "no", "none")):
        case "yes":
            return ok("interlock", "door, cover, travel", "tried by hand, each stops the stages")
        case "no":
            return differs("interlock", "door, cover, travel", "one does not stop the stages", WIRING)
        case "none":
            return ok("interlock", "door, cover, travel", "there are none, somebody says")
        case _:
            return unknown("interlock", "door, cover, travel", "nobody has answered", f"try each by hand; {WIRING}")
