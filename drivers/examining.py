"""What examinations of different instruments have in common: limits compared, questions that may be refused."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.core.errors import InstrumentError
from rigctl.core.findings import Finding, Step, differs, ok, unknown

Range = tuple[float, float]


def asked(step: Step, item: str, look: Callable[[], Finding], look_up: str) -> Finding:
    """What `look` finds; `unknown`, with what to look up, where the instrument refuses the question."""
    try:
        return look()
    except InstrumentError as error:
        return refused(step, item, error, look_up)


def refused(step: Step, item: str, error: InstrumentError, look_up: str) -> Finding:
    """That the instrument does not answer this question as its manual says."""
    return unknown(step, item, f"the question is refused: {error}", look_up)


def travel(wanted: Range, there: Range, unit: str, keys: tuple[str, str], called: str) -> Finding:
    """The rig file's limits against those set in the controller, which are `called` so."""
    (low, high), (least, most) = wanted, there
    found = f"{low:g} to {high:g} {unit} in the rig file, {called} are {least:g} to {most:g} {unit}"
    if least <= low and high <= most:
        return ok("limits", "travel", found)
    narrowed = {keys[0]: max(low, least), keys[1]: min(high, most)}
    if not narrowed[keys[0]] < narrowed[keys[1]]:
        return differs("limits", "travel", found, f"widen {called}: the two have nothing in common")
    written = " and ".join(f"{key} = {value:g}" for key, value in narrowed.items())
    return differs("limits", "travel", found, f"write {written}, or widen {called}", narrowed)


def at_most(item: str, wanted: float, most: float, unit: str, key: str) -> Finding:
    """A speed or an acceleration of the rig file against the largest that the controller allows."""
    found = f"{wanted:g} {unit} in the rig file, the controller allows {most:g} {unit}"
    if wanted <= most:
        return ok("limits", item, found)
    if most <= 0.0:
        return differs("limits", item, found, f"raise the controller's own: no {key} can be as small")
    return differs("limits", item, found, f"write {key} = {most:g}", {key: most})
