"""Every screen as it looks, at the smallest terminal and on a large one.

`RIGCTL_SNAPSHOTS=write` writes the pictures anew: look at them before they are committed.
"""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rigctl.campaign.store.entries import CERTIFIED
from rigctl.campaign.store.store import Store
from rigctl.console.widgets.bars import Standing, TopBar
from rigctl.console.widgets.plot import Plot

PICTURES = Path(__file__).parent / "pictures"
SIZES = ((80, 24), (120, 40), *([(200, 60)] if os.environ.get("RIGCTL_LARGE") else []))
DOTS_ON_AN_EDGE = 4
"""Of a few thousand; a line that is elsewhere changes hundreds."""


def picture(text: str) -> str:
    """What a screen shows without what differs from time to time."""
    text = re.sub(r"\d\d:\d\d:\d\d", "hh:mm:ss", text)
    text = re.sub(r" +(< )?\d+(\.\d)? (s|min)!?( +|$)", "  ---  ", text, flags=re.MULTILINE)
    text = re.sub(r"[▁▂▃▄▅▆▇█]+$", "", text, flags=re.MULTILINE)
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def differing_dots(seen: str, kept: str) -> int | None:
    """How many dots of plots differ; None when anything else does."""
    if len(seen) != len(kept):
        return None
    changed = [(ord(a), ord(b)) for a, b in zip(seen, kept, strict=True) if a != b]
    if any(not 0x2800 <= code <= 0x28FF for pair in changed for code in pair):
        return None
    return sum((a ^ b).bit_count() for a, b in changed)


@pytest.mark.timeout(300)  # a campaign, a result and a fit, on a computer that may be busy
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_screens_look_as_they_did(
    measured: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
) -> None:
    monkeypatch.chdir(measured.parent)
    seen: dict[str, str] = {}

    async def sitting(seat: Any) -> None:
        async def look(name: str, *words: str) -> None:
            for word in words:
                await seat.sees(word, 120.0)
            last = None
            # What lies under what was waited for may still have to be drawn.
            while last != (last := picture(seat.text)):
                await seat.pilot.pause(0.3)
            seen[name] = last

        seat.app.notify = lambda *_, **__: None
        await seat.until(lambda: seat.app._view)
        await seat.press("3")
        await look("results", "Sensing axes")
        await seat.press("full_stop", "full_stop")
        await look("results-scatter", "out of plane")
        await seat.press("1")
        await look("rig", "recorded", "required")
        await seat.press("2")
        await look("campaign", "DONE", "θ − θ0")
        await seat.press("4", "f")
        await look("workbench", "theta0[", "model version 1")
        await seat.press("5")
        await look("log", "done")
        await seat.press("2", "f1")
        await look("help", "EVERYWHERE", "F1 Help")

    at_console(sitting, Path(measured.name), size)
    width, height = size
    for name, text in seen.items():
        lines = text.splitlines()
        assert len(lines) <= height
        assert max(map(len, lines)) <= width
        path = PICTURES / f"{name}-{width}x{height}.txt"
        if os.environ.get("RIGCTL_SNAPSHOTS") == "write":
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        kept = path.read_text()
        # a dot half-way between two places falls by the last digit of a sum, which differs between processors
        assert text == kept or (differing_dots(text, kept) or 99) <= DOTS_ON_AN_EDGE, f"{name} looks different"


def test_pictures_are_compared_dot_by_dot() -> None:
    assert differing_dots("a\u28d2", "a\u28e2") == 2
    assert differing_dots("a\u28d2", "b\u28d2") is None
    assert differing_dots("a", "a\u28d2") is None


def test_a_terminal_that_is_too_small_says_so(at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.sees("This terminal has 60 x 20; the console needs 80 x 24.")
        assert "F8 still stops everything" in seat.text
        await seat.pilot.resize_terminal(80, 24)
        await seat.sees("1 Rig")

    at_console(sitting, None, (60, 20))


def test_what_is_known_is_written_under_a_name_that_nothing_has(
    measured: Path, tmp_path: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(measured, tmp_path / "night.rig.sqlite")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    written = {
        "report": ("night.html", "<!doctype html>"),
        "certificate": ("night-certificate.html", "<!doctype html>"),
        "bundle": ("night-bundle/recording.toml", 'experiment = "sensing-axis"'),
    }

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("3")
        for kind, (name, _) in written.items():
            await seat.press("w")
            await seat.sees("Write what?")
            await seat.type(kind)
            await seat.sees(f"Write the {kind}")
            proposal = seat.app.screen.query_one("Input").value
            seat.app.screen.query_one("Input").value = "taken"
            await seat.press("enter")
            await seat.sees("taken exists; give another name")
            seat.app.screen.query_one("Input").value = proposal
            await seat.press("enter")
            await seat.until(lambda path=tmp_path / Path(name).parts[0]: f"written: {path}" in seat.log, 90.0)

    at_console(sitting, tmp_path / "night.rig.sqlite")
    for name, inside in written.values():
        assert inside in (tmp_path / name).read_text(encoding="utf-8")[:4000]
    with Store.open(tmp_path / "night.rig.sqlite", readonly=True) as store:
        issued = [event.data["file"] for event in store.events(CERTIFIED)]
    assert issued == [str(tmp_path / "night-certificate.html")]


def test_every_action_of_the_palette_exists(at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        from rigctl.console.help import COMMANDS

        app = seat.app
        for action, _ in COMMANDS.values():
            pane = re.fullmatch(r"pane\('(\w+)', '(\w+)'.*\)", action)
            holder, name = (getattr(app._panes, pane[1]), pane[2]) if pane else (app, action.partition("(")[0])
            assert callable(getattr(holder, f"action_{name}")), action

    at_console(sitting)


def test_what_was_open_and_how_it_looked_is_there_at_the_next_start(measured: Path, at_console: Any) -> None:
    async def leaves(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.press("4", "t", "b", "q")

    async def returns(seat: Any) -> None:
        await seat.until(lambda: seat.app._view and seat.app._view.path == measured)
        assert "[4 Workbench]" in seat.text
        assert "bell off" in seat.text
        assert seat.app.theme == "rigctl-light"

    at_console(leaves, measured)
    at_console(returns)


def test_what_comes_while_the_log_is_not_shown_is_wrapped_to_the_width_it_is_then_seen_in(at_console: Any) -> None:
    said = "the whole of what somebody has typed into this console, on one line of the log"

    async def sitting(seat: Any) -> None:
        await seat.press("5")
        await seat.until(lambda: seat.app._panes.log.region.width)
        await seat.press("2")
        await seat.until(lambda: not seat.app._panes.log.region.width)
        seat.app._panes.log.add("2026-11-29T17:00:00Z", "note", said)
        await seat.press("5")
        await seat.sees(said)
        await seat.pilot.resize_terminal(90, 24)
        await seat.until(lambda: said not in seat.text and "the whole of what" in seat.text)
        await seat.pilot.resize_terminal(120, 40)
        await seat.sees(said)

    at_console(sitting, size=(120, 40))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("missing.rig.sqlite", None, "no such store"),
        ("text.rig.sqlite", "not a store", "not a campaign store"),
        ("wrong.toml", "[rig]\nname = 1\n[instruments]\n", "rig.name"),
        ("broken.toml", "[rig\n", "not TOML"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_as_any_command_does(
    desk: Any, name: str, content: str | None, told: str
) -> None:
    if content is not None:
        (desk.directory / name).write_text(content)
    desk.rigctl("console", name).refused(2, name, told)


def at(seat: Any, angle_deg: float) -> bool:
    rotation = seat.app._holding.bench.views()[0]
    return rotation.state == "ready" and abs(rotation.values[0].value - angle_deg) < 1e-3


def test_what_is_opened_is_shown(desk: Any, at_console: Any) -> None:
    campaign = desk.campaign()

    async def sitting(seat: Any) -> None:
        await seat.press("5")
        await seat.sees("[5 Log]")
        await seat.opens(campaign)
        await seat.sees("[2 Campaign]")
        await seat.sees("s starts, d tries")

    at_console(sitting)


def test_a_file_that_cannot_be_opened_leaves_the_campaign_that_is_watched_in_reach_of_stop(
    measured: Path, tmp_path: Path, at_console: Any
) -> None:
    text = tmp_path / "shopping-list"
    text.write_text("bread")

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        await seat.opens(text)
        await seat.sees("not a campaign store")
        assert "DONE 18/18" in seat.text.splitlines()[0]
        assert seat.app.kept.store == str(measured)
        view, signals = seat.app._view, []
        seat.app._view = replace(view, status={**view.status, "state": "interrupted", "killed": True})
        seat.app._campaigns.signal = lambda store, number: signals.append(store) is None
        seat.app._holding.stop_from_outside = lambda view: None
        await seat.press("f8")
        assert signals == [measured]

    at_console(sitting, measured)


def test_a_stop_while_another_store_is_looked_into_is_of_that_one_too(
    measured: Path, tmp_path: Path, at_console: Any
) -> None:
    another = tmp_path / "another.rig.sqlite"
    shutil.copy(measured, another)

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        stopped = []
        seat.app.action_stop = lambda stop=seat.app.action_stop: stopped.append(seat.app._view.path) or stop()
        seat.app._open(another)
        # In the same step of the event loop: a key takes time, in which the store may have been read.
        seat.app.action_stop()
        await seat.until(lambda: len(stopped) == 2)
        assert stopped == [measured, another]

    at_console(sitting, measured)


def test_a_rig_file_that_cannot_be_used_leaves_the_rig_that_is_held(desk: Any, at_console: Any) -> None:
    (desk.directory / "wrong.toml").write_text("[rig]\nname = 1\n[instruments]\n")

    async def sitting(seat: Any) -> None:
        await seat.sees("● ready")
        await seat.opens(desk.directory / "wrong.toml")
        # What is told under the screens leaves; the log keeps it.
        await seat.until(lambda: any("wrong.toml" in line.text for line in seat.app._panes.log._lines))
        assert "nothing is open" not in seat.text
        assert seat.app._holding.bench is not None

    at_console(sitting, desk.directory / "rig.toml")


def test_a_rig_that_is_given_free_shows_no_values_any_more(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.sees("● ready")
        seat.app.action_release()
        await seat.sees("No rig is open")
        assert "ready" not in seat.text

    at_console(sitting, desk.directory / "rig.toml")


def test_every_key_that_quits_asks_first(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "e", "x")
        await seat.until(lambda: seat.app._panes.campaign.unsaved)
        await seat.press("ctrl+q")
        await seat.sees("Quit the console?")
        await seat.press("n")
        assert seat.app.is_running

    at_console(sitting, desk.campaign())


def test_a_rig_that_is_given_free_leaves_its_screen_to_the_store(desk: Any, at_console: Any, measured: Path) -> None:
    async def sitting(seat: Any) -> None:
        await seat.sees("● ready")
        await seat.opens(measured)
        await seat.until(lambda: seat.app._view)
        await seat.press("1")
        await seat.sees("● ready")
        recorded = f"run {seat.app._view.run_id}, t / s"
        assert recorded not in seat.text
        seat.app.action_release()
        await seat.sees(recorded)
        await seat.sees("recorded")

    at_console(sitting, desk.directory / "rig.toml", size=(200, 60))


def test_charts_behind_a_dialog_are_drawn_seldom_and_at_once_when_it_is_left(
    desk: Any, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.console.screens.rig.BEHIND_S", 3600.0)

    async def sitting(seat: Any) -> None:
        def drawn() -> int:
            # No line before the first reading.
            return sum(len(line.x) for line in seat.app.query_one("#chart-accelerometer", Plot).picture.lines)

        await seat.sees("● ready")
        await seat.until(lambda: drawn() > 1)
        await seat.press("m")
        await seat.sees("limits -170 .. 170 deg")
        before, strip = drawn(), seat.app._holding.bench.strips()["voltage"]
        await seat.until(lambda: len(seat.app._holding.bench.strips()["voltage"].values) > len(strip.values) + 5)
        assert drawn() == before
        await seat.press("escape")
        await seat.until(lambda: drawn() > before)

    at_console(sitting, desk.directory / "rig.toml")


def test_a_jog_starts_where_the_stage_is_and_not_where_the_screen_last_saw_it(
    desk: Any, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def sitting(seat: Any) -> None:
        await seat.sees("● ready")
        await seat.until(lambda: at(seat, 0.0))
        monkeypatch.setattr("rigctl.console.station.POLL_S", 3600.0)
        stage = seat.app._holding.bench.stations["rotation"]
        await seat.press("m", *"170", "enter")
        await seat.until(lambda: stage.state == "ready" and abs(stage.instrument.angle().value - 170.0) < 1e-3)
        await seat.press("right_square_bracket")
        await seat.until(lambda: any("171 deg is outside" in line.text for line in seat.app._panes.log._lines))
        await seat.press("left_square_bracket")
        await seat.until(lambda: stage.state == "ready" and abs(stage.instrument.angle().value - 169.0) < 1e-3)

    at_console(sitting, desk.directory / "rig.toml")


def test_a_move_outside_the_limits_is_refused_where_it_is_typed(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.sees("● ready")
        await seat.press("m")
        await seat.sees("limits -170 .. 170 deg")
        await seat.press(*"171", "enter")
        await seat.sees("✗ 171 deg is outside -170 .. 170 deg")
        await seat.press("backspace", "0", "enter")
        await seat.until(lambda: at(seat, 170.0))
        await seat.sees("● ready")
        await seat.press("right_square_bracket")
        await seat.until(lambda: any("171 deg is outside" in line.text for line in seat.app._panes.log._lines))
        await seat.press("left_square_bracket")
        await seat.until(lambda: at(seat, 169.0))

    at_console(sitting, desk.directory / "rig.toml")


def test_what_is_open_and_how_it_stands_are_two_words_whatever_their_length(at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        bar = seat.app._base.query_one(TopBar)
        for length in range(30, 60):
            bar.watch_standing(Standing("n" * length, "INTERRUPTED 3/18", 2, True))
            shown = str(bar.query_one("#standing").render())
            assert " INTERRUPTED 3/18 ! 2 alarms" in shown, shown
            assert len(shown) <= 80 - 12

    at_console(sitting)
