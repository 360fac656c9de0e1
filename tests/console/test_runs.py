"""From a step of the ladder to the residuals, from one of these to its run, and back by leaving the run out."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.campaign.bundle.bundle import import_bundle
from rigctl.campaign.store.store import Store
from rigctl.composition import opened_workbench
from rigctl.console.screens.campaign_progress import ProgressPage
from rigctl.console.widgets.pages import Page
from rigctl.core.errors import DataError
from rigctl.report.recorded_run import extremes, recorded_run

SLOW_S = 90.0
ROOT = Path(__file__).parents[2]
FOREIGN = ROOT / "tests" / "foreign" / "data"


@pytest.fixture
def store(measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store of one's own."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(measured, "here.rig.sqlite")
    return Path("here.rig.sqlite")


def test_from_the_ladder_to_a_run_and_back(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bench = seat.app._panes.workbench
        await seat.until(lambda: bench._catalogue)
        await seat.press("4", "f")
        await seat.until(lambda: seat.app.query_one("#ladder-plot").picture.lines, SLOW_S)
        await seat.press("full_stop", "full_stop", "full_stop")
        await seat.sees("error / noise")
        await seat.press("home", "enter")
        await seat.sees("residuals / σ, version 1", SLOW_S)
        # The run that lies farthest above the model.
        await seat.press("pageup")
        plot = seat.app.query_one("#residuals")
        highest = max(
            (float(y), label) for line in plot.picture.lines for y, label in zip(line.y, line.labels, strict=True)
        )
        await seat.press("enter")
        await seat.until(lambda: bench._run is not None and bench._run.run_id == highest[1], SLOW_S)
        await seat.sees("accel_v / V")
        assert seat.app.query_one("#workbench-tabs").active == "tab-run"
        await seat.press("m")
        await seat.sees(f"Run {highest[1]}: leave it out")
        await seat.type("bumped")
        await seat.until(lambda: not bench._run.valid, SLOW_S)
        await seat.sees("left out: bumped")
        await seat.press("u")
        await seat.until(lambda: bench._run.valid, SLOW_S)

    at_console(sitting, store, (120, 40))
    with Store.open(store, readonly=True) as kept:
        assert all(run.valid for run in kept.runs())


def test_enter_on_a_run_among_the_steps_shows_it(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bench = seat.app._panes.workbench
        await seat.until(lambda: seat.app._view is not None and seat.app._view.runs)
        await seat.press("2", "home", "enter", "down", "enter", "down")
        await seat.until(lambda: seat.app._panes.campaign._progress.chosen is not None)
        run_id = seat.app._panes.campaign._progress.chosen.run_id
        await seat.press("enter")
        await seat.until(lambda: bench._run is not None and bench._run.run_id == run_id, SLOW_S)
        assert seat.app.kept.screen == "workbench"

    at_console(sitting, store)


def test_a_recorded_run_has_its_channels_by_kind_and_its_spectrum(store: Path) -> None:
    with opened_workbench(store, (), readonly=True) as workbench:
        record = workbench.store.runs()[3]
        shown = recorded_run(workbench, record.run_id)
        samples = workbench.store.samples(record.run_id)
        with pytest.raises(DataError, match="no run 9999"):
            recorded_run(workbench, "9999")
    titles = {picture.title: picture for picture in shown.pictures}
    lasers = next(picture for title, picture in titles.items() if title.startswith("displacement"))
    assert {line.name for line in lasers.lines} <= set(samples)
    sensor = next(picture for title, picture in titles.items() if "√Hz" in title)
    assert (sensor.x_scale, sensor.y_scale) == ("log", "log")
    # The drive's line is where it was asked for.
    line = sensor.lines[0]
    spacing_hz = float(line.x[1] - line.x[0])
    assert line.x[int(np.argmax(line.y))] == pytest.approx(record.conditions["frequency_hz"], abs=1.5 * spacing_hz)
    assert f"frequency_hz {record.conditions['frequency_hz']:.6g}" in shown.facts


def test_a_row_of_a_table_is_told_by_its_columns_and_cannot_be_marked(tmp_path: Path) -> None:
    import_bundle(FOREIGN / "hd-164922", tmp_path / "hd.rig.sqlite").close()
    with opened_workbench(tmp_path / "hd.rig.sqlite", (), readonly=True) as workbench:
        shown = recorded_run(workbench, "row 1")
        samples = workbench.store.samples("readings")
    assert not shown.can_be_marked
    assert not shown.pictures
    assert f"velocity_m_s {samples['velocity_m_s'][0]:.6g} m/s" in shown.facts


@given(st.integers(1, 400), st.integers(1, 20), st.randoms(use_true_random=False))
def test_what_is_drawn_of_a_long_run_keeps_every_peak(count: int, stretches: int, random: Any) -> None:
    y = np.array([random.choice([random.gauss(0.0, 1.0), np.nan]) for _ in range(count)])
    x = np.arange(float(count))
    shown_x, shown_y = extremes(x, y, stretches)
    assert len(shown_y) <= max(2 * stretches, count if count <= 2 * stretches else 0)
    assert np.all(np.diff(shown_x) >= 0.0)
    # Each value is one of the run's, at its own time.
    assert np.array_equal(shown_y, y[shown_x.astype(int)], equal_nan=True)
    if np.isfinite(y).any():
        assert np.nanmax(shown_y) == np.nanmax(y)
        assert np.nanmin(shown_y) == np.nanmin(y)


@pytest.mark.parametrize(("asked", "shown_on"), [("watched", "tab-progress"), ("dry_run", "tab-dry")])
def test_what_is_found_while_the_console_leaves_is_not_shown(
    asked: str, shown_on: str, store: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    late: list[str] = []

    async def sitting(seat: Any) -> None:
        leaving, analyst = asyncio.Event(), seat.app._analyses._analyst
        ask = analyst.ask

        async def ask_late(what: str, *arguments: Any, **options: Any) -> Any:
            answer = await ask(what, *arguments, **options)
            if what == asked:
                late.append(what)
                await leaving.wait()
            return answer

        monkeypatch.setattr(analyst, "ask", ask_late)
        # A page goes after all that is on it.
        gone = {"tab-progress": ProgressPage, "tab-dry": Page}[shown_on]
        monkeypatch.setattr(gone, "on_unmount", lambda page: page.id == shown_on and leaving.set(), raising=False)
        await seat.opens(store)
        await seat.opens(ROOT / "campaigns" / "one-axis.toml")
        await seat.press("2", "d")
        await seat.until(lambda: late)

    at_console(sitting)
    assert late
