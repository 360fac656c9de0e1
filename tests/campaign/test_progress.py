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


def test_without_knowing_all_runs_take_the_same_and_replayed_ones_nothing(tmp_path: Path, now: list[float]) -> None:
    with Store.create(tmp_path / "x", Header("table")) as store:
        progress = Progress(store)
        progress.plan(4)
        progress.replayed(valid=True)
        now[0] = 6.0
        progress.ran(valid=True)
        assert progress.status()["eta_s"] == pytest.approx(12.0)
