"""Looks into the store of a campaign several times a second, in a thread, and posts what it sees as frozen views."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from textual.message import Message

from rigctl.console.messages import Noted

if TYPE_CHECKING:
    from rigctl.console.vitals import Vitals

LOOK_S = 0.25


class Feed:
    """Watches one store at a time, from `start` to `close`."""

    def __init__(self, post: Callable[[Message], object]) -> None:
        self._post = post
        self.vitals: Vitals | None = None
        """Signs of life of the campaign that is watched, as last looked at."""
        self._path: Path | None = None
        self._changed = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def watch(self, path: Path) -> None:
        """Look into this store from now on; one that is not there yet is waited for."""
        self._path = path
        self._changed.set()

    @property
    def watches(self) -> bool:
        """Whether there is a store to look into."""
        return self._path is not None

    def close(self) -> None:
        """Stop looking."""
        self._ended = True
        self._changed.set()

    def _feel(self, vitals: Vitals) -> None:
        self.vitals = vitals

    def _run(self) -> None:
        failed: tuple[Path, str] | None = None
        while not self._ended:
            # Before the path is read: a change that comes in between is seen at once.
            self._changed.clear()
            path = self._path
            if path is None or not path.exists():
                # A store that is not there yet is looked for again; without a name somebody has to give one.
                self._changed.wait(LOOK_S if path else None)
                continue
            from rigctl.console.store_watch import follow  # stores are imported after the first paint

            try:
                follow(path, self._changed, self._post, LOOK_S, self._feel)
            except Exception as error:  # noqa: BLE001 - whatever is wrong with a store, the console goes on
                if (path, str(error)) != failed:
                    failed = path, str(error)
                    self._post(Noted(str(error), "error"))
                # A lock or a busy disk passes; a file that is no store fails in the same way, and is not told again.
                self._changed.wait(LOOK_S)
