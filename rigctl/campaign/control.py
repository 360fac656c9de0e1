"""Requests from outside: pause, go on, abort. They come through the store, from signals, or from a console."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from rigctl.campaign.store import Store
from rigctl.errors import Aborted

POLL_S = 0.2
"""How often requests in the store are looked for (wall-clock)."""


class Control:
    """The state of the requests; any thread may ask and set it."""

    def __init__(self, make_safe: Callable[[], None], at_pause: Callable[[], None] = lambda: None) -> None:
        self._make_safe = make_safe
        self._at_pause = at_pause
        self._paused = threading.Event()
        self._aborted = threading.Event()
        self._reason = ""

    @property
    def paused(self) -> bool:
        """True between a pause and the request to go on."""
        return self._paused.is_set()

    @property
    def aborted(self) -> bool:
        """True once somebody asked to abort."""
        return self._aborted.is_set()

    def pause(self) -> None:
        """Hold at the next checkpoint."""
        self._paused.set()

    def go_on(self) -> None:
        """End a pause."""
        self._paused.clear()

    def abort(self, reason: str) -> None:
        """Halt all motion now and end the campaign; what is recorded stays."""
        self._reason = self._reason or reason
        self._aborted.set()
        self._paused.clear()
        self._make_safe()

    def raise_if_aborted(self) -> None:
        """`Aborted` once somebody asked for it."""
        if self.aborted:
            raise Aborted(self._reason)

    def while_paused(self, idle: Callable[[], None]) -> None:
        """Bring the rig to rest and stay until the pause ends."""
        self._at_pause()
        while self.paused:
            idle()
        self.raise_if_aborted()


class RequestWatcher:
    """Looks for requests that other processes write into the store, several times a second, in a thread."""

    def __init__(self, path: Path, control: Control) -> None:
        self._path = path
        self._control = control
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="requests", daemon=True)

    def __enter__(self) -> RequestWatcher:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        store = Store.open(self._path)
        try:
            while not self._ended.wait(POLL_S):
                request = store.take_request()
                if request == "pause":
                    self._control.pause()
                elif request == "resume":
                    self._control.go_on()
                elif request == "abort":
                    self._control.abort("the operator asked for it (rigctl abort)")
        finally:
            store.close()
