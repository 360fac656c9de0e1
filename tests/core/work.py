"""Pieces of work for workers: they are imported in other processes too, so that they import little."""

from __future__ import annotations

import os
import random
import signal
import time
from pathlib import Path
from threading import Event

from rigctl.core.errors import DataError

RELEASED = Event()
"""What `held` waits for, in a worker that is a thread of this process."""


def squared(number: int) -> int:
    return number * number


def drawn(seed: int) -> tuple[float, int]:
    """A number of a stream of its own, and the process that drew it."""
    return random.Random(seed).gauss(), os.getpid()


def killed_once(item: tuple[int, Path]) -> int:
    """Of number 5 the first worker is killed in the midst of it."""
    number, directory = item
    if number == 5:
        try:
            (directory / "killed").touch(exist_ok=False)
        except FileExistsError:
            return number * number
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def deadly(number: int) -> int:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def refused(number: int) -> int:
    if number == 1:
        raise DataError("table.csv: line 3: no number")
    return number


class Awkward(Exception):
    def __init__(self, text: str, *, code: int) -> None:
        super().__init__(text)
        self.code = code


def awkward(number: int) -> int:
    raise Awkward(f"of {number}", code=7)


def divided(number: int) -> float:
    return 1.0 / number


def asleep(directory: Path) -> None:
    (directory / f"{os.getpid()}.pid").touch()
    time.sleep(600.0)


def held(number: int) -> int:
    RELEASED.wait(60.0)
    return number
