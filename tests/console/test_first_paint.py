"""The frame is painted before what the screens are made of is imported; what is typed meanwhile waits for them."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest
from textual import events

from rigctl.console.app import Console

HEAVY = {"numpy", "scipy", "pydantic", "sqlite3", "matplotlib", "multiprocessing", "tomllib"}
FIRST_PAINT = """
import sys
from pathlib import Path
import rigctl.cli
from rigctl.console.app import Console

furnish, drawn, imported, afterwards = Console.furnish, [], [], []

async def furnish_and_look(app):
    strips = app.screen._compositor.render_strips()
    drawn.extend("".join(segment.text for segment in strip) for strip in strips)
    imported.extend(sys.modules)
    await furnish(app)
    afterwards.extend(sys.modules)
    app.exit()

Console.furnish = furnish_and_look
Console(None, directory=Path(sys.argv[1])).run(headless=True, size=(80, 24))
print(drawn[0], drawn[1], sep="\\n")
print(*imported)
print(*afterwards)
"""


def test_the_frame_with_its_stop_is_painted_before_anything_heavy_is_imported(tmp_path: Path) -> None:
    call = [sys.executable, "-c", FIRST_PAINT, str(tmp_path)]
    top, tabs, imported, afterwards = subprocess.run(
        call, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert "STOP F8" in top
    assert "5 Log" in tabs
    before = imported.split()
    assert not HEAVY & set(before)
    assert not [name for name in before if name.startswith("rigctl.console.screens")]
    # Nor do the screens need arithmetic while there are no numbers.
    assert "rigctl.console.screens.panes" in afterwards.split()
    assert not {"numpy", "scipy", "pydantic"} & set(afterwards.split())


def test_what_is_typed_before_the_screens_are_there_waits_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    furnish = Console.furnish

    async def slowly(app: Console) -> None:
        await typed.wait()
        await furnish(app)

    async def sit() -> tuple[str, list[str]]:
        app = Console(None, directory=tmp_path)
        async with app.run_test(size=(80, 24)) as pilot:
            for key in ("5", "f8", "4", "f"):
                app.post_message(events.Key(key, key if len(key) == 1 else None))
            await pilot.pause()
            assert app.keys_wait
            typed.set()
            while app._typed or app._at is not None or app.keys_wait:
                await pilot.pause()
            return app.kept.screen, [line.text for line in app._panes.log._lines]

    typed = asyncio.Event()
    monkeypatch.setattr(Console, "furnish", slowly)
    screen, told = asyncio.run(sit())
    # STOP drops what was typed before it.
    assert screen == "workbench"
    assert told[:2] == ["STOP", "STOP: no rig is held here, and no campaign runs"]
    assert told[-1] == "open a store first: o"
