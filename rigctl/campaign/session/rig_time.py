"""Where a campaign's rig time was when it was interrupted, and how a resumed one takes it up again.

Nature goes by rig time: temperatures drift, tides turn. On a virtual clock a resumed campaign therefore prepares
before the last recorded step was over, waits for that moment, and goes on as if nobody had disturbed it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime, timedelta

from rigctl.campaign.store.entries import RUN_ENDED, Event
from rigctl.campaign.store.store import Store
from rigctl.core.clock import Clock

PREPARING_S = 86400.0
"""Rig time in which instruments can be homed, and a package mounted, before a campaign goes on."""


class Resumption:
    """What is taken up again: the steps of a campaign that its store holds."""

    def __init__(self, store: Store, clock: Clock) -> None:
        self._clock = clock
        self._ended_s = ended_s(store)
        self._reached_s: float | None = None
        self.restore: Callable[[], None] = lambda: None

    def replayed(self, key: str) -> None:
        """This step is recorded."""
        self._reached_s = self._ended_s.get(key, self._reached_s)

    def take_up(self) -> None:
        """On a virtual clock restore what was left, once, and wait until the last recorded step was over."""
        # On the wall's clock the moment is past; what drifts is met at another time (docs/decisions/032).
        if self._reached_s is None or not math.isinf(self._clock.speed):
            return
        self.restore()
        _wait_until(self._clock, self._reached_s)
        # Once only: from here on the campaign's own steps move the clock.
        self._reached_s = None


def ended_s(store: Store) -> dict[str, float]:
    """The rig time at which each recorded step was over, by its key."""
    runs = {run.key for run in store.runs()}
    events = [*store.events("once"), *(event for event in store.events(RUN_ENDED) if event.data["key"] in runs)]
    return {event.data["key"]: event.rig_time_s for event in events if event.rig_time_s is not None}


def began_at(end: Event, began_s: object) -> datetime | None:
    """The time of day at which a run began, by the event of its end and the rig time of its beginning; None where
    one of them is not known.
    """
    # From the run's end: the rig time at which a clock began is kept nowhere.
    if end.rig_time_s is None or not isinstance(began_s, int | float) or not math.isfinite(began_s):
        return None
    return datetime.fromisoformat(end.time) - timedelta(seconds=end.rig_time_s - began_s)


def start_s(store: Store, part: int, *, virtual: bool) -> float:
    """The rig time from which a rig's own clock runs when campaign number `part` of a store begins or goes on."""
    # A wall clock cannot be put back: rig time goes on from the last event.
    if not virtual:
        return latest_s(store)
    recorded = [time_s for key, time_s in ended_s(store).items() if _of(part, key)]
    if recorded:
        return max(recorded) - PREPARING_S
    began = [event.rig_time_s for event in store.events("extended") if event.data["part"] == part]
    if began:
        return began[0] or 0.0
    return latest_s(store) if part > 1 else 0.0  # not begun, or killed before it could tell when


def latest_s(store: Store) -> float:
    """The rig time of the last event."""
    return max((event.rig_time_s or 0.0 for event in store.events()), default=0.0)


def _of(part: int, key: str) -> bool:
    return key.startswith(f"part {part}: ") if part > 1 else not key.startswith("part ")


def _wait_until(clock: Clock, at_s: float) -> None:
    """To the last bit: the last second is a difference that is exact."""
    # A difference of two near numbers is exact, so the last sleep ends on `at_s` itself, not a rounding beside it.
    while (left_s := at_s - clock.now_s()) > 0.0:
        clock.sleep_s(left_s - 1.0 if left_s > 2.0 else left_s)
