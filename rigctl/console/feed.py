"""Looks into the store of a campaign several times a second, in a thread, and posts what it sees as frozen views."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import Noted, StoreSeen

if TYPE_CHECKING:
    from textual.message import Message

    from rigctl.campaign.questions import Question
    from rigctl.campaign.recording import RunRecord
    from rigctl.campaign.store import Event, Store
    from rigctl.interfaces import FloatArray

LOOK_S = 0.25


@dataclass(frozen=True)
class StoreView:
    """A store at one moment; `samples` are those of the run that is being recorded, else of the last one."""

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
        from rigctl.campaign.store import Store

        with Store.open(path, readonly=True) as store:
            seen: object = None
            view: StoreView | None = None
            while not self._changed.is_set():
                now = _signs(path)
                if now != seen:
                    seen, view = now, _view(store, view)
                    self._post(StoreSeen(view))
                self._changed.wait(LOOK_S)


def _signs(path: Path) -> tuple[object, ...]:
    """What changes when somebody writes the store, or its campaign's process ends."""
    from rigctl.campaign.locks import is_held, store_lock

    signs: list[object] = [is_held(store_lock(path))]
    for each in (path, path.with_name(path.name + "-wal")):
        try:
            status = each.stat()
            signs += [status.st_size, status.st_mtime_ns]
        except OSError:
            signs.append(None)
    return tuple(signs)


def _view(store: Store, before: StoreView | None) -> StoreView:
    from rigctl.campaign.locks import is_held, store_lock
    from rigctl.campaign.questions import open_question
    from rigctl.campaign.status import status_of

    alive = is_held(store_lock(store.path))
    runs = tuple(store.runs())
    view = StoreView(
        path=store.path,
        title=store.header.title,
        experiment=store.header.experiment,
        status=status_of(store.path),
        alive=alive,
        runs=runs,
        events=tuple(store.events()),
        identities=store.identities() if before is None or not before.identities else before.identities,
        question=open_question(store) if alive else None,
        campaign_toml=store.header.campaign_toml or "",
        rig_toml=store.header.rig_toml or "",
    )
    return _with_samples(store, view, before)


def _with_samples(store: Store, view: StoreView, before: StoreView | None) -> StoreView:
    acquiring = [run.run_id for run in store.interrupted_runs() if run.state == "acquiring"] if view.alive else []
    last = acquiring[-1] if acquiring else view.runs[-1].run_id if view.runs else ""
    if not last:
        return view
    if before is not None and last == before.run_id and not acquiring and before.samples:
        return replace(view, run_id=last, samples=before.samples, sampled_s=before.sampled_s)
    samples = store.samples(last)
    if not samples and before is not None:  # it has only begun: the one before stays in sight
        return replace(view, run_id=before.run_id, samples=before.samples, sampled_s=before.sampled_s)
    return replace(view, run_id=last, samples=samples, sampled_s=time.monotonic())
