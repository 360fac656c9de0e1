"""A note beside the store of what was on stable storage last: `STORE-synced`.

SQLite takes a damaged, shortened or missing write-ahead log for one that ends early, and shows the store as it was
before, whole and consistent. The note says how far it had come. It is written after a sync, itself never synced: it
may lag behind the store, and is never ahead of it.
"""

from __future__ import annotations

import os
import zlib
from contextlib import suppress
from os import pwrite
from pathlib import Path

from rigctl.campaign.store.ledger import Mark
from rigctl.core.errors import DamagedStore

SUFFIX = "-synced"
# Always as long, so that a shorter text leaves nothing of a longer one behind.
_BYTES = 128


def path_of(store: Path) -> Path:
    """Where the note of a store lies."""
    return store.with_name(store.name + SUFFIX)


class Note:
    """The note of a store that is open for writing; the file is made when there is something to say."""

    def __init__(self, store: Path) -> None:
        self._path = path_of(store)
        self._file: int | None = None

    def write(self, mark: Mark) -> None:
        """Note that the store is on stable storage up to `mark`; if that fails, it is a check less and no error."""
        text = _text(mark).ljust(_BYTES).encode()
        with suppress(OSError):
            if self._file is None:
                self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o644)
            # Written over and never cut: cutting a file makes its file system wait.
            pwrite(self._file, text, 0)

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def read(store: Path) -> Mark | None:
    """What the note says; None without one that can be read."""
    try:
        with path_of(store).open("rb") as file:
            text = file.read(_BYTES).decode().rstrip()
        name, changes, _ = text.split()
        mark = Mark(name, int(changes))
    except (OSError, ValueError):
        return None
    return mark if text == _text(mark) else None


def _text(mark: Mark) -> str:
    position = f"{mark.store} {mark.commits}"
    return f"{position} {zlib.crc32(position.encode()):08x}"


def missing(noted: Mark | None, mark: Mark) -> int:
    """How many durable transactions a store has lost; `mark` is read after the note."""
    # The note may lag, so a store ahead of it is in order; a note of another store says nothing.
    return max(0, noted.commits - mark.commits) if noted is not None and noted.store == mark.store else 0


def require_all(store: Path, noted: Mark | None, mark: Mark) -> None:
    """Raise `DamagedStore` when the store has lost anything."""
    if lost := missing(noted, mark):
        raise DamagedStore(
            f"{store}: its last {lost} changes are missing, the write-ahead log beside it is damaged or gone; save "
            f"all that verifies with `rigctl export --salvage`, or do without them: delete {path_of(store)}"
        )


def clear(store: Path) -> None:
    """Remove the note once the write-ahead log is gone, all of it being in the store."""
    # SQLite removes the log when the last connection closes; while it is there, others still write.
    if not store.with_name(store.name + "-wal").exists():
        with suppress(OSError):  # not there, or on a medium that cannot be written
            path_of(store).unlink()
