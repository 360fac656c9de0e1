"""Programs on pseudo-terminals: processor time until something is on the screen, keys sent, words waited for."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path

WATCHED = """
import os, sys, time
from textual.drivers.linux_driver import LinuxDriver
word, took = sys.argv[1:]
write = LinuxDriver.write
def noted(driver, data):
    write(driver, data)
    if word in data:
        with open(took, 'w') as file:
            file.write(str(time.process_time()))
        os._exit(0)
LinuxDriver.write = noted
"""
"""Ends with the first text on the terminal that has a word, and leaves the processor time until then in a file."""


def processor_s(program: str, word: str, state: str, keys: bytes = b"") -> float:
    """Processor time until a program has written a word to a terminal of 80 x 24 on which keys were typed ahead."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    took = Path(state) / "took"
    command = [sys.executable, "-c", program, word, str(took)]
    # As installed: an index's installer compiles all modules, so none is compiled at a start.
    env = dict(os.environ, TERM="xterm-256color", XDG_STATE_HOME=state, PYTHONPYCACHEPREFIX=f"{state}/compiled")
    env.pop("PYTHONDONTWRITEBYTECODE", None)
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True)
    os.close(theirs)
    os.write(ours, keys)
    while process.poll() is None:
        if select.select([ours], [], [], 0.05)[0]:
            with suppress(OSError):  # it has ended
                os.read(ours, 65536)
    os.close(ours)
    return float(took.read_text())


class OnTerminal:
    """A program on a terminal of 120 x 40, the keys it is sent and the processor time it takes."""

    def __init__(self, state: str, *command: str) -> None:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        env = dict(os.environ, TERM="xterm-256color", XDG_STATE_HOME=state)
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=env, start_new_session=True
        )
        os.close(theirs)

    def __enter__(self) -> OnTerminal:
        return self

    def __exit__(self, *raised: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._ours)

    def press(self, keys: str, until: str, timeout_s: float = 60.0) -> None:
        """Send keys, and wait until the screen has words that they bring."""
        os.write(self._ours, keys.encode())
        self.sees(until, timeout_s)

    def sees(self, words: str, timeout_s: float = 60.0) -> None:
        """Wait for words in what is written from now on."""
        written, ends_s = b"", time.monotonic() + timeout_s
        while words.encode() not in written:
            if time.monotonic() > ends_s:
                raise TimeoutError(f"{words!r} has not come: {written[-500:]!r}")
            written += self._read(0.1)

    def idle(self, for_s: float) -> None:
        """Read what is written while nobody does anything."""
        ends_s = time.monotonic() + for_s
        while (left_s := ends_s - time.monotonic()) > 0.0:
            self._read(left_s)

    def _read(self, within_s: float) -> bytes:
        return os.read(self._ours, 65536) if select.select([self._ours], [], [], within_s)[0] else b""

    @property
    def processor_s(self) -> float:
        """Of all its threads so far, to a hundredth."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
