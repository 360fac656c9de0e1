"""How much longer, where runs take as long as they take."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.campaign.recording import Header
from rigctl.campaign.session import progress as module
from rigctl.campaign.session.progress import Progress
from rigctl.campaign.store.store import Store


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    at = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: at[0])
    return at


def test_what_is_left_is_reckoned_by_what_each_run_takes(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store, runs_before=7)
        progress.plan(3, [100.0, 50.0, 850.0])
        assert progress.status()["eta_s"] is None
        now[0] = 2.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(18.0)
        now[0] = 3.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(17.0)
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == 0.0


def test_a_campaign_that_is_killed_before_it_plans_anew_keeps_what_was_planned(
    tmp_path: Path, now: list[float]
) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        first = Progress(store)
        first.plan(48)
        first.state("running")
        resumed = Progress(store)
        resumed.state("running")
        assert store.status()["runs_planned"] == 48  # type: ignore[index]
        resumed.plan(40)
        assert resumed.status()["runs_planned"] == 40


def test_what_is_recorded_counts_from_the_start_of_a_resumed_campaign(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        for number in range(3):
            with store.begin_run(f"run {number}", "step", {}) as run:
                run.append({"t_s": [0.0, 1.0]})
                run.finish()
        progress = Progress(store)
        progress.plan(4)
        assert progress.status()["runs_done"] == 3
        progress.replayed(valid=True, runs=3)
        progress.ran(valid=True)
        assert progress.status()["runs_done"] == 4


def test_without_knowing_all_runs_take_the_same_and_replayed_ones_nothing(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.plan(4)
        progress.replayed(valid=True)
        now[0] = 6.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(12.0)


def test_one_mounting_of_half_an_hour_says_nothing_of_runs_of_seconds(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.plan(16, mountings=1)
        now[0] = 1800.0
        progress.mounted(replayed=False)
        progress.begins()
        now[0] += 5.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(15 * 5.0)


def test_mountings_to_come_take_what_those_that_were_made_took(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.plan(8, mountings=4)
        progress.mounted(replayed=True)
        progress.replayed(valid=True, runs=2)
        now[0] = 600.0
        progress.mounted(replayed=False)
        progress.begins()
        now[0] += 10.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(2 * 600.0 + 5 * 10.0)


def test_a_pause_is_no_time_that_runs_or_mountings_take(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.plan(3, mountings=2)
        now[0] = 100.0
        progress.mounted(replayed=False)
        progress.begins()
        progress.state("paused")
        now[0] += 3600.0
        assert progress.status()["eta_s"] is None
        progress.state("running")
        now[0] += 10.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(100.0 + 2 * 10.0)
        progress.state("paused")
        now[0] += 3600.0
        assert progress.status()["eta_s"] == pytest.approx(100.0 + 2 * 10.0)


def test_what_is_planned_and_the_step_are_written_before_anybody_is_waited_for(
    tmp_path: Path, now: list[float]
) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.state("running")
        progress.plan(16)
        progress.at("scan X flag 1")
        assert (store.status()["runs_planned"], store.status()["step"]) == (16, "scan X flag 1")
        progress.told("scan X flag 1 / period 1 of 9000")
        assert store.status()["step"] == "scan X flag 1"
