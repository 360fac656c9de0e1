"""What an operator brings and takes along: a plug-in, what to measure next as a campaign, a report in a browser."""

from __future__ import annotations

import shutil
import stat
from pathlib import Path
from typing import Any

import pytest

from rigctl.console.campaigns import log_of
from rigctl.console.writing import look_at
from rigctl.files.campaign_file import read_campaign

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
SLOW_S = 90.0
LEAK = '''\
"""Some of the velocity is in the output."""

from rigctl.effects import effect


@effect("velocity-leak", on="sensor_output_v", parameters={"leak": "V s/m"}, typical={"leak": 1e-4})
def velocity_leak(run, leak):
    """The output has a part that goes with the velocity."""
    return leak * run.v
'''


@pytest.fixture
def store(measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store of one's own, with a plug-in beside it."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(measured, "here.rig.sqlite")
    shutil.copy(CAMPAIGNS / "one-axis.rig.toml", "one-axis.rig.toml")
    Path("leak.py").write_text(LEAK)
    return Path("here.rig.sqlite")


def test_an_effect_of_ones_own_is_opened_and_added(store: Path, at_console: Any) -> None:
    Path("wrong.py").write_text(LEAK.replace('"V s/m"', '"V s/furlong"'))

    async def sitting(seat: Any) -> None:
        bench, log = seat.app._panes.workbench, seat.app._panes.log
        await seat.until(lambda: bench._catalogue)
        await seat.opens("wrong.py")
        await seat.until(lambda: any("wrong.py" in line.text and line.kind == "alarm" for line in log._lines), SLOW_S)
        assert "velocity-leak" not in bench._catalogue
        await seat.opens("leak.py")
        await seat.until(lambda: "velocity-leak" in bench._catalogue, SLOW_S)
        await seat.press("4", "a")
        await seat.sees("Add which effect?")
        await seat.type("velocity-leak")
        await seat.until(lambda: "velocity-leak" in bench._effects, SLOW_S)
        # Fitted with it at once, as after every change of the model.
        await seat.sees("theta0[", SLOW_S)

    at_console(sitting, store)


def test_a_campaign_is_started_with_the_effects_that_were_opened(desk: Any, at_console: Any) -> None:
    (desk.directory / "leak.py").write_text(LEAK)
    path = desk.campaign(('"resonance"]', '"resonance", "velocity-leak"]'))

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.opens("leak.py")
        await seat.until(lambda: seat.app._analyses.plugins, SLOW_S)
        await seat.press("2", "s")
        await seat.sees("Start a campaign")
        await seat.press("tab", "tab", "tab", "tab", "space", "enter")
        await seat.sees("DONE 6/6", SLOW_S)

    at_console(sitting, path)
    assert "velocity-leak" not in log_of(desk.directory / "campaign.rig.sqlite").read_text()


@pytest.mark.timeout(300)
def test_what_to_measure_next_is_written_opened_and_started_into_the_same_store(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.workbench._catalogue)
        await seat.press("4", "w")
        await seat.sees("Write what?")
        await seat.type("campaign")
        await seat.sees("Write the campaign")
        await seat.press("enter")
        await seat.until(lambda: seat.app._panes.campaign.file == Path("here-next.toml"), 200.0)
        await seat.until(lambda: seat.app.kept.screen == "campaign")
        await seat.press("s")
        await seat.sees("Start a campaign")
        into = "here" if read_campaign(Path("here-next.toml")).goes_on else "here-next"
        assert seat.app.screen.query_one("#store").value == f"{into}.rig.sqlite"
        assert "✗" not in seat.text

    at_console(sitting, store)


def test_several_that_are_suggested_are_added_in_one_go(store: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bench = seat.app._panes.workbench
        await seat.until(lambda: bench._catalogue)
        bench._suggested = ["axis-tilt", "quadratic", *bench._effects]
        await seat.press("4", "a")
        await seat.sees("axis-tilt + quadratic")
        await seat.press("enter")
        await seat.until(lambda: {"axis-tilt", "quadratic"} <= set(bench._effects), SLOW_S)

    at_console(sitting, store)


def test_a_report_is_looked_at_in_a_browser_where_there_is_a_desktop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = tmp_path / "shown"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {shown}\n')
    browser.chmod(browser.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("BROWSER", str(browser))
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert look_at(tmp_path / "on a terminal.html") is None
    monkeypatch.setenv("DISPLAY", ":0")
    opening = look_at(tmp_path / "night.html")
    assert opening is not None
    assert opening.wait(60.0) == 0
    assert shown.read_text() == f"file://{tmp_path}/night.html\n"
