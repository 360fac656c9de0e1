"""Commands in this process or as processes of their own, and whether they ended as a command has to."""

from __future__ import annotations

import atexit
import functools
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
STATUSES = {0, 1, 2, 130}
LONGEST_MESSAGE = 2000
UNTYPED = re.compile(r"Traceback|internal error|Error\(|Exception ignored|Warning:|Segmentation|\bassert\b")
PROGRESS = re.compile(r"(?:running|done|aborted|interrupted|paused): .* left$")
_numbers = itertools.count(1)


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    status: int
    out: str
    err: str

    @property
    def message(self) -> str:
        """What it said last that is not progress."""
        lines = [line for line in self.err.strip().splitlines() if not PROGRESS.match(line)]
        return lines[-1] if lines else ""

    def broken(self) -> str:
        """What no command may do; "" when it ended as it has to."""
        if self.status not in STATUSES:
            return f"exit status {self.status}; {self.message}"
        if untyped := UNTYPED.search(self.err + self.out):
            return f"an untyped message, {untyped.group()!r}: {self.message}"
        if self.status and not self.message:
            return f"exit status {self.status} without a word"
        if len(self.message) > LONGEST_MESSAGE:
            return f"a message of {len(self.message)} characters"
        return ""


def here(work: Path, *arguments: object) -> Outcome:
    """`rigctl` with these arguments in this process, in the directory `work`."""
    from rigctl import cli

    out, err = work / "stdout.txt", work / "stderr.txt"
    before = sys.argv, Path.cwd()
    sys.argv = ["rigctl", *map(str, arguments)]
    os.chdir(work)
    try:
        with _written_to(1, out), _written_to(2, err):
            status = _status(cli.main)
    finally:
        sys.argv = before[0]
        os.chdir(before[1])
    return Outcome(status, out.read_text(errors="replace"), err.read_text(errors="replace"))


class Process:
    """A command in a process of its own; `terminal` is the device it has as its terminal, if any."""

    def __init__(self, work: Path, *arguments: object, terminal: str = "", **environment: str) -> None:
        place = work / f"{next(_numbers)}-{arguments[0]}"
        self.out, self.err = place.with_suffix(".out"), place.with_suffix(".err")
        self.status: int | None = None
        self.number: int = _ask(
            start=[str(argument) for argument in arguments],
            directory=str(work),
            stdin=terminal or os.devnull,
            stdout=terminal or str(self.out),
            stderr=terminal or str(self.err),
            terminal=bool(terminal),
            environment=environment,
        )["process"]

    def running(self) -> bool:
        """Whether it still runs."""
        if self.status is None:
            self.status = _ask(ended=self.number)["status"]
        return self.status is None

    def signal(self, number: signal.Signals) -> float:
        """Send a signal; returns the monotonic time just before."""
        at_s = time.monotonic()
        with suppress(ProcessLookupError):
            os.kill(self.number, number)
        return at_s

    def ended(self, timeout_s: float) -> Outcome:
        """How it ended; killed, with status -9, when it did not within `timeout_s`."""
        if not until(lambda: not self.running(), timeout_s):
            self.signal(signal.SIGKILL)
            until(lambda: not self.running(), 10.0)
            return Outcome(-9, _text(self.out), f"{_text(self.err)}\ndid not end within {timeout_s:g} s")
        assert self.status is not None
        return Outcome(self.status, _text(self.out), _text(self.err))


def until(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Wait for something that another process brings about; False when it did not come."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.005)
    return True


@functools.cache
def _nursery() -> subprocess.Popen[str]:
    started = subprocess.Popen(
        [sys.executable, "-m", "tests.reliability.nursery"],
        cwd=ROOT,
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
    )
    assert started.stdin is not None
    atexit.register(started.stdin.close)
    return started


def _ask(**what: Any) -> dict[str, Any]:
    nursery = _nursery()
    assert nursery.stdin is not None
    assert nursery.stdout is not None
    nursery.stdin.write(json.dumps(what) + "\n")
    nursery.stdin.flush()
    answer: dict[str, Any] = json.loads(nursery.stdout.readline())
    return answer


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""


def _status(main: Callable[[], None]) -> int:
    try:
        main()
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    return 0


@contextmanager
def _written_to(descriptor: int, path: Path) -> Iterator[None]:
    """A standard stream goes to a file: the descriptor too, so that nothing escapes."""
    stream = sys.stdout if descriptor == 1 else sys.stderr
    stream.flush()
    kept = os.dup(descriptor)
    with path.open("w") as file:
        os.dup2(file.fileno(), descriptor)
        try:
            yield
        finally:
            stream.flush()
            os.dup2(kept, descriptor)
            os.close(kept)
