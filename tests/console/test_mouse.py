"""Everything by mouse as well: tabs, STOP, what the campaign asks, rows, entries."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def told(seat: Any, words: str) -> bool:
    return any(words in line.text for line in seat.app._panes.log._lines)


def test_screens_and_their_tabs_are_clicked(measured: Path, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._view)
        for name, shown in (("log", "[5 Log]"), ("results", "[3 Results]"), ("workbench", "[4 Workbench]")):
            await seat.pilot.click(f"#tab-{name}")
            await seat.sees(shown)
        await seat.pilot.click("#workbench-tabs Names", offset=(30, 0))  # Model, Residuals, Ranking, Ladder
        await seat.until(lambda: seat.app._panes.workbench.query_one("#workbench-tabs").active == "tab-ladder")

    at_console(sitting, measured)


def test_stop_is_clicked_while_a_stage_moves(serve: Any, at_console: Any) -> None:
    rig = serve()

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._holding.bench)
        # Drawn, and not only known: a click goes where the lines are by then.
        await seat.until(lambda: seat.text.count("● ready") == len(seat.app._holding.bench.views()))
        await seat.pilot.click("#instruments", offset=(3, 2))
        await seat.sees("stage: linear")
        await seat.pilot.click("#instruments", offset=(3, 1))
        await seat.sees("rotation: rotation")
        await seat.press("m")
        await seat.sees("Move rotation")
        await seat.type("150")
        await seat.sees("▶ moving")
        await seat.pilot.click("#stop")
        await seat.until(lambda: told(seat, "rotation: confirmed at rest ("))
        view = seat.app._holding.bench.views()[0]
        assert view.values[0].value < 149.0, "it arrived: nothing was stopped"

    at_console(sitting, rig.path)


def test_a_start_is_ticked_and_a_question_is_reached_by_its_line(desk: Any, at_console: Any) -> None:
    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "s")
        await seat.sees("Start a campaign")
        tick = seat.app.screen.query_one("#unattended")
        await seat.pilot.click("#unattended")
        await seat.until(lambda: tick.value)
        await seat.pilot.click("#unattended")
        await seat.until(lambda: not tick.value)
        await seat.press("enter")
        await seat.sees("WAITS FOR YOU")
        await seat.press("escape")
        await seat.sees("! OPERATOR: Mount the package")
        await seat.pilot.click("AlarmStrip")
        await seat.sees("WAITS FOR YOU")
        await seat.type("abort")
        await seat.until(lambda: not seat.app._view.alive)

    at_console(sitting, desk.directory / "campaign.toml")


def test_the_start_begins_where_something_has_to_be_changed(desk: Any, at_console: Any) -> None:
    desk.campaign(('rig = "rig.toml"\n', ""))

    async def sitting(seat: Any) -> None:
        await seat.until(lambda: seat.app._panes.campaign.file)
        await seat.press("2", "s")
        await seat.sees("✗ the campaign file names no rig; name one here")
        assert seat.app.screen.focused.id == "rig"
        await seat.press(*"rig.toml")
        await seat.until(lambda: "names no rig" not in seat.text)
        await seat.press("escape")
        desk.campaign()
        await seat.opens(desk.directory / "campaign.toml")
        await seat.sees("s starts, d tries")
        await seat.press("s")
        await seat.sees("Start a campaign")
        assert seat.app.screen.focused.id == "campaign"

    at_console(sitting, desk.directory / "campaign.toml")
