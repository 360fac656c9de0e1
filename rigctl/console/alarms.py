"""What needs the operator as long as it is so, worked out from what the store and the instruments say now."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rigctl.campaign.store.entries import BACK, LOST, RESUMED
from rigctl.console.readings import InstrumentView, simulated_here
from rigctl.console.store_view import StoreView
from rigctl.console.vitals import Vitals
from rigctl.core.making_safe import Rest
from rigctl.report.quantities import duration

if TYPE_CHECKING:
    from rigctl.analysis.run_misfit import RunMisfit
    from rigctl.campaign.store.entries import Event


@dataclass(frozen=True)
class Alarm:
    """One thing: `key` says which, so that it rings once; `text` may change with time."""

    key: str
    text: str


def alarms_of(
    view: StoreView | None,
    vitals: Vitals | None,
    instruments: Sequence[InstrumentView],
    unsafe: Iterable[Rest],
    far: Sequence[RunMisfit] = (),
) -> list[Alarm]:
    """The most urgent first: what may move, what is lost, what stands still, what is asked, what does not fit."""
    found = [Alarm(f"unsafe {rest.instrument}", f"{rest}; look at it") for rest in unsafe]
    found += [Alarm(f"{each.state} {each.name}", _of_instrument(each)) for each in instruments if each.state in WRONG]
    if view is not None:
        found += _of_campaign(view, vitals)
    return found + _of_misfits(far)


WRONG = {"lost": "LOST", "silent": "SILENT"}


def _of_instrument(view: InstrumentView) -> str:
    why = view.error.removeprefix(f"{view.name}: ")
    return f"{view.name} {WRONG[view.state]}{f': {why}' if why else ': it does not answer'}"


def _of_misfits(far: Sequence[RunMisfit]) -> list[Alarm]:
    if not far:
        return []
    worst = max(far, key=lambda each: abs(each.sigma))
    others = f" (and {len(far) - 1} more)" if len(far) > 1 else ""
    text = f"Run {worst.run_id} is {abs(worst.sigma):.3g} sigma off the model in {worst.channel}{others}: 2 m, 4 g"
    return [Alarm(f"far {' '.join(each.run_id for each in far)}", text)]


def _lost(events: Sequence[Event]) -> Mapping[str, Any] | None:
    """What is told of the instrument that a campaign waits for; None while it has all."""
    last = next((event for event in reversed(events) if event.kind in {LOST, BACK, RESUMED}), None)
    return last.data if last is not None and last.kind == LOST else None


def _of_campaign(view: StoreView, vitals: Vitals | None) -> list[Alarm]:
    found = []
    if view.alive and (lost := _lost(view.events)) is not None:
        told = f"{lost['instrument']} LOST: {str(lost['text']).removeprefix(lost['instrument'] + ': ')}"
        found.append(Alarm(f"lost {view.path} {lost['instrument']}", f"{told}. The campaign waits until it answers"))
    if view.killed and not simulated_here(view):
        text = "The campaign's process is gone without a word; nothing is known of its instruments. F8 stops them"
        found.append(Alarm(f"killed {view.path}", text))
    if vitals is not None and vitals.path == view.path and vitals.stalled:
        age = duration(vitals.beat_age_s())
        found.append(Alarm(f"stalled {view.path}", f"STALLED: no sign of life of the campaign for {age}. F8 stops"))
    if view.question is not None:
        asked = view.question.text.partition(" Type ")[0]
        found.append(Alarm(f"question {view.path} {view.question.number}", f"OPERATOR: {asked}  (F9 answers)"))
    elif vitals is not None and vitals.path == view.path and vitals.silent and view.state == "running":
        text = f"Nothing recorded for {duration(vitals.written_age_s())}, at: {view.status.get('step') or 'start'}"
        found.append(Alarm(f"silent {view.path}", text))
    return found
