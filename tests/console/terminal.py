"""`rigctl console` on a pseudo-terminal, with somebody at its keys."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path

SLOW_S = 90.0
_ESCAPES = re.compile(r"\x1b(\[[0-9;?<>=]*[ -/]*[@-~]|\][^\x07]*\x07|[()][A-Z0-9]|[=>78])")


class Terminal:
    """`rigctl console` on a pseudo-terminal of its own."""

    def __init__(
        self, directory: Path, *arguments: object, columns: int = 80, rows: int = 24, **environment: str
    ) -> None:
        self._ours, theirs = os.openpty()
        self.resize(columns, rows)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rigctl", "console", *map(str, arguments)],
            cwd=directory,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env={
                # These two are believed before the terminal is asked.
                **{name: value for name, value in os.environ.items() if name not in {"COLUMNS", "LINES"}},
                "TERM": "xterm-256color",
                "XDG_STATE_HOME": str(directory / "state"),
                **environment,
            },
            start_new_session=True,
        )
        os.close(theirs)
        self.seen = bytearray()
        self.feed: Callable[[bytes], object] = lambda _: None
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def text(self) -> str:
        """All that was ever drawn, without escape sequences."""
        return _ESCAPES.sub("", self.seen.decode(errors="replace"))

    def resize(self, columns: int, rows: int) -> None:
        """As who drags the corner of its window."""
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def type(self, keys: str) -> None:
        """Keys, as fast as they come."""
        os.write(self._ours, keys.encode())

    def sees(self, words: str) -> None:
        """Wait until words were drawn."""
        self.until(lambda: words in self.text, words)

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Wait until something is so."""
        deadline = time.monotonic() + SLOW_S
        while not condition():
            assert time.monotonic() < deadline, f"{what}: it did not happen:\n{self.text[-4000:]}"
            assert self.process.poll() is None or condition(), f"the console ended first:\n{self.text[-4000:]}"
            time.sleep(0.05)

    def ends(self) -> int:
        """Wait for its status."""
        return self.process.wait(SLOW_S)

    def hang_up(self) -> None:
        """The connection drops."""
        os.close(self._ours)

    def close(self) -> None:
        """Whatever is left of it."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._ours, 65536)
            except OSError:  # nobody has it open any more
                return
            if not data:
                return
            self.seen += data
            self.feed(data)
