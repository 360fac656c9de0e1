"""Whether every fault that touched a run is told of: when the simulators say it struck, against the events."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.entries import Event
from rigctl.campaign.store.store import Store
from simulators.measured import Measurement, from_file

FAULT = "fault "
MARGIN_S = 1.0
"""Rounding of rig times, and what a reply takes on its way."""

TELLING = (
    "fault",
    "instrument-lost",
    "run-repeated",
    "step-repeated",
    "mounting-lost",
    "temperature-missed",
    "found-moving",
    "remark",
    "failed",
    "record-lost",
    "gap",
)
"""Events that say that something has happened."""

UNTOLD_BY_SIMULATORS = ("refused", "clock_drift")
"""Faults that strike without a word where nobody listens: a port that is closed, a clock that is always wrong."""


@dataclass(frozen=True)
class Strike:
    """A fault and when it struck."""

    fault: str
    at_s: float


def unaccounted(store_path: Path, measured_path: Path, planned: Iterable[str], *, own_clock: bool = False) -> str:
    """The first fault that touched a run without an event, or event without a fault; "" when there is none.

    With `own_clock`, the rig's, times of faults and of events are not compared.
    A run that a fault left as it was is valid and equal to the truth (`truth.wrong_number`), and needs no event.
    """
    if not store_path.exists():
        return ""
    strikes = _strikes(from_file(measured_path)) if measured_path.exists() else []
    with Store.open(store_path, readonly=True) as store:
        events = [event for event in store.events() if event.kind in TELLING]
        spoilt = [run for run in (*store.interrupted_runs(), *store.runs()) if not run.valid]
    silent = not own_clock and all(fault not in UNTOLD_BY_SIMULATORS for fault in planned)
    return _spoilt_untold(spoilt, events) or (_alarm_without_fault(strikes, events) if silent else "")


def _strikes(measurements: Iterable[Measurement]) -> list[Strike]:
    return [
        Strike(f"{each.channel.removeprefix(FAULT)} of {each.instrument}", float(at_s))
        for each in measurements
        if each.channel.startswith(FAULT)
        for at_s in each.at_s
    ]


def _spoilt_untold(spoilt: list[RunRecord], events: list[Event]) -> str:
    """Each run that is not valid has its reason, and an event of that run."""
    told = defaultdict(list)
    for event in events:
        for key in {str(event.data.get(name)) for name in ("key", "during", "run")}:
            told[key].append(event)
    for run in spoilt:
        if not run.reason:
            return f"run {run.run_id} is not valid and has no reason"
        if run.state == "interrupted" and not told[run.key] and not any(event.kind == "failed" for event in events):
            return f"run {run.run_id} ({run.key}) was given up ({run.reason}), and no event says so"
    return ""


def _alarm_without_fault(strikes: list[Strike], events: list[Event]) -> str:
    """Each event of a fault follows one."""
    first_s = min((strike.at_s for strike in strikes), default=math.inf)
    for event in events:
        if event.kind == "fault" and (event.rig_time_s or 0.0) < first_s - MARGIN_S:
            return f"an event tells of a fault before there was one: {event.data.get('text')}"
    return ""
