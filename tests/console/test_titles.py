"""The list from which files are opened: what was opened before, then what is near, each with its title."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.console.state import ConsoleState, load, save
from rigctl.console.titles import MOST, openable, title_of, with_opened

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


def test_campaigns_and_rigs_have_their_titles() -> None:
    assert title_of(CAMPAIGNS / "one-axis.toml").startswith("One-axis accelerometer: pendulum and flag")
    assert title_of(CAMPAIGNS / "one-axis.rig.toml") == "one-axis accelerometer (simulated)"


@pytest.mark.parametrize("text", ["title = 3", "title = [", "rig = 'x.toml'", "[rig]", "\udcff"])
def test_what_has_no_title_is_listed_without_one(tmp_path: Path, text: str) -> None:
    (tmp_path / "odd.toml").write_bytes(text.encode(errors="surrogateescape"))
    assert openable({}, tmp_path) == [("odd.toml", "")]


def test_what_a_simulated_world_hides_is_not_offered(tmp_path: Path) -> None:
    for name in ("a.rig.sqlite", "a.rig.sqlite.truth.toml", "b.toml"):
        (tmp_path / name).touch()
    assert [name for name, _ in openable({}, tmp_path)] == ["a.rig.sqlite", "b.toml"]


@given(st.lists(st.integers(0, 20), max_size=40))
def test_the_last_that_was_opened_is_first_and_none_is_twice(numbers: list[int]) -> None:
    recent: dict[str, str] = {}
    for number in numbers:
        recent = with_opened(recent, Path(f"/stores/{number}"), f"title {number}")
    last_first = list(dict.fromkeys(f"/stores/{number}" for number in reversed(numbers)))
    assert list(recent) == last_first[:MOST]


def test_what_was_opened_is_offered_after_a_restart(
    at_console: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    async def open_it(seat: Any) -> None:
        await seat.opens(CAMPAIGNS / "one-axis.toml")
        await seat.sees("one-axis.toml", 90.0)
        await seat.until(lambda: seat.app.kept.screen == "campaign")

    async def look(seat: Any) -> None:
        await seat.press("o")
        await seat.sees("One-axis accelerometer: pendulum and flag")

    at_console(open_it, size=(160, 40))
    at_console(look, size=(160, 40))


def test_a_list_that_was_edited_by_hand_is_no_reason_to_fail(tmp_path: Path) -> None:
    save(tmp_path, ConsoleState(screen="log", recent={"/a": "one"}))
    assert load(tmp_path).recent == {"/a": "one"}
    (tmp_path / "console.json").write_text('{"screen": "log", "recent": {"/a": 3}}')
    assert load(tmp_path) == ConsoleState(screen="log")
