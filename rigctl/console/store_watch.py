"""Reads a campaign's store for the console: what is new four times a second, and all events in a search."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from textual.message import Message

from rigctl.campaign.recording import RunRecord
from rigctl.campaign.session.questions import open_question
from rigctl.campaign.session.requests import is_running
from rigctl.campaign.status import status_in
from rigctl.campaign.store.entries import RUN_ENDED, Event
from rigctl.campaign.store.store import Store
from rigctl.console.log_lines import LogLine, Search, lines_of
from rigctl.console.messages import StoreSeen
from rigctl.console.store_view import StoreView
from rigctl.console.vitals import Vitals, vitals_of
from rigctl.core.arrays import FloatArray

EVENTS = 2000
"""So many events are kept in sight; a search goes through all of them in the store."""

SAMPLES = 20_000
"""So many of a run's last samples are shown: a run of hours at 200 Hz is not read again four times a second."""


def follow(
    path: Path,
    ended: threading.Event,
    post: Callable[[Message], object],
    look_s: float,
    feel: Callable[[Vitals], object] = lambda _: None,
) -> None:
    """Post a `StoreSeen` when the store has changed, looking every `look_s`, until `ended` is set.

    `feel` is given the campaign's signs of life at every look.
    """
    with Store.open(path, readonly=True) as store:
        seen: object = None
        watched = _Watched(store)
        while not ended.is_set():
            # Asked before the store is read: what is written in between shows at the next look. The file's size and
            # time do not tell: a log written again from its start keeps its size, and times are coarse.
            alive, commits = is_running(path), store.commits_seen()
            feel(vitals_of(path, alive))
            if (alive, commits) != seen:
                seen = alive, commits
                post(StoreSeen(watched.look(alive)))
            ended.wait(look_s)


def earlier(store: Path, search: Search, before: int) -> list[LogLine]:
    """All events of a store with numbers below `before` that a search finds; `DataError`."""
    with Store.open(store, readonly=True) as opened:
        lines = lines_of(event for event in opened.events() if event.id < before)
        return [line for line in lines if search.finds(line)]


class _Watched:
    """An open store, and what has been read of it: every look reads only what is new."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._runs: list[RunRecord] = []
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._last_event = 0
        self._identities: Mapping[str, Mapping[str, Any]] = {}
        self._run_id = ""
        self._recording = False
        self._samples: Mapping[str, FloatArray] = {}
        self._sampled_s = math.nan
        self._run_ended_s = math.nan

    def look(self, alive: bool) -> StoreView:
        """The store as it is now; `alive` while a process runs its campaign."""
        store = self._store
        self._read_events()
        self._runs += store.runs(skip=len(self._runs))
        # They are there before the first run and stay.
        self._identities = self._identities or store.identities()
        self._read_samples(alive)
        return StoreView(
            path=store.path,
            status=status_in(store),
            alive=alive,
            runs=tuple(self._runs),
            events=tuple(self._events),
            identities=self._identities,
            question=open_question(store) if alive else None,
            run_id=self._run_id,
            samples=self._samples,
            sampled_s=self._sampled_s,
            run_ended_s=self._run_ended_s,
            title=store.header.title or store.header.experiment,
            campaign_toml=store.header.campaign_toml or "",
            rig_toml=store.header.rig_toml or "",
            channels=store.header.channels,
        )

    def _read_events(self) -> None:
        fresh = self._store.events(after=self._last_event)
        if not fresh:
            return
        self._events.extend(fresh)
        self._last_event = fresh[-1].id
        ended = next((event.time for event in reversed(fresh) if event.kind == RUN_ENDED), "")
        if ended:
            self._run_ended_s = on_monotonic_clock(ended)
        if any(event.kind == "mark" for event in fresh):  # a run that was read is another now
            self._runs = []

    def _read_samples(self, alive: bool) -> None:
        unfinished = self._store.interrupted_runs() if alive else []
        acquiring = [run.run_id for run in unfinished if run.state == "acquiring"]
        finished = self._runs[-1].run_id if self._runs else ""
        run_id = acquiring[-1] if acquiring else finished
        # A run that is finished does not change; while it is recorded it is read anew each time.
        if not run_id or (run_id == self._run_id and not self._recording and not acquiring):
            return
        samples = self._store.last_samples(run_id, SAMPLES)
        if samples:  # one that has only begun leaves the one before in sight
            self._run_id, self._samples, self._recording = run_id, samples, bool(acquiring)
            # Of a run that is being recorded the last samples were the last thing that was written.
            written_s = vitals_of(self._store.path, alive).written_s
            self._sampled_s = written_s if acquiring and written_s is not None else self._run_ended_s


def on_monotonic_clock(utc: str) -> float:
    """A time of day, ISO 8601, on this computer's monotonic clock, which changes of the time of day do not touch."""
    return time.monotonic() - (datetime.now(UTC) - datetime.fromisoformat(utc)).total_seconds()
