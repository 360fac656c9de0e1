"""Making safe: instruments brought to rest, each asked whether it is, whatever ends a command.

Nothing here knows a rig, a campaign or a screen. Times are wall-clock seconds: somebody waits for a stop at a real
instrument. See docs/decisions/026.
"""

from __future__ import annotations

import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, Protocol

from rigctl.core.errors import Aborted, BadReply, LinkError, RigError

if TYPE_CHECKING:
    from rigctl.core.interfaces import Instrument

DEADLINE_S = 5.0
"""How long an instrument has to confirm: to connect, to brake, and to answer."""

LEAVE_S = 10.0
"""How long a command may go on after everything has been stopped, until it is interrupted where it is."""

TURN_S = 0.0005
"""How long a computation in the main thread keeps the interpreter from threads that stop instruments, each time."""

STOPS_FIRST_S = 0.005
"""The main thread lets the stops go first, for so long at most: an exchange it is in would keep one of them back."""

STOP_SIGNAL = signal.SIGUSR1
"""What a console sends for its operator's STOP: the record then says who stopped, not which signal came."""

STOPPED = "STOP, by the operator at a console"
TERMINAL_LOST = "the terminal was lost"
OnTerminalLost = Literal["continue", "stop"]


class Stoppable(Protocol):
    """What can be brought to rest."""

    @property
    def name(self) -> str:
        """As the operator knows it."""

    def stop(self) -> None:
        """Returns when it has confirmed that it is at rest; raises otherwise."""


@dataclass(frozen=True)
class Rest:
    """What came of one instrument's stop: `confirmed` when it has answered that it is at rest, else `why` not."""

    instrument: str
    confirmed: bool
    took_s: float
    why: str = ""

    def __str__(self) -> str:
        if self.confirmed:
            return f"{self.instrument}: confirmed at rest ({1e3 * self.took_s:.0f} ms)"
        return f"{self.instrument}: NOT CONFIRMED: {self.why}"


def bring_to_rest(instruments: Iterable[Stoppable], deadline_s: float = DEADLINE_S) -> tuple[Rest, ...]:
    """Stop all at once and say of each whether it has confirmed; raises nothing.

    Any thread, any number of times. One that hangs keeps nobody waiting beyond `deadline_s` (wall-clock); its stop
    goes on behind.
    """
    return _all_at_once([(each.name, partial(_insist, each.stop)) for each in instruments], deadline_s)


def _insist(stop: Callable[[], None]) -> None:
    """Asked again once where a reply was spoilt: one bad reply says nothing of the instrument."""
    try:
        stop()
    except (LinkError, BadReply):
        stop()


def let_go(instruments: Iterable[Instrument], deadline_s: float = DEADLINE_S) -> None:
    """Disconnect all at once; one that hangs keeps nobody waiting beyond `deadline_s` (wall-clock)."""
    _all_at_once([(each.name, each.close) for each in instruments], deadline_s)


def require_rest(rests: Iterable[Rest]) -> None:
    """`RigError` that names all that have not confirmed."""
    if unsafe := [f"{rest.instrument}: {rest.why}" for rest in rests if not rest.confirmed]:
        raise RigError("NOT known to be at rest: " + "; ".join(unsafe))


def _all_at_once(actions: Sequence[tuple[str, Callable[[], None]]], deadline_s: float) -> tuple[Rest, ...]:
    began_s = time.monotonic()
    rests: dict[int, Rest] = {}

    def carry_out(number: int, name: str, act: Callable[[], None]) -> None:
        why = _failure(name, act)
        rests[number] = Rest(name, not why, time.monotonic() - began_s, why)

    threads = [
        # Not a pool, whose end would wait for one that hangs; a daemon thread keeps no program from ending.
        threading.Thread(target=carry_out, args=(number, *action), daemon=True)
        for number, action in enumerate(actions)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        # All wait for the same deadline: six that hang take no longer than one.
        thread.join(max(began_s + deadline_s - time.monotonic(), 0.0))
    silence = f"no answer within {deadline_s:g} s"
    return tuple(rests.get(n) or Rest(name, False, deadline_s, silence) for n, (name, _) in enumerate(actions))


def _failure(name: str, act: Callable[[], None]) -> str:
    try:
        act()
    except Exception as error:  # noqa: BLE001 - whatever fails in one, it is said, and the others are not kept from it
        return " ".join(str(error).split()).removeprefix(f"{name}: ") or type(error).__name__
    return ""


@contextmanager
def ended_by_signals(
    abort: Callable[[str], object], on_terminal_lost: OnTerminalLost = "stop", leave_s: float = LEAVE_S
) -> Iterator[None]:
    """INT, TERM, STOP and, unless the terminal may be lost, HUP call `abort(reason)` at once, on a thread of its own.

    So a stop overtakes whatever the main thread waits for. Further signals change nothing: what they ask is done.
    A main thread that has not left after `leave_s` is interrupted with `Aborted`. Outside the main thread this does
    nothing: whoever runs us handles signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reasons: dict[signal.Signals, str] = {
        number: f"interrupted by {number.name}" for number in (signal.SIGINT, signal.SIGTERM)
    }
    reasons[STOP_SIGNAL] = STOPPED
    if on_terminal_lost == "stop":
        reasons[signal.SIGHUP] = TERMINAL_LOST
    with _Watch(abort, reasons, leave_s):
        yield


class _Watch:
    """A thread that carries out what signals ask; the handlers themselves only wake it.

    Python runs handlers when the main thread comes to it, which in the middle of a long computation is late: the
    interpreter writes a signal's number to the wake-up descriptor at once. An event loop may have taken that for
    itself: the handlers write as well.
    """

    def __init__(self, abort: Callable[[str], object], reasons: dict[signal.Signals, str], leave_s: float) -> None:
        self._abort = abort
        self._reasons = reasons
        self._leave_s = leave_s
        self._overdue = ""
        self._end = threading.Event()
        self._leaving = threading.Lock()
        self._stopped = threading.Lock()
        # Held until everything has been stopped: the handler waits for it.
        self._stopped.acquire()
        self._bell, self._rope = socket.socketpair()
        # A handler that waited for room would keep the main thread where it is.
        self._rope.setblocking(False)
        self._thread = threading.Thread(target=self._watch, name="signals", daemon=True)

    def __enter__(self) -> None:
        self._turns_s = sys.getswitchinterval()
        # The thread that stops has to get the interpreter from a main thread that computes.
        sys.setswitchinterval(TURN_S)
        self._thread.start()
        self._waked = signal.set_wakeup_fd(self._rope.fileno(), warn_on_full_buffer=False)
        # HUP is noted even where it is to be survived: by default it would end the process.
        watched = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, STOP_SIGNAL)
        self._before = {number: signal.signal(number, self._note) for number in watched}

    def __exit__(self, *_: object) -> None:
        # Before the handlers go: a watch thread that is about to interrupt then leaves it.
        self._end.set()
        # Not while the watch thread sends TERM, which would meet the old handler and end the process.
        with self._leaving:
            signal.set_wakeup_fd(self._waked)
            for number, handler in self._before.items():
                signal.signal(number, handler)
        # No signal has the number 0: it only wakes the thread.
        self._ring(0)
        self._thread.join()
        sys.setswitchinterval(self._turns_s)
        self._bell.close()
        self._rope.close()

    def _note(self, number: int, _: object) -> None:
        # The second TERM of this process to itself: only a handler can interrupt the main thread where it is.
        if self._overdue and not self._end.is_set():
            reason, self._overdue = self._overdue, ""
            raise Aborted(reason)
        self._ring(number)
        # The main thread waits here for the stops, so that it begins no motion of its own meanwhile.
        if number in self._reasons and self._stopped.acquire(timeout=STOPS_FIRST_S):
            self._stopped.release()

    def _ring(self, number: int) -> None:
        with suppress(OSError):  # full: it rings already
            self._rope.send(bytes([number]))

    def _watch(self) -> None:
        # Other signals ring too, such as a change of the terminal's size.
        while not (asked := self._heard()) and not self._end.is_set():
            pass
        if asked:
            try:
                with suppress(RigError):  # who would not stop is tried again, and told, when the rig is left
                    self._abort(asked)
            finally:
                self._stopped.release()
            if not self._end.wait(self._leave_s):
                self._interrupt(asked)

    def _heard(self) -> str:
        """The reason to abort among the signals that have come; waits for one."""
        numbers = self._bell.recv(4096)
        return next((reason for number, reason in self._reasons.items() if number in numbers), "")

    def _interrupt(self, reason: str) -> None:
        with self._leaving:
            if not self._end.is_set():
                # Before the signal, whose handler reads it.
                self._overdue = reason
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
