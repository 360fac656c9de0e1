"""A pseudo-terminal with a console in it: keys go in, the screen is thrown away, and the terminal can be lost."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import termios
import threading
import time
from pathlib import Path

from tests.reliability.commands import Process

ROWS, COLUMNS = 40, 120


class Terminal:
    """A terminal of 40 rows; `rigctl` with some arguments is what runs in it."""

    def __init__(self, work: Path, *arguments: object) -> None:
        self._ours, self._theirs = pty.openpty()
        self._wake, self._waker = os.pipe()
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self._screen = work / "screen.txt"
        self._screen.touch()
        self._pressed_at = 0
        self._reader = threading.Thread(target=self._read, name="terminal", daemon=True)
        self._reader.start()
        self.process = Process(work, *arguments, terminal=os.ttyname(self._theirs))

    def shows(self, words: str) -> bool:
        """Whether these words were drawn since the last keys, in one piece."""
        return words.encode() in self._screen.read_bytes()[self._pressed_at :]

    def press(self, keys: str) -> None:
        """Type."""
        self._pressed_at = self._screen.stat().st_size
        os.write(self._ours, keys.encode())

    def lose(self) -> float:
        """The window is closed, the line drops: the console is told HUP by the system. Returns the monotonic time."""
        self._end_reader()
        at_s = time.monotonic()
        self.close()
        return at_s

    def close(self) -> None:
        """Give the pseudo-terminal back; may be called twice."""
        self._end_reader()
        for descriptor in (self._theirs, self._ours):
            if descriptor >= 0:
                os.close(descriptor)
        self._theirs = self._ours = -1

    def _end_reader(self) -> None:
        """Who still reads from a descriptor keeps the terminal alive after it is closed, up to the next bytes."""
        if self._reader.is_alive():
            os.write(self._waker, b".")
            self._reader.join()
            os.close(self._wake)
            os.close(self._waker)

    def _read(self) -> None:
        with self._screen.open("wb") as shown:
            while self._ours in select.select([self._ours, self._wake], [], [])[0]:
                shown.write(os.read(self._ours, 65536))
                shown.flush()
