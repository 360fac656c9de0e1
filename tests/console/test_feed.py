"""What the console sees of a store: only what is new is read, and a search reaches what is not kept."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.session import locks
from rigctl.campaign.store.entries import RUN_REPEATED
from rigctl.campaign.store.store import Store
from rigctl.console import feed, store_watch
from rigctl.console.log_lines import Search
from rigctl.console.messages import StoreSeen
from rigctl.console.store_view import StoreView


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.create(tmp_path / "night.rig.sqlite", Header(experiment="sensing-axis")) as made:
        yield made


@pytest.fixture
def looks(store: Store) -> Iterator[Callable[[], StoreView]]:
    with Store.open(store.path, readonly=True) as opened:
        yield partial(store_watch._Watched(opened).look, False)


def record(store: Store, number: int, samples: int = 10) -> None:
    with store.begin_run(f"run {number}", "step", {"theta_deg": float(number)}) as run:
        for start in range(0, samples, 1000):
            t_s = np.arange(start, min(start + 1000, samples), dtype=float)
            run.append({"t_s": t_s, "accel_v": -t_s})
        run.finish()


def test_new_runs_are_added_and_one_that_is_marked_is_seen_as_marked(store: Store, looks: Any) -> None:
    record(store, 1)
    assert [run.run_id for run in looks().runs] == ["1"]
    record(store, 2)
    assert [run.run_id for run in looks().runs] == ["1", "2"]
    store.mark("1", False, "somebody slammed the door")
    view = looks()
    assert [run.valid for run in view.runs] == [False, True]
    assert (view.status["runs_done"], view.status["runs_invalid"]) == (2, 1)


def test_the_last_run_before_a_pause_is_among_the_steps_and_what_was_repeated_is_told(
    store: Store, at_console: Any
) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("2")
        record(store, 1)
        await seat.sees("✓ 1 run 1")
        # Within the second after the steps were drawn; nothing is written behind it.
        store.add_event(RUN_REPEATED, {"key": "run 2", "error": "LinkTimeout"})
        record(store, 2)
        await seat.sees("2 of 2 runs, 0 invalid, 1 repeated")
        await seat.sees("✓ 2 run 2", timeout_s=10.0)

    with locks.held(locks.store_lock(store.path), "held"):
        at_console(sitting, store.path)


def test_of_a_long_run_the_last_samples_are_seen_as_they_come(
    store: Store, looks: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_watch, "SAMPLES", 1500)
    record(store, 1, 4000)
    samples = looks().samples
    assert samples["t_s"].tolist() == list(np.arange(2500.0, 4000.0))
    assert samples["accel_v"].tolist() == (-samples["t_s"]).tolist()


def test_a_search_reaches_events_that_are_not_in_sight(
    store: Store, looks: Any, monkeypatch: pytest.MonkeyPatch, at_console: Any
) -> None:
    for number in range(store_watch.EVENTS + 5):
        store.add_event("failed" if number == 1 else "note", {"told": f"event number {number} of the night"})
    view = looks()
    assert len(view.events) == store_watch.EVENTS
    found = store_watch.earlier(store.path, Search("NUMBER 3 of"), view.events[0].id)
    assert [line.text for line in found] == ["told: event number 3 of the night"]
    alarms = store_watch.earlier(store.path, Search(only_alarms=True), view.events[0].id)
    assert [line.event for line in alarms] == [2]

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("5")
        await seat.sees(f"event number {store_watch.EVENTS + 4} of")
        assert "event number 3 of the night" not in seat.text
        await seat.press("slash", *"number 3 of")
        await seat.sees("event number 3 of the night")
        await seat.sees("1 lines")
        await seat.press("enter", "w")
        await seat.sees("0 lines, alarms only")
        await seat.press("slash", *["backspace"] * 11)
        await seat.sees("! failed        told: event number 1 of the night")

    monkeypatch.chdir(store.path.parent)
    at_console(sitting, store.path)


def test_a_store_that_breaks_is_one_line_and_the_console_goes_on(store: Store) -> None:
    posted: list[Any] = []
    watching = feed.Feed(posted.append)
    watching.start()
    try:
        bad = store.path.with_name("bad.rig.sqlite")
        bad.write_text("no store")
        watching.watch(bad)
        wait_for(lambda: posted)
        assert "bad.rig.sqlite" in posted[0].text
        watching.watch(store.path)
        wait_for(lambda: isinstance(posted[-1], StoreSeen))
    finally:
        watching.close()


def test_a_store_that_cannot_be_read_for_a_moment_is_looked_at_again(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy disk or a lock at the wrong moment must not leave the console blind to the campaign's next question."""
    posted: list[Any] = []
    whole, refused = store_watch.follow, [sqlite3.OperationalError("database is locked")] * 3

    def follow(*arguments: Any) -> None:
        if refused:
            raise refused.pop()
        whole(*arguments)

    monkeypatch.setattr(store_watch, "follow", follow)
    watching = feed.Feed(posted.append)
    watching.watch(store.path)
    watching.start()
    try:
        wait_for(lambda: isinstance(posted[-1], StoreSeen) if posted else False)
        assert [each.text for each in posted[:-1]] == ["database is locked"]
    finally:
        watching.close()


def test_a_commit_that_leaves_no_trace_on_the_file_is_seen(store: Store) -> None:
    """A log that is written again from its start keeps its size, and times of files are as coarse as the kernel's."""
    log = store.path.with_name(store.path.name + "-wal")
    store.add_event("note", {"told": "one"})
    with sqlite3.connect(store.path) as beside:
        beside.execute("PRAGMA wal_checkpoint(RESTART)")
    store.add_event("note", {"told": "two"})
    posted: list[Any] = []
    watching = feed.Feed(posted.append)
    watching.watch(store.path)
    watching.start()
    try:
        wait_for(lambda: posted)
        traces = [(each.stat().st_size, each.stat().st_mtime_ns) for each in (store.path, log)]
        with sqlite3.connect(store.path) as beside:
            beside.execute("PRAGMA wal_checkpoint(RESTART)")
        store.add_event("question", {"text": "Mount the package"})
        for each, (size, mtime_ns) in zip((store.path, log), traces, strict=True):
            assert each.stat().st_size == size
            os.utime(each, ns=(mtime_ns, mtime_ns))
        wait_for(lambda: posted[-1].view.events[-1].kind == "question")
    finally:
        watching.close()


def wait_for(condition: Callable[[], object], timeout_s: float = 30.0) -> None:
    import threading
    import time

    deadline_s = time.monotonic() + timeout_s
    tick = threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, "it did not happen"
        tick.wait(0.01)
