"""What a `RunEngine` waits for: an action in a thread of its own (`bluesky.protocols.Status`)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bluesky.protocols import Status


class ActionStatus:
    """Begins `action` when it is made; done when that has returned or raised. As text it is the error, one line.

    `after_failure` is called once everybody has been told of an error.
    """

    def __init__(self, name: str, action: Callable[[], None], after_failure: Callable[[Exception], None]) -> None:
        self._name = name
        self._after_failure = after_failure
        self._result: Future[None] = Future()
        # A daemon: an instrument that hangs keeps no program from ending.
        threading.Thread(target=self._carry_out, args=(action,), name=name, daemon=True).start()

    def _carry_out(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - whatever it is, it is whoever waits that has to know
            self._result.set_exception(error)
            self._after_failure(error)
        else:
            self._result.set_result(None)

    def add_callback(self, callback: Callable[[Status], None]) -> None:
        """Have `callback` called with this status when it is done, at once where it is done already."""
        self._result.add_done_callback(lambda _: callback(self))

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """What the action raised, None for nothing; `TimeoutError` while it is not done after `timeout` seconds."""
        return self._result.exception(timeout)

    def wait(self, timeout_s: float) -> None:
        """Return when it is done, after `timeout_s` at the latest."""
        with suppress(TimeoutError):
            self._result.exception(timeout_s)

    @property
    def done(self) -> bool:
        """Whether the action has ended."""
        return self._result.done()

    @property
    def success(self) -> bool:
        """Whether the action has ended without an error."""
        return self.done and self.exception() is None

    def __repr__(self) -> str:
        if not self.done:
            return f"{self._name}: under way"
        return str(self.exception() or f"{self._name}: done")
