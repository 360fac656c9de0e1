"""Keys: each lands where it was meant to, however fast they come, and Esc leaves whatever was begun."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from textual import events
from textual.widgets import Input

from rigctl.console import escape
from rigctl.console.escape import EscapeFirst


def types_ahead(seat: Any, *keys: str) -> None:
    """All at once, as a terminal that was typed ahead sends them: nothing waits for the screen in between."""
    for key in keys:
        name = {"/": "slash", ".": "full_stop"}.get(key, key)
        seat.app.post_message(events.Key(name, key if len(key) == 1 else None))


def test_keys_typed_ahead_go_to_the_screen_they_were_meant_for(measured: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        types_ahead(seat, "5", "/", *"run 3", "enter", "4", ".", ".")
        await seat.sees("[4 Workbench]")
        await seat.until(lambda: seat.app._panes.workbench.query_one("#workbench-tabs").active == "tab-ranking")
        assert seat.app._panes.log.search.words == "run 3"

    # "r", "u" and "3" are keys of screens as well.
    at_console(sitting, measured)


def test_a_start_typed_ahead_is_the_one_that_was_meant(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        types_ahead(seat, "2", "s", "tab", "tab", "tab", "tab", "space", "tab", "escape", "s")
        await seat.sees("Start a campaign")
        await seat.until(lambda: not seat.app._typed and seat.app._at is None)
        # The first dialog had the tick and was left; this one is as it came up.
        assert not seat.app.screen.query_one("#unattended").value
        types_ahead(seat, "tab", "tab", "tab", "tab", "space")
        await seat.until(lambda: seat.app.screen.query_one("#unattended").value)
        await seat.press("escape")

    at_console(sitting, desk.directory / "campaign.toml")


def test_esc_leaves_a_form_and_a_search_and_no_change_is_lost_and_u_takes_it_back(desk: Any, at_console: Any) -> None:
    (desk.directory / "x.toml").write_text("")

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "e")
        entry = seat.app.focused
        assert isinstance(entry, Input)
        before = entry.value
        await seat.press("end", "x", "y", "escape")
        assert entry.value == f"{before}xy"
        assert not isinstance(seat.app.focused, Input)
        await seat.press("q")
        await seat.sees("The changes in the form of")
        await seat.press("n", "ctrl+s")
        await seat.sees("Save the campaign")
        await seat.press("ctrl+u")
        await seat.type("x.toml")
        await seat.sees("exists; give another name")
        await seat.press("escape", "u")
        await seat.until(lambda: entry.value == before)
        await seat.press("5", "slash", "1", "escape", "1")
        await seat.sees("[1 Rig]")

    at_console(sitting, desk.directory / "campaign.toml")


def keys(parser: EscapeFirst, *data: str) -> list[str]:
    return [each.key for part in data for each in parser.feed(part) if isinstance(each, events.Key)]


@pytest.mark.parametrize(
    ("data", "read"),
    [
        (["\x1b5"], ["escape", "5"]),
        (["\x1b", "5"], ["escape", "5"]),
        (["x\x1b/a"], ["x", "escape", "slash", "a"]),
        (["\x1b[A"], ["up"]),
        (["\x1b", "[A"], ["up"]),
        (["\x1b\x1b[19~"], ["escape", "f8"]),
    ],
)
def test_esc_is_a_key_of_its_own_and_the_beginning_of_others(data: list[str], read: list[str]) -> None:
    assert keys(EscapeFirst(), *data) == read


def test_an_esc_that_nothing_follows_is_one_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [10.0]
    monkeypatch.setattr(escape, "monotonic", lambda: now_s[0])
    parser = EscapeFirst()
    assert keys(parser, "\x1b") == []
    assert list(parser.tick()) == []
    now_s[0] += 1.0
    assert [each.key for each in parser.tick() if isinstance(each, events.Key)] == ["escape"]
