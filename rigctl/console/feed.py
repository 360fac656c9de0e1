"""Looks into the store of a campaign several times a second, in a thread, and posts what it sees as frozen views."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.console.messages import Noted

if TYPE_CHECKING:
    from textual.message import Message

    from rigctl.campaign.recording import ChannelInfo, RunRecord
    from rigctl.campaign.session.questions import Question
    from rigctl.campaign.store.entries import Event
    from rigctl.core.arrays import FloatArray

LOOK_S = 0.25


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
            from rigctl.console.store_watch import follow  # stores are imported after the first paint

            try:
                follow(path, self._changed, self._post)
            except Exception as error:  # noqa: BLE001 - whatever is wrong with a store, the console goes on
                self._post(Noted(str(error), "error"))
                self._changed.wait()
