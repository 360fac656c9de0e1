"""The programs that hold a rig's instruments, and how they are told to bring them to rest and leave.

A serial line has no room for two: their bytes would mix, and each would take the other's replies. Who wants to stop
what another program uses therefore has it leave; TERM, or a console's STOP, makes every program of ours stop all at
once, and confirm.
"""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rigctl.campaign.session.locks import claimed_by, instrument_lock
from rigctl.core.errors import ConfigError, RigError
from rigctl.core.interfaces import Instrument
from rigctl.core.making_safe import Rest, bring_to_rest, let_go
from rigctl.files.rig_file import RigFile

LOCKS = Path("/proc/locks")
LEAVES_S = 4.0
"""How long a program may take to leave [s of wall-clock]: before a stop gives up."""


@dataclass(frozen=True)
class Holder:
    """A program of this machine that was told to leave, or `refused` to be told; `handle` is the process itself."""

    process: int
    handle: int
    told_s: float
    refused: str = ""

    def await_left(self) -> None:
        """Return when it has ended; `RigError` when it has not `LEAVES_S` after it was told."""
        left_s = max(self.told_s + LEAVES_S - time.monotonic(), 0.0)
        if self.refused or not select.select([self.handle], [], [], left_s)[0]:
            why = self.refused or f"has not left {LEAVES_S:g} s after it was told to"
            raise RigError(f"process {self.process} uses it and {why}; end it, then stop again")


@dataclass(frozen=True)
class Used:
    """An instrument that a program uses: stopped at once if it serves two, and for certain when that has left."""

    instrument: Instrument
    holder: Holder

    @property
    def name(self) -> str:
        """The instrument's."""
        return self.instrument.name

    def stop(self) -> None:
        """As the instrument's."""
        # At once if the instrument serves two clients; a serial line may be refused, and is stopped below.
        with suppress(RigError):
            self.instrument.stop()
        self.holder.await_left()
        # Once more: the program that has left may have sent a motion after the first stop.
        self.instrument.stop()


def stopped_from_outside(
    rig: RigFile, instruments: Mapping[str, Instrument], by: signal.Signals = signal.SIGTERM
) -> tuple[Rest, ...]:
    """Bring some instruments of a rig to rest, by name, whoever uses them: `by` tells all others to leave.

    The instruments need not be connected, and are not afterwards.
    """
    with told_to_leave(rig, by) as holders:
        used = {name: holders[at] for name in instruments if (at := rig.instruments[name].address) in holders}
        rests = bring_to_rest(Used(each, used[name]) if name in used else each for name, each in instruments.items())
        let_go(instruments.values())
    return rests


@contextmanager
def told_to_leave(rig: RigFile, by: signal.Signals = signal.SIGTERM) -> Iterator[dict[str, Holder]]:
    """Tell every other program that holds an instrument of a rig to leave; who that is, by address; `by` tells it."""
    with ExitStack() as stack:
        holders: dict[int, Holder] = {}
        by_address: dict[str, Holder] = {}
        for address, lock in _locks(rig):
            process = process_at(lock)
            if process not in holders and process not in {None, os.getpid()}:
                with suppress(ProcessLookupError):  # it has just left
                    handle = os.pidfd_open(process)
                    stack.callback(os.close, handle)
                    if process_at(lock) == process:  # the handle is of the one that holds it, not of a later one
                        holders[process] = _tell(process, handle, by)
            if process in holders:
                by_address[address] = holders[process]
        yield by_address


def process_at(lock: Path) -> int | None:
    """The process that holds a lock file alone; None when there is none, or none that can be seen from here."""
    try:
        file = lock.stat()
        lines = LOCKS.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    # The kernel names files by device and inode, with the device's numbers in hexadecimal.
    where = f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}:{file.st_ino}"
    for line in lines:
        match line.split():
            case [_, "FLOCK", _, "WRITE", process, held, *_] if held == where and process.isdecimal():
                # 0 stands for a process of another namespace, as seen from a container.
                return int(process) or None
    return None


def _locks(rig: RigFile) -> list[tuple[str, Path]]:
    try:
        claimed = claimed_by(rig)
    except ConfigError:  # names one instrument twice: who stops it need not mind
        return []
    return [(address, instrument_lock(claim)) for address, claims in claimed for claim in claims if not claim.shared]


def _tell(process: int, handle: int, by: signal.Signals) -> Holder:
    try:
        signal.pidfd_send_signal(handle, by)
    except PermissionError:
        return Holder(process, handle, time.monotonic(), "belongs to another user")
    return Holder(process, handle, time.monotonic())
