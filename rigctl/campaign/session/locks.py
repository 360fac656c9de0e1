"""Who is at work: one process per store, one program per instrument, whoever's programs they are."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import stat
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.campaign.session.addresses import Claim, Claims, claims_of, conflict
from rigctl.core.errors import ConfigError, DataError, RigError

if TYPE_CHECKING:  # pydantic: a third of what `rigctl status` takes to start
    from rigctl.files.rig_file import InstrumentTable, RigFile

TRIES = 5
TRY_AGAIN_S = 0.01
"""Whoever asks `is_held` holds the lock for an instant; a holder holds it for long."""

DIRECTORIES = (Path("/run/lock"), Path("/var/lock"), Path("/tmp"))  # noqa: S108 - see `_opened`
"""Where locks on instruments may be: in the first in which every user may make files, so all choose the same."""

LOCK_MODE = 0o666


@contextmanager
def held(path: Path, refusal: str, *, shared: bool = False) -> Iterator[None]:
    """Hold the lock file at `path`; `RigError(refusal)` when another process does. Ends with the process.

    Those who want it `shared` do not exclude each other.
    """
    # flock, not a file with a process number in it: the kernel releases it when the process ends, however it ends.
    handle = _taken(path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    if handle is None:
        raise RigError(refusal)
    try:
        yield
    finally:
        os.close(handle)


def _taken(path: Path, kind: int) -> int | None:
    for attempt in range(TRIES):
        if attempt:
            time.sleep(TRY_AGAIN_S)
        handle = _open(path)
        try:
            fcntl.flock(handle, kind | fcntl.LOCK_NB)
            if _is_at(path, handle):  # else somebody deleted it meanwhile, and a lock on it keeps nobody off
                return handle
        except BlockingIOError:
            pass
        os.close(handle)
    return None


def _is_at(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(path.lstat(), os.fstat(handle))
    except FileNotFoundError:
        return False


def _open(path: Path) -> int:
    """The lock file, made if need be; `DataError` when it is anything but a plain file."""
    try:
        # Between a look and the making another program may make or delete it; O_EXCL tells, and the loop looks again.
        while True:
            with suppress(FileNotFoundError):
                return _opened(path)
            with suppress(FileExistsError):
                return _made(path)
    except OSError as error:
        why = "it is a link" if error.errno == errno.ELOOP else error.strerror
        raise DataError(
            f"{path}: cannot be made or opened ({why}); check the directory, or remove the file"
        ) from None


def _opened(path: Path) -> int:
    """Opened without O_CREAT, which Linux refuses on others' files in a directory for all; links may be traps."""
    # Non-blocking, because a pipe that somebody put there would be waited for.
    flags = os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        handle = os.open(path, os.O_RDWR | flags)
    except OSError as error:
        if error.errno not in {errno.EACCES, errno.EPERM, errno.EROFS}:
            raise
        handle = os.open(path, os.O_RDONLY | flags)  # enough to lock, but not over NFS
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "it is no plain file")
    return handle


def _made(path: Path) -> int:
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, LOCK_MODE)
    os.fchmod(handle, LOCK_MODE)  # whatever the umask: every user may take it
    return handle


def is_held(path: Path) -> bool:
    """True when another process holds the lock file at `path`."""
    try:
        handle = _opened(path)
    except FileNotFoundError:
        return False
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


def instrument_lock(claim: Claim) -> Path:
    """The lock file of a claim, the same for every user of this machine; `RigError` when no place is for all."""
    # A claim may hold slashes or be longer than a file's name; 64 bits do not collide by chance.
    digest = hashlib.sha256(claim.name.encode()).hexdigest()[:16]
    return lock_directory() / f"rigctl-{digest}.lock"


def lock_directory() -> Path:
    """Where locks that every user can take are; `RigError` when there is no such place."""
    for directory in DIRECTORIES:
        if directory.is_dir() and directory.stat().st_mode & stat.S_IWOTH:
            return directory
    places = ", ".join(map(str, DIRECTORIES))
    raise RigError(f"no place for locks that every user can take; give one of {places} the mode 1777")


@contextmanager
def instruments_held(rig: RigFile, refusal: str) -> Iterator[None]:
    """Hold every instrument a rig file names by address, for two rig files may share one; `RigError(refusal)`.

    Those that live in the process itself are nobody else's. `ConfigError` when the file names one instrument twice.
    """
    claimed = claimed_by(rig)
    with ExitStack() as stack:
        # All programs take them in one order: of two that begin at once, one gets all and the other none.
        for claim, address in sorted({claim: address for address, claims in claimed for claim in claims}.items()):
            stack.enter_context(held(instrument_lock(claim), f"{refusal} ({address})", shared=claim.shared))
        yield


def claimed_by(rig: RigFile) -> list[tuple[str, Claims]]:
    """The addresses of a rig file's instruments with what each claims; `ConfigError` when two are one instrument."""
    from concurrent.futures import ThreadPoolExecutor  # here, like pydantic above

    wired = {name: table.address for name, table in rig.instruments.items() if not table.simulated}
    with ThreadPoolExecutor(max_workers=max(len(wired), 1)) as pool:  # names are looked up at the same time
        claims = dict(zip(wired, pool.map(claims_of, wired.values()), strict=True))
    for one, other in combinations(wired, 2):
        if conflict(claims[one], claims[other]) and not _two_groups(rig.instruments[one], rig.instruments[other]):
            raise ConfigError(
                f"{rig.path}: instruments.{other}.address {wired[other]!r} is the instrument of instruments.{one}, "
                f"{wired[one]!r}; correct one, or leave it out"
            )
    return [(wired[name], claims[name]) for name in wired]


def _two_groups(one: InstrumentTable, other: InstrumentTable) -> bool:
    """True for two groups of axes of one controller, which answers both."""
    groups = [table.settings.get("group") for table in (one, other)]
    return one.driver == other.driver and None not in groups and groups[0] != groups[1]
