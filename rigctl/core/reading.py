"""Opening a file by name without being led elsewhere: only a regular file, only so many bytes, never a wait."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO


class NoFile(OSError):
    """Something is there, but it is no file to read; the message says what, and the mend."""


class TooLarge(OSError):
    """More bytes than allowed; the message says how many."""


def open_regular(path: str | Path, *, within: int | None = None) -> BinaryIO:
    """A regular file, open for reading; `NoFile` for a directory, a device or a pipe, which is never waited for.

    With `within`, the descriptor of the directory that `path` is in, a link is refused too. `OSError` as `open`.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
    if not stat.S_ISREG(os.stat(path, dir_fd=within, follow_symlinks=within is None).st_mode):
        raise NoFile(_what(path, within))
    file = os.open(path, flags | (os.O_NOFOLLOW if within is not None else 0), dir_fd=within)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise NoFile(_what(path, within))
    return os.fdopen(file, "rb")


def _what(path: str | Path, within: int | None) -> str:
    mode = os.stat(path, dir_fd=within, follow_symlinks=within is None).st_mode
    if stat.S_ISLNK(mode):
        return "a link; put the file itself there"
    return "a directory; name a file" if stat.S_ISDIR(mode) else "a device or a pipe; put a file there"


def read_regular(path: Path, limit: int) -> bytes:
    """The content of a file that a user names, links followed; `TooLarge` beyond `limit` bytes."""
    with open_regular(path) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise TooLarge(f"more than {limit} bytes")
    return data
