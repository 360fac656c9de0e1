"""How far a campaign is, for the store's status row and for a terminal."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Protocol

from rigctl.campaign.store.store import Store
from rigctl.core.clock import utc_now

PUBLISH_S = 0.2
"""Least wall-clock time between two status rows."""


class Display(Protocol):
    """Somebody who shows progress."""

    def show(self, status: dict[str, object]) -> None:
        """The status as `rigctl status --json` gives it."""


class Progress:
    """Counts runs, guesses the time left, and writes it where others can read it.

    `runs_before` were measured by earlier campaigns of the store. What is left is reckoned from runs and from
    mountings, each by what those of this process took: the half hour of one mounting says nothing of runs of seconds,
    and a pause nothing of either.
    """

    def __init__(self, store: Store, display: Display | None = None, runs_before: int = 0) -> None:
        self._store = store
        self._display = display
        self._state = "running"
        self._step = ""
        self._before = runs_before
        # After a restart what was planned holds until the procedure says it anew.
        self._planned = max(runs_before, int(store.status().get("runs_planned", 0)))
        # After a restart all that is recorded is replayed before anything is measured.
        self._recorded, self._recorded_invalid = store.run_counts()
        self._done = runs_before
        self._invalid = 0
        self._measured = 0.0
        self._measuring_s = 0.0
        self._takes: Sequence[float] = ()
        self._mountings = self._mounted = self._mounted_here = 0
        self._paused_s = 0.0
        self._paused_at_s: float | None = None
        self._began_s = self._run_began_s = time.monotonic()
        self._published = -math.inf

    def at(self, step: str) -> None:
        """The procedure is in this step; written at once, as a person may be waited for in it."""
        self._step = step
        self._publish(at_once=True)

    def told(self, step: str) -> None:
        """The same step says how far it is, as often as it likes."""
        self._step = step
        self._publish()

    def plan(self, runs: int, takes: Sequence[float] = (), mountings: int = 0) -> None:
        """Runs and mountings the campaign will have, and what each run takes, in any unit, if that differs."""
        self._planned = self._before + runs
        self._takes = takes
        self._mountings = mountings
        self._publish(at_once=True)

    def mounted(self, *, replayed: bool) -> None:
        """Something was mounted, now or, `replayed`, before a restart."""
        self._mounted += 1
        self._mounted_here += not replayed

    def begins(self) -> None:
        """A run begins to be measured; what has passed since the one before was no run's."""
        self._run_began_s = self._worked_s()

    def replayed(self, *, valid: bool, runs: int = 1) -> None:
        """A run, or several, that was recorded before a restart."""
        # `_measured` stays: an answer from the store takes no time and would make the pace look too fast.
        self._done += runs
        self._invalid += not valid

    def ran(self, *, valid: bool, runs: int = 1) -> None:
        """A run was measured, or several were."""
        self._measured += self._take(self._done, self._done + runs)
        now_s = self._worked_s()
        self._measuring_s += now_s - self._run_began_s
        self._run_began_s = now_s
        self._done += runs
        self._invalid += not valid
        self._publish()

    def state(self, state: str) -> None:
        """running, paused, done, aborted or interrupted; written at once."""
        now_s = time.monotonic()
        if self._paused_at_s is not None:
            self._paused_s += now_s - self._paused_at_s
        self._paused_at_s = now_s if state == "paused" else None
        self._state = state
        self._publish(durable=True)

    def _publish(self, *, at_once: bool = False, durable: bool = False) -> None:
        if not (at_once or durable) and time.monotonic() - self._published < PUBLISH_S:
            return
        self._published = time.monotonic()
        status = {**self.status(), "updated": utc_now()}
        # Synced at a change of state only: progress that a power cut takes away is told again by the next row.
        self._store.set_status(status, durable=durable)
        if self._display is not None:
            self._display.show(status)

    def status(self) -> dict[str, object]:
        """The keys of `rigctl status --json`."""
        done = max(self._done, self._recorded)
        return {
            "state": self._state,
            "step": self._step,
            "runs_done": done,
            # A search may need more runs than were planned.
            "runs_planned": max(self._planned, done),
            "runs_invalid": max(self._invalid, self._recorded_invalid),
            "eta_s": self._left_s(),
        }

    def _left_s(self) -> float | None:
        """Of this process alone: how long earlier ones took is not kept."""
        if not self._measured:
            return None
        left_s = self._take(self._done, self._planned) * self._measuring_s / self._measured
        if self._mounted_here:
            # Whatever was no run's belongs to mountings: hands, levelling, homing.
            mounting_s = (self._worked_s() - self._began_s - self._measuring_s) / self._mounted_here
            left_s += max(self._mountings - self._mounted, 0) * mounting_s
        return round(left_s, 1)

    def _worked_s(self) -> float:
        """On the monotonic clock, which stands still in a pause."""
        now_s = time.monotonic() if self._paused_at_s is None else self._paused_at_s
        return now_s - self._paused_s

    def _take(self, first: int, last: int) -> float:
        """What runs from number `first` to before `last` take together; one each where nothing else is known."""
        if not self._takes:
            return max(last - first, 0)
        return sum(self._takes[first - self._before : last - self._before])
