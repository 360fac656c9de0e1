"""Looks into the store of a campaign several times a second, in a thread, and posts what it sees as frozen views."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import Noted, StoreSeen

if TYPE_CHECKING:
    from textual.message import Message

    from rigctl.campaign.recording import ChannelInfo, RunRecord
    from rigctl.campaign.session.questions import Question
    from rigctl.campaign.store.entries import Event
    from rigctl.campaign.store.store import Store
    from rigctl.core.arrays import FloatArray

LOOK_S = 0.25
EVENTS = 2000
"""So many events are kept in sight; a search goes through all of them in the store."""

SAMPLES = 20_000
"""So many of a run's last samples are shown: a run of hours at 200 Hz is not read again four times a second."""


@dataclass(frozen=True)
class StoreView:
    """A store at one moment; `events` are the last ones, `samples` those of the run in work, else of the last one."""

    path: Path
    title: str
    experiment: str
    status: Mapping[str, Any]
    alive: bool
    runs: tuple[RunRecord, ...]
    events: tuple[Event, ...]
    identities: Mapping[str, Mapping[str, Any]]
    question: Question | None
    run_id: str = ""
    samples: Mapping[str, FloatArray] = field(default_factory=dict)
    sampled_s: float = 0.0
    """When the samples were read, on this computer's monotonic clock."""
    campaign_toml: str = ""
    rig_toml: str = ""
    channels: Mapping[str, ChannelInfo] = field(default_factory=dict)

    @property
    def state(self) -> str:
        """running, paused, done, aborted or interrupted."""
        return str(self.status.get("state", "?"))


class Feed:
    """Watches one store at a time; `watch` another, or None."""

    def __init__(self, post: Callable[[Message], object]) -> None:
        self._post = post
        self._path: Path | None = None
        self._changed = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def watch(self, path: Path | None) -> None:
        """Look into this store from now on; one that is not there yet is waited for."""
        self._path = path
        self._changed.set()

    def close(self) -> None:
        """Stop looking."""
        self._ended = True
        self._changed.set()

    def _run(self) -> None:
        while not self._ended:
            self._changed.clear()
            path = self._path
            if path is None or not path.exists():
                self._changed.wait(LOOK_S if path else None)
                continue
            try:
                self._follow(path)
            except Exception as error:  # noqa: BLE001 - whatever is wrong with a store, the console goes on
                self._post(Noted(str(error), "error"))
                self._changed.wait()

    def _follow(self, path: Path) -> None:
        from rigctl.campaign.store.store import Store

        with Store.open(path, readonly=True) as store:
            seen: object = None
            watched = _Watched(store)
            while not self._changed.is_set():
                now = _signs(path)
                if now != seen:
                    seen = now
                    self._post(StoreSeen(watched.look()))
                self._changed.wait(LOOK_S)


def _signs(path: Path) -> tuple[object, ...]:
    """What changes when somebody writes the store, or its campaign's process ends."""
    from rigctl.campaign.session.locks import is_held, store_lock

    signs: list[object] = [is_held(store_lock(path))]
    for each in (path, path.with_name(path.name + "-wal")):
        try:
            status = each.stat()
            signs += [status.st_size, status.st_mtime_ns]
        except OSError:
            signs.append(None)
    return tuple(signs)


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
        self._sampled_s = 0.0

    def look(self) -> StoreView:
        """The store as it is now."""
        from rigctl.campaign.session.locks import is_held, store_lock
        from rigctl.campaign.session.questions import open_question
        from rigctl.campaign.status import status_in

        store = self._store
        alive = is_held(store_lock(store.path))
        self._read_events()
        self._runs += store.runs(skip=len(self._runs))
        self._identities = self._identities or store.identities()
        self._read_samples(alive)
        return StoreView(
            path=store.path,
            title=store.header.title,
            experiment=store.header.experiment,
            status=status_in(store),
            alive=alive,
            runs=tuple(self._runs),
            events=tuple(self._events),
            identities=self._identities,
            question=open_question(store) if alive else None,
            run_id=self._run_id,
            samples=self._samples,
            sampled_s=self._sampled_s,
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
        if any(event.kind == "mark" for event in fresh):  # a run that was read is another now
            self._runs = []

    def _read_samples(self, alive: bool) -> None:
        unfinished = self._store.interrupted_runs() if alive else []
        acquiring = [run.run_id for run in unfinished if run.state == "acquiring"]
        finished = self._runs[-1].run_id if self._runs else ""
        run_id = acquiring[-1] if acquiring else finished
        if not run_id or (run_id == self._run_id and not self._recording and not acquiring):
            return
        samples = self._store.last_samples(run_id, SAMPLES)
        if samples:  # one that has only begun leaves the one before in sight
            self._run_id, self._samples, self._sampled_s = run_id, samples, time.monotonic()
            self._recording = bool(acquiring)
