"""A file that is there whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rigctl.core.errors import DataError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write a new file that takes the name `path` only when all is written.

    `DataError` if `path` exists or cannot be made; then, and whatever else ends the writing, nothing is left.
    """
    # In the same directory, so that the rename is one step of one file system.
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        if path.exists():
            raise DataError(f"{path}: exists already; name another file")
        # Told apart from what writes the content: its own words for a missing directory are many lines long.
        partial.touch()
        yield partial
        partial.rename(path)
    except OSError as error:
        why = error.strerror or error
        raise DataError(f"{path}: cannot be written ({why}); check the directory and the disk") from error
    finally:
        with suppress(OSError):
            partial.unlink()
