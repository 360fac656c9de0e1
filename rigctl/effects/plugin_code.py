"""The code of a file of effects: executed, called, and interrupted when it does not return."""

from __future__ import annotations

import ctypes
import hashlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import Any

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, PluginError, one_line
from rigctl.effects.catalogue import Effect, described, effects_in, line_of

CALL_PATIENCE_S = 60.0
"""A call of an effect takes milliseconds, seconds on days of samples."""

# What is overdue is noticed so much later at most: one thread looks after all calls, and none is started for each.
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
    # Signals reach the main thread only; this is CPython's one way to interrupt any other.
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), what)


WATCH = Watch()


def effects_of(module: ModuleType) -> list[Effect]:
    """What a file defines, each guarded so that it can neither end the program nor keep it waiting."""
    path = module.__file__
    effects = [replace(each, function=_guarded(each, str(path))) for each in effects_in(module)]
    if not effects:
        raise ConfigError(f"{path}: no effect in it: decorate a function with @effect(...) of rigctl.effects")
    return effects


def _guarded(effect: Effect, path: str) -> Callable[..., FloatArray]:
    @wraps(effect.function)
    def called(run: Any, **parameters: Any) -> FloatArray:
        with _civil(f"{path}: effect '{effect.id}'"):
            return effect.function(run, **parameters)

    return called


@contextmanager
def _civil(who: str) -> Iterator[None]:
    """`PluginError` for what is no `Exception` and would end the program, and for what does not return."""
    try:
        with WATCH.over(CALL_PATIENCE_S):
            yield
    except Overdue:
        raise PluginError(f"{who} does not return within {CALL_PATIENCE_S:g} s; mend it, or leave it out") from None
    # Ctrl-C is the user's and no fault of the file.
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PluginError(f"{who} raises {type(error).__name__}, which would end the program; mend it") from error


def executed(path: Path, source: bytes) -> ModuleType:
    """The module that a file's text makes; `ConfigError` for what fails in it."""
    # Named for its text: two files called alike do not replace each other.
    name = f"rigctl_plugin_{hashlib.sha256(source).hexdigest()[:12]}"
    module = ModuleType(name)
    module.__file__ = str(path)
    try:
        # Not with this module's own `from __future__` imports.
        code = compile(source, str(path), "exec", dont_inherit=True)
    except SyntaxError as error:
        raise ConfigError(one_line(f"{path}, line {error.lineno}: {error.msg}")) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise ConfigError(f"{path}: no text of Python: {error}") from None
    # Dataclasses and the like look their module up while it is being executed.
    sys.modules[name] = module
    try:
        with _civil(str(path)):
            exec(code, vars(module))  # noqa: S102 - a plug-in is code that its user hands over to be run
    except PluginError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a user's file may raise
        raise ConfigError(one_line(f"{path}{line_of(error, str(path))}: {described(error)}")) from None
    finally:
        sys.modules.pop(name, None)
    return module
