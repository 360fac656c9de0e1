"""Pause, go on and abort from threads, signals and other processes."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.session import locks
from rigctl.campaign.session.control import Control, RequestWatcher, forget_requests
from rigctl.campaign.session.heartbeat import STALLED_S
from rigctl.campaign.status import status_of
from rigctl.campaign.store.store import Store
from rigctl.core.errors import Aborted, DataError, LinkLost, RigError
from rigctl.core.making_safe import STOPPED

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


def test_after_an_abort_nobody_has_the_instruments_even_if_they_would_not_stop() -> None:
    happened: list[str] = []

    def make_safe() -> None:
        happened.append("stopped")
        raise LinkLost("stage: no connection")

    control = Control(make_safe, disconnect=lambda: happened.append("disconnected"))
    with pytest.raises(LinkLost):
        control.abort("fire")
    assert happened == ["stopped", "disconnected"]


def test_a_pause_is_left_by_going_on_or_by_an_abort() -> None:
    control = Control(Safe())
    control.pause()
    control.while_paused(control.go_on)
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


def test_a_stop_is_recorded_as_one(store: Store) -> None:
    control = Control(Safe())
    with RequestWatcher(store.path, control):
        store.add_request("stop")
        wait_for(lambda: control.aborted)
    assert control.reason == STOPPED


def test_a_campaign_beats_whatever_it_waits_for_and_its_status_says_how_long_ago(store: Store) -> None:
    lock = locks.store_lock(store.path)
    with locks.held(lock, "held"):
        hour_ago_s = time.time() - 3600.0
        os.utime(lock, (hour_ago_s, hour_ago_s))
        assert status_of(store.path)["heartbeat_age_s"] == pytest.approx(3600.0, abs=PATIENCE_S)
        with RequestWatcher(store.path, Control(Safe())):
            wait_for(lambda: status_of(store.path)["heartbeat_age_s"] < STALLED_S)
        assert not status_of(store.path)["killed"]
    # The lock ended with its process, and the process did not say how it ended.
    status = status_of(store.path)
    assert (status["state"], status["killed"], status["heartbeat_age_s"]) == ("interrupted", True, None)


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
    take_request = Store.take_request
    troubles = iter([True, True])

    def busy(opened: Store) -> str | None:
        if next(troubles, False):
            raise DataError("another program has been writing for 10 s")
        return take_request(opened)

    safe = Safe()
    monkeypatch.setattr(Store, "take_request", busy)
    with RequestWatcher(store.path, Control(safe)):
        store.add_request("abort")
        assert safe.called.wait(PATIENCE_S)
    assert next(troubles, None) is None


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
