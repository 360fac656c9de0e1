"""A pseudo-terminal with a console in it: keys go in, the screen is thrown away, and the terminal can be lost."""

from __future__ import annotations

import fcntl
import os
import pty
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
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self._screen = work / "screen.txt"
        self._shown = self._screen.open("wb")
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
        at_s = time.monotonic()
        self.close()
        return at_s

    def close(self) -> None:
        """Give the pseudo-terminal back; may be called twice."""
        for descriptor in (self._theirs, self._ours):
            if descriptor >= 0:
                os.close(descriptor)
        self._theirs = self._ours = -1
        self._reader.join(5.0)

    def _read(self) -> None:
        try:
            while data := os.read(self._ours, 65536):
                self._shown.write(data)
                self._shown.flush()
        except OSError:
            pass
        self._shown.close()
