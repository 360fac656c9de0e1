"""A campaign file of any experiment as a form: what it says is shown, what is changed alone is changed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from rigctl.console import form
from rigctl.console.entries import Entry, Listing

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
SHIPPED = [
    path for path in sorted(CAMPAIGNS.glob("*.toml")) if "experiment" in tomllib.loads(path.read_text("utf-8"))
]
PLATFORM = CAMPAIGNS / "bias-rejection.toml"


def entry(text: str, name: str) -> Entry:
    return next(each for each in form.entries(text) if isinstance(each, Entry) and each.name == name)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_campaign_opens_and_is_valid(path: Path) -> None:
    text = path.read_text("utf-8")
    said = tomllib.loads(text)
    shown = {(each.table, each.key) for each in form.entries(text)}
    assert form.CampaignForm(path, text).fault() == ""
    assert {("procedure", key) for key in said["procedure"]} <= shown
    assert {("targets", key) for key in said.get("targets", {})} <= shown


def test_a_list_of_runs_is_shown_and_kept_when_a_key_beside_it_changes() -> None:
    text = PLATFORM.read_text("utf-8")
    runs = next(each for each in form.entries(text) if isinstance(each, Listing))
    assert (runs.table, runs.key, runs.rows[0]) == ("procedure", "runs", "pattern flip  duration_s 60")
    changed = form.changed(text, entry(text, "procedure.rejects"), "quadratic")
    changed = form.changed(changed, entry(changed, "procedure.turning"), "forward")
    said, before = tomllib.loads(changed), tomllib.loads(text)
    assert said["procedure"].pop("turning") == "forward"
    assert said["procedure"].pop("rejects") == "quadratic"
    assert before["procedure"].pop("rejects") == "linear"
    assert said == before


def test_what_an_experiment_does_not_allow_is_a_fault_of_its_own_table() -> None:
    text = PLATFORM.read_text("utf-8")
    wrong = form.changed(text, entry(text, "procedure.rejects"), "everything")
    assert form.CampaignForm(PLATFORM, wrong).fault().startswith("procedure.rejects: input should be 'nothing'")


def test_a_hint_says_what_may_be_written() -> None:
    text = PLATFORM.read_text("utf-8")
    assert entry(text, "procedure.name").hint == "required: bias-rejection"
    assert entry(text, "procedure.settle_s").hint == "10 if left out"
    assert entry(text, "procedure.rotation_s").hint == "may be left out"
    assert entry(text, "procedure.turning").hint == "back-and-forth if left out: back-and-forth | forward"


def test_another_experiment_s_campaign_is_edited_on_the_screen(
    tmp_path: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bias.toml"
    path.write_text(PLATFORM.read_text("utf-8"), "utf-8")

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "e")
        await seat.sees("✓ bias.toml is valid")
        field = next(each for each in seat.app._panes.campaign.query("Input") if each.name == "procedure.guard_s")
        field.focus()
        await seat.press("minus", "1")
        await seat.sees("✗ procedure.guard_s: input should be greater than or equal to 0")
        await seat.press("home", "delete")
        await seat.sees("not saved: Ctrl+S")
        await seat.press("ctrl+s", "enter")
        await seat.until(lambda: "guard_s = 1\n" in path.read_text("utf-8"))
        await seat.press(*["tab"] * 5)
        await seat.sees("  1  pattern flip  duration_s 60")

    at_console(sitting, Path("bias.toml"))
    assert len(tomllib.loads(path.read_text("utf-8"))["procedure"]["runs"]) == 16
