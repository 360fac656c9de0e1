"""Requests from outside: pause, go on, abort. They come through the store, from signals, or from a console."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rigctl.campaign.session.heartbeat import BEAT_S, beat
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, RigError
from rigctl.core.making_safe import STOPPED

HEED_S = 0.04
"""How often requests in the store are looked for (wall-clock)."""


class Control:
    """The state of the requests; any thread may ask and set it.

    After an abort has made safe, `disconnect` takes the instruments away from whoever would still move them.
    """

    def __init__(
        self,
        make_safe: Callable[[], None],
        at_pause: Callable[[], None] = lambda: None,
        disconnect: Callable[[], None] = lambda: None,
    ) -> None:
        self._make_safe = make_safe
        self._at_pause = at_pause
        self._disconnect = disconnect
        self._paused = threading.Event()
        self._aborted = threading.Event()
        self.reason = ""

    @property
    def paused(self) -> bool:
        """True between a pause and the request to go on."""
        return self._paused.is_set()

    @property
    def aborted(self) -> bool:
        """True once somebody aborts."""
        return self._aborted.is_set()

    def pause(self) -> None:
        """Hold at the next checkpoint."""
        self._paused.set()

    def go_on(self) -> None:
        """End a pause."""
        self._paused.clear()

    def abort(self, reason: str) -> None:
        """Halt all motion now and end the campaign; what is recorded stays."""
        # The first reason stays: later aborts are often the echo of the first.
        self.reason = self.reason or reason
        # Before the pause ends: whoever waits in it must find the abort, not go on to its next motion.
        self._aborted.set()
        self._paused.clear()
        try:
            self._make_safe()
        finally:
            # Also where an instrument did not confirm: between two motions no driver knows that it was stopped.
            self._disconnect()

    def bring_to_rest(self) -> None:
        """Halt all motion, as far as instruments can be reached; the campaign goes on."""
        with suppress(RigError):
            self._make_safe()

    def raise_if_aborted(self) -> None:
        """`Aborted` once somebody asked for it."""
        if self.aborted:
            raise Aborted(self.reason)

    def rest(self) -> None:
        """What a pause begins with; raises what instruments raise."""
        self._at_pause()

    def while_paused(self, idle: Callable[[], None]) -> None:
        """Stay until the pause ends."""
        while self.paused and not self.aborted:
            idle()
        self.raise_if_aborted()


class RequestWatcher:
    """Carries out requests in the store in a thread, twenty-five times a second, and is the campaign's heartbeat.

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
        # A store of its own: a connection belongs to the thread that opened it.
        beaten_s = 0.0
        with Store.open(self._path) as store:
            while not self._ended.wait(HEED_S):
                if time.monotonic() - beaten_s > BEAT_S:
                    beaten_s = time.monotonic()
                    beat(self._path)
                with suppress(RigError):
                    self._obey(store.take_request())

    def _obey(self, request: str | None) -> None:
        if request == "pause":
            self._control.pause()
        elif request == "resume":
            self._control.go_on()
        elif request == "abort":
            self._control.abort("the operator asked for it (rigctl abort)")
        elif request == "stop":
            self._control.abort(STOPPED)


def forget_requests(store: Store) -> None:
    """Drop what was asked of a campaign that ended before it looked."""
    while store.take_request() is not None:
        pass
