"""A file of bounded size: the first bytes of an endless text, and a ring of its last ones."""

from __future__ import annotations

import os
import weakref
from pathlib import Path


class RingFile:
    """Made by its first byte; every line is handed to the system at once, so a killed process loses none.

    Byte `p` of the text stands at `p` up to `head + ring`, from then on in the ring behind the head. A line is
    shorter than the ring.
    """

    def __init__(self, path: Path, head_bytes: int, ring_bytes: int) -> None:
        # Never over a log that is there.
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._head, self._ring = head_bytes, ring_bytes
        self._position = 0
        self.close = weakref.finalize(self, os.close, self._file)
        """No more lines; done by itself when nobody has it any more."""

    def append(self, line: bytes) -> None:
        """The next line; `OSError` when the system does not take it."""
        position, self._position = self._position, self._position + len(line)
        place = self._place(position)
        room = self._head + self._ring - place
        os.pwrite(self._file, line[:room], place)
        if len(line) > room:
            # Its beginning first: a line is whole when its end is there.
            os.pwrite(self._file, line[room:], self._head)

    def _place(self, position: int) -> int:
        return position if position < self._head else self._head + (position - self._head) % self._ring


def lines_in(data: bytes, head_bytes: int) -> list[bytes]:
    """The lines of such a file in no order, parts of lines among them: where head and ring meet, and the ring's ends.

    A line over either seam is among them as a whole.
    """
    *head, seam = data[:head_bytes].split(b"\n")
    first, *ring = data[head_bytes:].split(b"\n")
    if not ring:
        return [*head, seam + first]
    *ring, last = ring
    # Of the seams only one can be whole: the ring's first bytes end a line of the head, or one of the ring's end.
    return [*head, seam + first, *ring, last + first]
