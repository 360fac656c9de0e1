"""Locks: between processes and users, by whatever name."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from rigctl.campaign.session import holders, locks
from rigctl.campaign.session.addresses import Claim
from rigctl.core.errors import ConfigError, DataError, RigError
from rigctl.core.making_safe import STOP_SIGNAL
from rigctl.files.rig_file import RigFile, parse_rig


def in_another_process(action: Callable[[], bool]) -> bool:
    """What `action` finds in a process of its own."""
    child = os.fork()
    if child == 0:
        code = 2
        try:
            code = 0 if action() else 1
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in {0, 1}
    return code == 0


def can_hold(path: Path) -> bool:
    try:
        with locks.held(path, "taken"):
            return True
    except RigError:
        return False


def test_a_lock_is_held_by_one_process_and_ends_with_it(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    assert not locks.is_held(path)
    with locks.held(path, "taken"):
        assert in_another_process(lambda: locks.is_held(path))
        assert not in_another_process(lambda: can_hold(path))
    assert in_another_process(lambda: can_hold(path))

    def dies_holding_it() -> bool:
        locks.held(path, "taken").__enter__()
        os._exit(0)

    assert in_another_process(dies_holding_it)
    assert not locks.is_held(path)


def test_somebody_who_asks_just_then_whether_a_lock_is_held_does_not_refuse_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock = fcntl.flock
    asking = iter([True, True])

    def contended(handle: int, operation: int) -> None:
        if next(asking, False):
            raise BlockingIOError
        flock(handle, operation)

    monkeypatch.setattr(fcntl, "flock", contended)
    with locks.held(tmp_path / "a.lock", "taken"):
        assert in_another_process(lambda: locks.is_held(tmp_path / "a.lock"))


def test_a_lock_in_no_directory_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none/a.lock: cannot be made or opened \(No such file"):
        locks.held(tmp_path / "none" / "a.lock", "taken").__enter__()


def test_links_and_pipes_in_the_place_of_a_lock_are_refused_and_untouched(tmp_path: Path) -> None:
    (tmp_path / "link.lock").symlink_to(tmp_path / "target")
    os.mkfifo(tmp_path / "pipe.lock")
    for name, why in (("link", "it is a link"), ("pipe", "it is no plain file")):
        with pytest.raises(DataError, match=f"{name}.lock: .*{why}"):
            locks.held(tmp_path / f"{name}.lock", "taken").__enter__()
    assert not (tmp_path / "target").exists()


def test_on_a_place_for_reading_only_a_lock_tells_whether_it_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = os.open

    def read_only(path: Path, flags: int, *mode: int) -> int:
        if flags & os.O_RDWR:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return opened(path, flags, *mode)

    lock = tmp_path / "night.rig.sqlite.lock"
    lock.touch()
    with monkeypatch.context() as patched:
        patched.setattr(os, "open", read_only)
        assert not locks.is_held(lock)
    with locks.held(lock, "held"), monkeypatch.context() as patched:
        patched.setattr(os, "open", read_only)
        assert locks.is_held(lock)


def test_a_lock_that_was_deleted_while_it_was_taken_is_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, flock = tmp_path / "a.lock", fcntl.flock
    deleting = iter([True])

    def deleted(handle: int, operation: int) -> None:
        flock(handle, operation)
        if next(deleting, False):
            path.unlink()

    monkeypatch.setattr(fcntl, "flock", deleted)
    with locks.held(path, "taken"):
        assert in_another_process(lambda: locks.is_held(path))


def test_whoever_makes_a_lock_every_user_can_take_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "place"
    place.mkdir()
    place.chmod(0o1777)
    monkeypatch.setattr(locks, "DIRECTORIES", (tmp_path, place))
    path = locks.instrument_lock(Claim("meter"))
    assert path.parent == place
    before = os.umask(0o077)
    try:
        with locks.held(path, "taken"):
            pass
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o666

    def as_nobody() -> bool:
        os.chdir(place)
        if os.geteuid() == 0:
            os.setuid(65534)
        return can_hold(Path(path.name))

    assert in_another_process(as_nobody)
    with locks.held(path, "taken"):
        assert not in_another_process(as_nobody)


def test_without_a_place_for_all_nobody_is_let_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(locks, "DIRECTORIES", (tmp_path,))
    with pytest.raises(RigError, match=r"no place for locks that every user can take; give one of .* the mode 1777"):
        locks.instruments_held(rig("tcp://127.0.0.1:5001"), "busy").__enter__()


def rig(*addresses: str) -> RigFile:
    tables = [
        f'[instruments.i{n}]\ndriver = "newport-xps"\naddress = "{address}"\nrole = "spare"\n'
        for n, address in enumerate(addresses)
    ]
    return parse_rig('[rig]\nname = "x"\n' + "".join(tables), Path("rig.toml"))


def can_run(file: RigFile) -> bool:
    try:
        with locks.instruments_held(file, "busy"):
            return True
    except RigError as error:
        return not str(error).startswith("busy (")


def test_rigs_that_share_one_instrument_exclude_each_other() -> None:
    ours, theirs = (f"tcp://127.0.0.1:{os.getpid() % 50000 + n}" for n in (1, 2))
    with locks.instruments_held(rig(ours, "sim:"), "busy"):
        assert not in_another_process(lambda: can_run(rig(theirs, ours)))
        assert in_another_process(lambda: can_run(rig(theirs)))
        assert in_another_process(lambda: can_run(rig("sim:"))), "what lives in a process is nobody else's"
    assert in_another_process(lambda: can_run(rig(theirs, ours)))


def test_no_other_spelling_and_no_other_tmpdir_lets_a_second_program_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = os.getpid() % 50000 + 3
    with locks.instruments_held(rig(f"tcp://127.0.0.1:{port}"), "busy"):
        monkeypatch.setenv("TMPDIR", str(tmp_path))
        monkeypatch.setattr(tempfile, "tempdir", None)
        for spelling in (
            f"tcp://localhost:{port}",
            f"TCPIP::127.0.0.1::{port}::SOCKET",
            f"tcp://127.0.0.1:0{port}",
            f"TCP://127.0.0.1:{port}",
            f"tcp://127.0.0.1:{port}/",
        ):
            same = rig(spelling)
            assert not in_another_process(partial(can_run, same)), spelling


def test_a_rig_file_that_names_one_instrument_twice_is_refused() -> None:
    twice = rig("tcp://127.0.0.1:5001", "sim:", "TCPIP::localhost::05001::SOCKET")
    with pytest.raises(
        ConfigError, match=r"rig.toml: instruments.i2.address 'TCPIP.*' is the instrument of instruments.i0, 'tcp://"
    ):
        locks.claimed_by(twice)
    groups = [
        f'[instruments.{name}]\ndriver = "newport-xps"\naddress = "tcp://127.0.0.1:5001"\nrole = "spare"\n'
        f'group = "{name}"\n'
        for name in ("one", "two")
    ]
    both = parse_rig('[rig]\nname = "x"\n' + "".join(groups), Path("rig.toml"))
    assert len(locks.claimed_by(both)) == 2, "an XPS answers for several groups"


IGNORES_TERM = """
import signal, sys, time
from pathlib import Path
from rigctl.campaign.session import locks
signal.signal(signal.SIGTERM, signal.SIG_IGN)
with locks.held(Path(sys.argv[1]), "taken"):
    print("held", flush=True)
    time.sleep(60.0)
"""


def test_who_does_not_leave_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(holders, "LEAVES_S", 0.05)
    file = rig("serial:/dev/holder-of-nothing")
    lock = min(locks.instrument_lock(claim) for _, claims in locks.claimed_by(file) for claim in claims)
    with holders.told_to_leave(file) as told:
        assert told == {}
    with subprocess.Popen([sys.executable, "-c", IGNORES_TERM, str(lock)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        with holders.told_to_leave(file) as told:
            (holder,) = told.values()
            assert holder.process == process.pid
            with pytest.raises(RigError, match=f"process {process.pid} uses it and has not left 0.05 s after"):
                holder.await_left()
        monkeypatch.setattr(holders, "LEAVES_S", 30.0)
        with holders.told_to_leave(file, STOP_SIGNAL) as told:
            (holder,) = told.values()
            holder.await_left()
        assert process.wait() == -STOP_SIGNAL
