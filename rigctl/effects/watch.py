"""Calls into other people's code that never return are interrupted."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

CALL_PATIENCE_S = 60.0
"""A call of an effect takes milliseconds, seconds on days of samples."""

_LOOK_S = 0.5


class Overdue(BaseException):
    """Raised in the middle of what took too long; no `except Exception` there holds it up."""


@dataclass
class _Call:
    thread: int
    deadline_s: float
    interrupted: bool = False


class Watch:
    """Interrupts what runs too long, in whichever thread it does.

    Python code is interrupted between two of its steps; what waits in a library of C is not, until it returns.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._calls: list[_Call] = []
        self._looking = False

    @contextmanager
    def over(self, patience_s: float) -> Iterator[None]:
        """`Overdue` is raised in what is done here when it takes longer than `patience_s`."""
        call = _Call(threading.get_ident(), time.monotonic() + patience_s)
        with self._lock:
            self._calls.append(call)
            if not self._looking:
                self._looking = True
                threading.Thread(target=self._look, name="effects' watch", daemon=True).start()
        try:
            yield
        finally:
            with self._lock:
                self._calls.remove(call)
                if call.interrupted:
                    _raise_in(call.thread, None)  # it may have ended by itself a moment before it was interrupted

    def _look(self) -> None:
        while True:
            time.sleep(_LOOK_S)
            with self._lock:
                for call in self._calls:
                    if not call.interrupted and time.monotonic() > call.deadline_s:
                        call.interrupted = True
                        _raise_in(call.thread, Overdue)


def _raise_in(thread: int, error: type[BaseException] | None) -> None:
    what = ctypes.py_object(error) if error else None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), what)


WATCH = Watch()
