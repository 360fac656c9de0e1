"""Who is at work: one process per store, one campaign per instrument."""

from __future__ import annotations

import fcntl
import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rigctl.config import RigFile
from rigctl.errors import DataError, RigError

TRIES = 5
TRY_AGAIN_S = 0.01
"""Whoever asks `is_held` holds the lock for an instant; a holder holds it for long."""


@contextmanager
def held(path: Path, refusal: str) -> Iterator[None]:
    """Hold the lock file at `path`; `RigError(refusal)` when another process does. Ends with the process."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise DataError(f"{path}: cannot be made ({error.strerror}); check the directory") from None
    try:
        if not _taken(handle):
            raise RigError(refusal)
        yield
    finally:
        os.close(handle)


def _taken(handle: int) -> bool:
    for attempt in range(TRIES):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(TRY_AGAIN_S if attempt < TRIES - 1 else 0.0)
        else:
            return True
    return False


def is_held(path: Path) -> bool:
    """True when another process holds the lock file at `path`."""
    if not path.exists():
        return False
    handle = os.open(path, os.O_RDONLY)
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


@contextmanager
def instruments_held(rig: RigFile, refusal: str) -> Iterator[None]:
    """Hold every instrument a rig file names by address, for two rig files may share one; `RigError(refusal)`.

    Those that live in the process itself are nobody else's.
    """
    with ExitStack() as stack:
        for address in sorted({table.address for table in rig.instruments.values() if not table.simulated}):
            digest = hashlib.sha256(address.encode()).hexdigest()[:16]
            path = Path(tempfile.gettempdir()) / f"rigctl-{digest}.lock"
            stack.enter_context(held(path, f"{refusal} ({address})"))
        yield
