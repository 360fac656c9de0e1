"""Who is at work: one process per store, one campaign per rig."""

from __future__ import annotations

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigctl.config import RigFile
from rigctl.errors import RigError


@contextmanager
def held(path: Path, refusal: str) -> Iterator[None]:
    """Hold the lock file at `path`; `RigError(refusal)` when another process does. Ends with the process."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RigError(refusal) from None
        yield
    finally:
        os.close(handle)


def is_held(path: Path) -> bool:
    """True when another process holds the lock file at `path`."""
    if not path.exists():
        return False
    handle = os.open(path, os.O_RDWR)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def store_lock(store: Path) -> Path:
    """The lock file of a store."""
    return store.with_name(f"{store.name}.lock")


def rig_lock(rig: RigFile) -> Path | None:
    """The lock file of the instruments a rig file names, None when all live in the process itself."""
    addresses = sorted(table.address for table in rig.instruments.values() if not table.simulated)
    if not addresses:
        return None
    digest = hashlib.sha256("\n".join(addresses).encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"rigctl-{digest}.lock"
