"""A campaign from the console: by keys alone, from its file to its result, in a process of its own."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from rigctl.campaign.store.store import Store


async def starts(seat: Any, *, unattended: bool) -> None:
    await seat.until(lambda: seat.app._panes.campaign.file)
    await seat.press("2", "s")
    await seat.sees("Start a campaign")
    if unattended:
        await seat.press("tab", "tab", "tab", "tab", "space")
    await seat.press("enter")


async def answers(seat: Any, words: str, answer: str = "done") -> None:
    # The dialog comes up when nobody has typed for a moment; the alarm strip says at once what is asked.
    await seat.until(lambda: "WAITS FOR YOU" in seat.text and words in seat.text)
    await seat.type(answer)
    await seat.until(lambda: words not in seat.text)


def test_a_whole_campaign_by_keys_alone(desk: Any, serve: Any, at_console: Any) -> None:
    """The rig is served on real ports; every remounting is asked for, and the result is there at the end."""
    serve(("seed = 2022", "seed = 2022\nremount_s = 1.0\nlevel_s = 1.0"), clock_speed=50.0)
    desk.campaign(('"rig.toml"', '"live.toml"'), ("noise_check_s = 20.0", "noise_check_s = 0.0"))

    async def sitting(seat: Any) -> None:
        await starts(seat, unattended=False)
        await answers(seat, "Mount the package for axis X in pendulum (mounting 1)")
        await answers(seat, "Level the package")
        await answers(seat, "Mount the package for axis X in flag (mounting 2)")
        await answers(seat, "Level the package")
        await seat.sees("DONE 6/6")
        await seat.press("3", "f")
        await seat.sees("Nulls")
        await seat.press("q")

    at_console(sitting, desk.directory / "campaign.toml")
    with Store.open(desk.directory / "campaign.rig.sqlite", readonly=True) as store:
        done = [event.data["action"] for event in store.events("operator")]
        assert len([action for action in done if action.startswith("answer 'done'")]) == 4
        assert len(store.events("answer")) == 4


def test_a_seed_that_is_no_whole_number_is_refused_as_it_was_typed(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "s")
        await seat.sees("Start a campaign")
        await seat.press("tab", "tab", "tab")
        for typed in ("-1.5e3", "-1", "1e99", "٣"):
            await seat.type(typed)
            await seat.sees(f"seed: '{typed}' is no whole number of 0 or more")
            assert "Start a campaign" in seat.text
            await seat.press(*["backspace"] * len(typed), "7")
            await seat.until(lambda: "seed: '" not in seat.text)
            await seat.press("backspace")

    at_console(sitting, desk.directory / "campaign.toml")
    assert not (desk.directory / "campaign.rig.sqlite").exists()


def test_a_question_is_answered_by_its_word_and_by_no_key_alone(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await starts(seat, unattended=False)
        await seat.sees("WAITS FOR YOU")
        await seat.press("enter", "space", "enter", "y", "enter")
        await seat.sees("is no answer; write done or abort")
        await seat.press("escape", "1")
        await seat.sees("! OPERATOR: Mount the package for axis X in pendulum")
        await seat.press("f9")
        await seat.sees("WAITS FOR YOU")
        assert seat.app._view.question is not None
        await seat.press(*["backspace"] * 5)
        await seat.type("abort")
        await seat.until(lambda: not seat.app._view.alive)
        assert seat.app._view.state == "aborted"

    at_console(sitting, desk.directory / "campaign.toml")


def test_a_campaign_goes_on_without_the_console_and_a_second_console_watches(desk: Any, at_console: Any) -> None:
    async def begin(seat: Any) -> None:
        await starts(seat, unattended=False)
        await seat.sees("WAITS FOR YOU")

    async def watch(seat: Any) -> None:
        await seat.sees("WAITS FOR YOU")
        assert desk.rigctl("answer", "campaign.rig.sqlite", "abort").status == 0
        await seat.until(lambda: not seat.app._view.alive)
        assert "WAITS" not in seat.text

    at_console(begin, desk.directory / "campaign.toml")
    at_console(watch, desk.directory / "campaign.rig.sqlite")


def test_pause_and_resume_reach_the_campaign(desk: Any, serve: Any, at_console: Any) -> None:
    serve(("seed = 2022", "seed = 2022\nremount_s = 1.0\nlevel_s = 1.0"), clock_speed=50.0)
    desk.campaign(  # so long that the keys come first, however slow the console is
        ('"rig.toml"', '"live.toml"'),
        ("noise_check_s = 20.0", "noise_check_s = 0.0"),
        ("mountings = 1", "mountings = 20"),
    )

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "d")
        await seat.sees("Nothing was moved")
        await starts(seat, unattended=True)
        await seat.sees("RUNNING")
        await seat.sees("S/(µm/s²/mm)")  # how it goes, not what the dry run said
        await seat.press("p")
        await seat.sees("PAUSED")
        await seat.press("r")
        await seat.sees("RUNNING")
        await seat.press("a")
        await seat.sees("Abort the campaign?")
        await seat.press("y")
        await seat.sees("ABORTED")

    at_console(sitting, desk.directory / "campaign.toml")


def test_a_lost_terminal_is_passed_on_and_told_at_the_next_start(desk: Any, at_console: Any) -> None:
    path = desk.directory / "campaign.toml"
    path.write_text('on_terminal_lost = "stop"\n' + path.read_text())

    async def loses(seat: Any) -> None:
        await starts(seat, unattended=False)
        await seat.sees("WAITS FOR YOU")
        signal.raise_signal(signal.SIGHUP)
        await seat.until(lambda: not seat.app.is_running or seat.app._exit)

    async def returns(seat: Any) -> None:
        await seat.press("5")
        await seat.sees("the campaign was stopped, as")
        await seat.until(lambda: seat.app._view and seat.app._view.state == "aborted")

    at_console(loses, path)
    at_console(returns, desk.directory / "campaign.rig.sqlite")


def test_the_form_refuses_while_one_types_and_saves_what_is_valid(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "e")
        await seat.sees("is valid")
        field = next(f for f in seat.app._panes.campaign.query("Input") if f.name == "procedure.amplitude_mm")
        field.focus()
        await seat.press("end", "backspace", "minus", "3")
        await seat.sees("✗ procedure.amplitude_mm: input should be greater than or equal to")
        assert field.has_class("wrong")
        await seat.press("home", "delete")
        await seat.sees("not saved: Ctrl+S")
        await seat.press("ctrl+s", "enter")
        await seat.until(lambda: "amplitude_mm = 3\n" in (desk.directory / "campaign.toml").read_text())

    at_console(sitting, Path("campaign.toml"))  # a long path would take another line


def test_a_dry_run_says_what_would_be_done_and_what_cannot(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "d")
        await seat.sees("6 runs in 2 mountings")
        await seat.sees("rig time ")
        desk.campaign(("amplitude_mm = 5.0", "amplitude_mm = 50.0"))
        await seat.press("d")
        await seat.sees("exceeds its travel")

    at_console(sitting, desk.directory / "campaign.toml")
