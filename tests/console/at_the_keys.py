"""An operator at a console's keys, with a terminal emulator to read its screen: what `operator` is made of."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyte

from rigctl.campaign.status import status_of
from rigctl.core.errors import RigError
from tests.console.terminal import Terminal

KEY_S = 0.02
STARTED_BY_KEYS = ("2", "s", "\t", "\t", "\t", "\t", " ", "\r")
_COUNT = re.compile(r"(RUNNING|PAUSED|DONE|ABORTED|INTERRUPTED|STALLED) (\d+)/(\d+)")


class Wrong(Exception):
    """The screen said something else than the store."""


class Operator:
    """Somebody at a console whose screen is drawn by a terminal emulator."""

    def __init__(self, directory: Path, *arguments: object, size: tuple[int, int] = (80, 24)) -> None:
        self._screen = pyte.Screen(*size)
        self._stream = pyte.ByteStream(self._screen)
        self._drawing = threading.Lock()
        self._terminal = Terminal(directory, *arguments, columns=size[0], rows=size[1])
        self._terminal.feed = self._feed

    @property
    def text(self) -> str:
        """What is on the screen now."""
        with self._drawing:
            return "\n".join(line.rstrip() for line in self._screen.display)

    def type(self, *keys: str) -> None:
        """Keys, fifty a second, whatever the screen shows."""
        for key in keys:
            self._terminal.type(key)
            time.sleep(KEY_S)  # the pace is what is tried

    def until(self, condition: Callable[[], object], what: str, within_s: float = 90.0) -> None:
        """Wait until something is so."""
        deadline = time.monotonic() + within_s
        while not condition():
            if time.monotonic() > deadline:
                raise Wrong(f"{what}: it did not happen within {within_s:g} s\n{self.text}")
            time.sleep(0.1)

    def sees(self, *words: str, within_s: float = 90.0) -> None:
        """Wait until all of these are on the screen."""
        self.until(lambda: all(word in self.text for word in words), f"{words}", within_s)

    def count(self) -> tuple[str, int, int] | None:
        """The state and the runs in the top line; None while it shows none."""
        found = _COUNT.search(self.text.partition("\n")[0])
        return None if found is None else (found[1], int(found[2]), int(found[3]))

    def leaves(self) -> None:
        """Quit, which must be in order."""
        self.type("q")
        self.ends_with(0)

    def ends_with(self, wanted: int) -> None:
        """It must end, with this status."""
        if (status := self._terminal.ends()) != wanted:
            raise Wrong(f"the console ended with {status}\n{self.text}")

    def hangs_up(self) -> None:
        """The connection drops, and the console has to end."""
        self._terminal.hang_up()
        self._terminal.ends()

    def close(self) -> None:
        """Whatever is left."""
        self._terminal.close()

    def _feed(self, data: bytes) -> None:
        with self._drawing:
            self._stream.feed(data)


def status_in(store: Path) -> dict[str, Any]:
    """As `rigctl status` has it; {} while the store is being made."""
    try:
        return status_of(store)
    except RigError:
        return {}


def process_of(store: Path) -> int:
    """Of the campaign that runs in a store."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if (
                b"run" in words
                and b"--store" in words
                and Path(os.fsdecode(words[words.index(b"--store") + 1])).name == store.name
            ):
                return int(entry.name)
    raise Wrong(f"no process runs {store}")
