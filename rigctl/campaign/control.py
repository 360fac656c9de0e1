"""Requests from outside: pause, go on, abort. They come through the store, from signals, or from a console."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rigctl.campaign.store import Store
from rigctl.errors import Aborted, RigError

HEED_S = 0.02
"""How often requests of this process are looked for (wall-clock)."""

STORE_EVERY = 2
"""Those in the store are looked for every so many times: twenty-five times a second."""


class Control:
    """The state of the requests; any thread may ask and set it."""

    def __init__(self, make_safe: Callable[[], None], at_pause: Callable[[], None] = lambda: None) -> None:
        self._make_safe = make_safe
        self._at_pause = at_pause
        self._paused = threading.Event()
        self._aborted = threading.Event()
        self._asked = ""
        self.reason = ""

    @property
    def paused(self) -> bool:
        """True between a pause and the request to go on."""
        return self._paused.is_set()

    @property
    def aborted(self) -> bool:
        """True once an abort has been carried out or asked for."""
        return self._aborted.is_set() or bool(self._asked)

    def pause(self) -> None:
        """Hold at the next checkpoint."""
        self._paused.set()

    def go_on(self) -> None:
        """End a pause."""
        self._paused.clear()

    def ask_to_abort(self, reason: str) -> None:
        """Have the watcher abort: safe in a signal handler, which may have interrupted anything."""
        self._asked = self._asked or reason
        self.reason = self.reason or reason

    def abort(self, reason: str) -> None:
        """Halt all motion now and end the campaign; what is recorded stays."""
        self.reason = self.reason or reason
        self._aborted.set()
        self._paused.clear()
        self._make_safe()

    def bring_to_rest(self) -> None:
        """Halt all motion, as far as instruments can be reached; the campaign goes on."""
        with suppress(RigError):
            self._make_safe()

    def heed(self) -> None:
        """Carry out an abort that was asked for."""
        if self._asked and not self._aborted.is_set():
            self.abort(self._asked)

    def raise_if_aborted(self) -> None:
        """`Aborted` once somebody asked for it."""
        if self.aborted:
            raise Aborted(self.reason)

    def while_paused(self, idle: Callable[[], None]) -> None:
        """Bring the rig to rest and stay until the pause ends."""
        self._at_pause()
        while self.paused and not self.aborted:
            idle()
        self.raise_if_aborted()


class RequestWatcher:
    """Carries out requests in a thread: those of this process at once, those in the store several times a second.

    What goes wrong here ends no campaign: an instrument that would not stop is tried again, and reported, when
    the campaign leaves its rig; a store that is busy is looked into again.
    """

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
        with Store.open(self._path) as store:
            looks = 0
            while not self._ended.wait(HEED_S):
                looks += 1
                with suppress(RigError):
                    self._control.heed()
                    if looks % STORE_EVERY == 0:
                        self._obey(store.take_request())

    def _obey(self, request: str | None) -> None:
        if request == "pause":
            self._control.pause()
        elif request == "resume":
            self._control.go_on()
        elif request == "abort":
            self._control.abort("the operator asked for it (rigctl abort)")


def forget_requests(store: Store) -> None:
    """Drop what was asked of a campaign that ended before it looked."""
    while store.take_request() is not None:
        pass
