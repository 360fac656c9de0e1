"""Results and workbench by keys: comparison, residuals against a covariate, what to measure next, model versions."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.store.store import Store
from rigctl.console import analysis

SLOW_S = 120.0


@pytest.fixture
def store(measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store of one's own, with another to compare it with."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(measured, "here.rig.sqlite")
    shutil.copy(measured, "there.rig.sqlite")
    return Path("here.rig.sqlite")


@pytest.mark.timeout(300)
def test_residuals_next_and_the_ladder(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bench = seat.app._panes.workbench
        await seat.until(lambda: bench._catalogue)
        await seat.press("4", "f")
        await seat.sees("theta0[", SLOW_S)
        await seat.until(lambda: bench._covariates, SLOW_S)
        await seat.until(lambda: bench.covariate == "frequency_hz", SLOW_S)
        await seat.press("v")
        await seat.sees("Residuals against what?")
        await seat.press(*"start", "enter")
        await seat.until(lambda: "frequency" not in bench.query_one("#residuals").picture.x_label, SLOW_S)
        assert bench.covariate == "start_s"
        await seat.press("n")
        assert bench.query_one("#workbench-tabs").active == "tab-next"
        await seat.sees("recommend of here.rig.sqlite, ", SLOW_S)
        await seat.until(lambda: "asks what to measure next" not in seat.text, SLOW_S)
        await seat.press("a")
        await seat.sees("Add which effect?")
        await seat.press(*"axis-tilt", "enter")
        await seat.until(lambda: len(bench._effects) == 3, SLOW_S)
        await seat.sees("model version 2: baseline + roll-gravity + resonance + ", SLOW_S)
        await seat.press("x")
        await seat.sees("Remove which effect?")
        await seat.press("escape")

    at_console(sitting, store)
    assert [each["version"] for each in analysis.history(store, ())] == [1, 2]


@pytest.mark.timeout(300)
def test_the_runs_of_two_stores_are_compared(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("3", "v")
        await seat.sees("Compare with which store?")
        await seat.type("there.rig.sqlite")
        await seat.sees("with there.rig.sqlite", SLOW_S)
        # The heading of a narrow column has two lines.
        await seat.sees("sigmas")
        await seat.sees("apart")

    at_console(sitting, store)


def test_a_failure_of_an_analysis_is_one_line(store: Path, at_console: Any, tmp_path: Path) -> None:
    (tmp_path / "broken.rig.sqlite").write_text("nothing")

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("3", "v")
        await seat.type("broken.rig.sqlite")
        await seat.until(lambda: [line for line in seat.app._panes.log._lines if "broken.rig.sqlite" in line.text])
        line = next(line for line in seat.app._panes.log._lines if "broken.rig.sqlite" in line.text)
        assert line.kind == "alarm"
        assert "Traceback" not in line.text

    at_console(sitting, store)


def test_a_rig_that_cannot_be_opened_is_one_line_whatever_went_wrong(
    desk: Any, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError("an error of ours")

    monkeypatch.setattr("rigctl.console.bench.open_bench", fails)

    async def sitting(seat: Any) -> None:
        await seat.press("5")
        await seat.sees("internal error: ZeroDivisionError: an error of ours")
        await seat.press("1")
        await seat.sees("No rig is open")

    at_console(sitting, desk.directory / "rig.toml")


@pytest.mark.timeout(300)
def test_a_run_is_left_out_and_taken_back_from_the_steps(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bench, progress = seat.app._panes.workbench, seat.app._panes.campaign._progress
        await seat.until(lambda: seat.app._view)
        # The last mounting opened, its last run.
        await seat.press("2", "end", "enter", "end")
        await seat.until(lambda: progress.chosen is not None)
        run_id = progress.chosen.run_id
        await seat.press("m")
        await seat.sees(f"Run {run_id}: leave it out")
        await seat.press("enter")
        await seat.sees("a mark needs its reason")
        await seat.type("a door slammed")
        await seat.sees(f"run {run_id} is invalid: a door slammed", SLOW_S)
        await seat.sees(f"✗ {run_id}")
        assert progress.chosen.run_id == run_id
        # Refitted without it, and the ladder is there.
        await seat.until(lambda: bench._covariates, SLOW_S)
        await seat.press("m")
        await seat.sees("left out: a door slammed; why is it good?")
        await seat.press("escape", "u")
        await seat.sees(f"run {run_id} is valid: mark of run {run_id} taken back", SLOW_S)
        await seat.until(lambda: progress.chosen.valid)

    at_console(sitting, store)
    with Store.open(store, readonly=True) as opened:
        assert next(event.data["reason"] for event in opened.events("mark")) == "a door slammed"
        assert all(run.valid for run in opened.runs())


def test_without_a_run_chosen_a_mark_says_how_to_choose(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("2", "home", "m")
        await seat.sees("choose a run among the steps first")

    at_console(sitting, store)
