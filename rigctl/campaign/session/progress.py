"""How far a campaign is, for the store's status row and for a terminal."""

from __future__ import annotations

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

    `runs_before` were measured by earlier campaigns of the store.
    """

    def __init__(self, store: Store, display: Display | None = None, runs_before: int = 0) -> None:
        self._store = store
        self._display = display
        self._state = "running"
        self._step = ""
        self._before = runs_before
        # After a restart what was planned holds until the procedure says it anew.
        self._planned = max(runs_before, int(store.status().get("runs_planned", 0)))
        self._done = runs_before
        self._invalid = 0
        self._measured = 0.0
        self._takes: Sequence[float] = ()
        self._began = time.monotonic()
        self._published = 0.0

    def at(self, step: str) -> None:
        """The procedure is in this step."""
        self._step = step
        self._publish()

    def plan(self, runs: int, takes: Sequence[float] = ()) -> None:
        """How many runs the campaign will have, and what each takes, in any unit, where they differ."""
        self._planned = self._before + runs
        self._takes = takes
        self._publish()

    def replayed(self, *, valid: bool, runs: int = 1) -> None:
        """A run, or several, that was recorded before a restart."""
        # `_measured` stays: an answer from the store takes no time and would make the pace look too fast.
        self._done += runs
        self._invalid += not valid

    def ran(self, *, valid: bool, runs: int = 1) -> None:
        """A run was measured, or several were."""
        self._measured += self._take(self._done, self._done + runs)
        self._done += runs
        self._invalid += not valid
        self._publish()

    def state(self, state: str) -> None:
        """running, paused, done, aborted or interrupted; written at once."""
        self._state = state
        self._publish(durable=True)

    def _publish(self, *, durable: bool = False) -> None:
        if not durable and time.monotonic() - self._published < PUBLISH_S:
            return
        self._published = time.monotonic()
        status = {**self.status(), "updated": utc_now()}
        # Synced at a change of state only: progress that a power cut takes away is told again by the next row.
        self._store.set_status(status, durable=durable)
        if self._display is not None:
            self._display.show(status)

    def status(self) -> dict[str, object]:
        """The keys of `rigctl status --json`."""
        left = self._take(self._done, self._planned)
        # Of this process alone: how long earlier ones took is not kept.
        pace_s = (time.monotonic() - self._began) / self._measured if self._measured else None
        return {
            "state": self._state,
            "step": self._step,
            "runs_done": self._done,
            # A search may need more runs than were planned.
            "runs_planned": max(self._planned, self._done),
            "runs_invalid": self._invalid,
            "eta_s": None if pace_s is None else round(left * pace_s, 1),
        }

    def _take(self, first: int, last: int) -> float:
        """What runs from number `first` to before `last` take together; one each where nothing else is known."""
        if not self._takes:
            return max(last - first, 0)
        return sum(self._takes[first - self._before : last - self._before])
