"""Where a store lies: whether it can be written there, and how it is read where nothing can be.

SQLite reads a store with a write-ahead log only where it can make the log and its index beside the file, or finds
both. On an archive (a write-protected share, a CD) there is the file alone, and nobody can be writing it: then it is
read as a file that does not change.
"""

from __future__ import annotations

import os
from pathlib import Path

from rigctl.core.errors import StorageError

READ_ONLY = "on a place, or with permissions, for reading only; copy the store to where it can be written"


def can_be_written(store: Path) -> bool:
    """Whether the file, and the log beside it, can be written here."""
    file = store.resolve()
    return os.access(file, os.W_OK) and os.access(file.parent, os.W_OK)


def is_archived(store: Path) -> bool:
    """Whether a store is to be read as a file that does not change; `StorageError` where it is not all there.

    Never where it may be at work: who has a store open has its log and the log's index beside it.
    """
    file = store.resolve()
    if os.access(file.parent, os.W_OK):
        return False
    log, index = (file.with_name(file.name + suffix) for suffix in ("-wal", "-shm"))
    if not log.exists():
        return True
    if index.exists():
        return False
    if log.stat().st_size:
        # Without it the store would look whole, and as it was some runs ago.
        raise StorageError(
            f"{store}: its last changes are in {log.name}, which cannot be read on a place for reading only; "
            "copy both files to a place that can be written"
        )
    return True
