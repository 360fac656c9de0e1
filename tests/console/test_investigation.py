"""An investigation from the console: it goes on by itself, asks before it adds, and STOP ends it at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.store.store import Store
from rigctl.console.campaigns import Campaigns
from rigctl.workbench.model import versions
from tests.console.test_campaign import answers
from tests.test_cli_planning import HYSTERESIS, SCAN, rig

SLOW_S = 180.0
ADDING = "Add cable-hysteresis to the model?"


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A campaign among whose runs an investigation can choose, on a rig with a dragging cable."""
    monkeypatch.chdir(tmp_path)
    rig(tmp_path, HYSTERESIS)
    (tmp_path / "campaign.toml").write_text(SCAN)
    return tmp_path / "campaign.rig.sqlite"


async def starts(seat: Any) -> None:
    await seat.until(lambda: seat.app._panes.campaign.file)
    await seat.press("2", "s")
    await seat.sees("Start a campaign")
    await seat.press("tab", "tab", "tab", "tab", "tab", "space", "enter")
    await answers(seat, "Mount the package for axis X in flag")
    await answers(seat, "Level the package")
    await seat.until(lambda: "WAITS FOR YOU" in seat.text and ADDING in seat.text, SLOW_S)


@pytest.mark.timeout(600)
def test_what_it_finds_is_added_when_the_operator_agrees_and_not_otherwise(begun: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await starts(seat)
        store = seat.app._view.path
        assert seat.app._campaigns.investigates(store)
        await seat.type("no")
        await seat.until(lambda: not seat.app._campaigns.investigates(store), SLOW_S)

    at_console(sitting, begun.parent / "campaign.toml")
    with Store.open(begun, readonly=True) as store:
        assert versions.current(store).effects == ("roll-gravity", "resonance")
        assert [event.data["answer"] for event in store.events("answer")] == ["done", "done", "no"]
        assert len(store.runs()) == 12
    assert "cable-hysteresis" in begun.with_name(f"{begun.name}.log").read_text()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("keys", [("f8",), ("escape", "a", "y")], ids=["STOP", "abort"])
def test_it_is_ended_while_it_asks(begun: Path, at_console: Any, keys: tuple[str, ...]) -> None:
    async def sitting(seat: Any) -> None:
        await starts(seat)
        await seat.press(*keys)
        await seat.until(lambda: not seat.app._campaigns.investigates(seat.app._view.path))
        await seat.until(lambda: not seat.app._view.alive)

    at_console(sitting, begun.parent / "campaign.toml")
    with Store.open(begun, readonly=True) as store:
        assert versions.current(store).effects == ("roll-gravity", "resonance")
        assert len(store.runs()) == 12


def test_what_cannot_be_investigated_is_refused_before_anything_begins(begun: Path, at_console: Any) -> None:
    path = begun.parent / "campaign.toml"
    path.write_text(SCAN.replace('configurations = ["flag"]', 'configurations = ["flag", "pendulum"]'))

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "s")
        await seat.sees("Start a campaign")
        await seat.press("tab", "tab", "tab", "tab", "tab", "space")
        await seat.sees("one mounting")
        await seat.press("enter")
        await seat.sees("Start a campaign")
        await seat.press("space", "enter")
        await seat.sees("WAITS FOR YOU")
        await seat.type("abort")

    at_console(sitting, path)
    assert begun.exists()


def test_its_most_runs_are_said_and_what_it_does_not_take_is_refused(
    begun: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    spawned: list[list[str]] = []
    monkeypatch.setattr(Campaigns, "_spawn", lambda _, __, arguments: spawned.append(arguments))

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "s")
        await seat.sees("Start a campaign")
        await seat.press("tab", "tab", "tab", "7", "tab", "tab", "space")
        await seat.sees("an investigation has the campaign file's seed; leave this empty")
        await seat.press("shift+tab", "shift+tab", "backspace", "tab", "tab", "tab", "0")
        await seat.sees("at least one run")
        await seat.press("backspace", "9", "shift+tab", "space")
        await seat.sees("only an investigation has a most; tick it, or leave this empty")
        await seat.press("space", "enter")
        await seat.until(lambda: spawned)

    at_console(sitting, begun.parent / "campaign.toml")
    campaign = str(begun.with_name("campaign.toml"))
    assert spawned == [["investigate", campaign, "--store", begun.name, "--max-runs", "9"]]
