"""Files that are written: whole or not at all, and what is said when the disk does not take them."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rigctl.core.errors import DataError, StorageError

_FULL = {errno.ENOSPC, errno.EDQUOT}
_OF_THE_DISK = _FULL | {errno.EFBIG, errno.EIO}


def mend_of(error: OSError, otherwise: str) -> str:
    """What to do about a file that cannot be written."""
    return "free some space" if error.errno in _FULL else otherwise


@contextmanager
def writing(path: Path, why: str = "cannot be written", mend: str = "check the directory") -> Iterator[None]:
    """`DataError` that names `path` for what the system says inside; `StorageError` where the disk is to blame."""
    try:
        yield
    except OSError as error:
        kind = StorageError if error.errno in _OF_THE_DISK else DataError
        raise kind(f"{path}: {why} ({error.strerror or error}); {mend_of(error, mend)}") from error


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write a new file that takes the name `path` only when all is written.

    `DataError` if `path` exists or cannot be made; then, and whatever else ends the writing, nothing is left.
    """
    # In the same directory, so that the rename is one step of one file system.
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with writing(path, mend="check the directory and the disk"):
            if path.exists():
                raise DataError(f"{path}: exists already; name another file")
            # Told apart from what writes the content: its own words for a missing directory are many lines long.
            partial.touch()
            yield partial
            partial.rename(path)
    finally:
        with suppress(OSError):
            partial.unlink()
