"""Pause, go on and abort from threads, signals and other processes; who holds what."""

from __future__ import annotations

import fcntl
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl import config
from rigctl.campaign import locks
from rigctl.campaign.control import Control, RequestWatcher, forget_requests
from rigctl.campaign.recording import Header
from rigctl.campaign.status import status_of
from rigctl.campaign.store import Store
from rigctl.errors import Aborted, DataError, LinkLost, RigError

PATIENCE_S = 10.0


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.create(tmp_path / "x.rig.sqlite", Header("sensing-axis")) as made:
        yield made


class Safe:
    """Makes the rig safe, and can be waited for."""

    def __init__(self, error: RigError | None = None) -> None:
        self.calls = 0
        self.called = threading.Event()
        self._error = error

    def __call__(self) -> None:
        self.calls += 1
        self.called.set()
        if self._error is not None:
            raise self._error


def test_an_abort_makes_safe_at_once_and_keeps_the_first_reason() -> None:
    safe = Safe()
    control = Control(safe)
    control.abort("fire")
    assert safe.calls == 1
    control.abort("flood")
    assert control.reason == "fire"
    with pytest.raises(Aborted, match=r"^fire$"):
        control.raise_if_aborted()


def test_an_abort_asked_for_in_a_signal_handler_is_carried_out_by_the_watcher_once() -> None:
    safe = Safe()
    control = Control(safe)
    control.heed()
    control.raise_if_aborted()
    control.ask_to_abort("interrupted by SIGINT")
    control.ask_to_abort("interrupted by SIGTERM")
    assert safe.calls == 0, "a handler may have interrupted anything: it only leaves a note"
    assert control.aborted
    control.heed()
    control.heed()
    assert safe.calls == 1
    with pytest.raises(Aborted, match="SIGINT"):
        control.raise_if_aborted()


def test_a_pause_is_left_by_going_on_or_by_an_abort() -> None:
    rested = []
    control = Control(Safe(), lambda: rested.append(True))
    control.pause()
    control.while_paused(control.go_on)
    assert rested == [True]
    assert not control.paused
    control.pause()
    with pytest.raises(Aborted, match="fire"):
        control.while_paused(lambda: control.abort("fire"))
    assert not control.paused


def wait_for(condition: Callable[[], Any]) -> None:
    ticks = threading.Event()
    for _ in range(int(PATIENCE_S / 0.01)):
        if condition():
            return
        ticks.wait(0.01)
    pytest.fail("it did not happen")


def test_requests_in_the_store_are_obeyed_in_order(store: Store) -> None:
    safe = Safe()
    control = Control(safe)
    with RequestWatcher(store.path, control):
        store.add_request("pause")
        wait_for(lambda: control.paused)
        store.add_request("resume")
        wait_for(lambda: not control.paused)
        store.add_request("abort")
        assert safe.called.wait(PATIENCE_S)
    assert control.reason == "the operator asked for it (rigctl abort)"
    assert store.take_request() is None


def test_a_signals_abort_is_heeded_without_the_store(store: Store) -> None:
    safe = Safe()
    control = Control(safe)
    with RequestWatcher(store.path, control):
        control.ask_to_abort("interrupted by SIGTERM")
        assert safe.called.wait(PATIENCE_S)


def test_an_instrument_that_will_not_stop_does_not_end_the_watch(
    store: Store, capfd: pytest.CaptureFixture[str]
) -> None:
    safe = Safe(LinkLost("stage: no connection"))
    control = Control(safe)
    with RequestWatcher(store.path, control) as watcher:
        store.add_request("abort")
        assert safe.called.wait(PATIENCE_S)
        store.add_request("pause")
        wait_for(lambda: control.paused)
        assert watcher._thread.is_alive()
    assert control.aborted
    assert capfd.readouterr().err == ""


def test_a_store_that_cannot_be_read_for_a_while_does_not_end_the_watch(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = threading.Event()

    def busy(_: Store) -> None:
        tried.set()
        raise DataError("another program has been writing for 10 s")

    safe = Safe()
    control = Control(safe)
    monkeypatch.setattr(Store, "take_request", busy)
    with RequestWatcher(store.path, control):
        assert tried.wait(PATIENCE_S)
        control.ask_to_abort("interrupted by SIGINT")
        assert safe.called.wait(PATIENCE_S)


def test_what_was_asked_of_a_campaign_that_had_ended_is_forgotten(store: Store) -> None:
    store.add_request("abort")
    store.add_request("pause")
    forget_requests(store)
    assert store.take_request() is None


# Status seen from outside


def test_a_campaign_whose_process_is_gone_is_interrupted(store: Store) -> None:
    store.set_status({"state": "running", "step": "axis X", "runs_planned": 6, "eta_s": 12.0})
    with locks.held(locks.store_lock(store.path), "taken"):
        assert status_of(store.path)["state"] == "running"
    found = status_of(store.path)
    assert (found["state"], found["step"], found["runs_planned"]) == ("interrupted", "axis X", 6)


@pytest.mark.parametrize("state", ["done", "aborted", "interrupted"])
def test_a_state_that_was_written_down_stays(store: Store, state: str) -> None:
    store.set_status({"state": state, "step": "", "runs_planned": 6, "eta_s": None})
    assert status_of(store.path)["state"] == state


def test_a_campaign_killed_before_it_could_say_anything_is_interrupted(store: Store) -> None:
    assert status_of(store.path)["state"] == "interrupted"


# Locks


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
    with pytest.raises(DataError, match=r"none/a.lock: cannot be made \(No such file"):
        locks.held(tmp_path / "none" / "a.lock", "taken").__enter__()


def rig(*addresses: str) -> config.RigFile:
    tables = [
        f'[instruments.i{n}]\ndriver = "newport-xps"\naddress = "{address}"\nrole = "spare"\n'
        for n, address in enumerate(addresses)
    ]
    return config.parse_rig('[rig]\nname = "x"\n' + "".join(tables), Path("rig.toml"))


def test_rigs_that_share_one_instrument_exclude_each_other() -> None:
    ours, theirs = (f"tcp://127.0.0.1:{os.getpid() % 50000 + n}" for n in (1, 2))

    def can_run(file: config.RigFile) -> bool:
        try:
            with locks.instruments_held(file, "busy"):
                return True
        except RigError as error:
            return not str(error).startswith("busy (tcp://")

    with locks.instruments_held(rig(ours, "sim:"), "busy"):
        assert not in_another_process(lambda: can_run(rig(theirs, ours)))
        assert in_another_process(lambda: can_run(rig(theirs)))
        assert in_another_process(lambda: can_run(rig("sim:"))), "what lives in a process is nobody else's"
    assert in_another_process(lambda: can_run(rig(theirs, ours)))
