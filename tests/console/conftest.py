"""A console without a terminal, with somebody at its keys."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from textual.events import Paste
from textual.pilot import Pilot

from rigctl.console.app import Console

POLL_S = 0.05
"""Between two looks at the screen: each renders all of it, and what is waited for runs on the same cores."""


@dataclass
class Seat:
    """Somebody who presses keys and reads the screen."""

    app: Console
    pilot: Pilot[None]

    @property
    def text(self) -> str:
        """What the screen shows, line by line; a dialog alone while one is open."""
        strips = self.app.screen._compositor.render_strips()
        return "\n".join("".join(segment.text for segment in strip).rstrip() for strip in strips)

    @property
    def log(self) -> str:
        """What the console has noted: a note on the screen gives way to the next one."""
        return "\n".join(line.text for line in self.app._panes.log._lines)

    async def press(self, *keys: str) -> None:
        """Keys, one after the other."""
        await self.pilot.press(*keys)

    async def type(self, words: str) -> None:
        """Words, key by key, then Enter."""
        await self.pilot.press(*words, "enter")

    async def until(self, condition: Callable[[], object], timeout_s: float = 60.0) -> None:
        """Wait until something is so; the screen and the log are in the message when it does not come about."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, f"it did not happen:\n{self.text}\n{self.log}"
            await self.pilot.pause(POLL_S)

    async def sees(self, words: str, timeout_s: float = 60.0) -> None:
        """Wait until the screen shows these words."""
        await self.until(lambda: words in self.text, timeout_s)

    async def opens(self, path: Path | str) -> None:
        """Open a file by its name, pasted: each of a hundred keys would draw the screen."""
        await self.press("o")
        await self.sees("Open a rig file")
        self.app.post_message(Paste(str(path)))
        await self.press("enter")


Sitting = Callable[[Seat], Awaitable[None]]


@pytest.fixture
def at_console(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run a console as long as a sitting takes: `at_console(sitting, place, size=(80, 24))`."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def run(sitting: Sitting, place: Path | None = None, size: tuple[int, int] = (80, 24)) -> None:
        async def sit() -> None:
            app = Console(place)
            async with app.run_test(size=size) as pilot:
                seat = Seat(app, pilot)
                await seat.until(lambda: not app.keys_wait)
                await sitting(seat)

        asyncio.run(sit())

    return run


@dataclass(frozen=True)
class ServedRig:
    """A rig file that points at instruments another process serves, and that process."""

    path: Path
    process: Any


@pytest.fixture
def serve(desk: Any) -> Callable[..., ServedRig]:
    """Serve the shipped rig on real ports and pseudo-terminals, with changes."""

    def begin(*changes: tuple[str, str], clock_speed: float = 1.0) -> ServedRig:
        # A millisecond of this computer is `clock_speed` of them on the rig: when lasers start is known less well.
        patient = [(f"heads = {{ laser_{i}_mm", f"start_u_s = 0.1\nheads = {{ laser_{i}_mm") for i in (1, 3)]
        desk.rig(("clock_speed = 1.0", f"clock_speed = {clock_speed}"), *patient, *changes)
        process = desk.process("simulate", "rig.toml", "--write-rig", "live.toml")
        live = desk.directory / "live.toml"
        desk.until(live.exists, process)
        return ServedRig(live, process)

    return begin


@pytest.fixture(scope="session")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of the shipped one-axis campaign."""
    from rigctl import runner
    from rigctl.files.campaign_file import read_campaign
    from rigctl.files.rig_file import read_rig

    store = tmp_path_factory.mktemp("measured") / "one-axis.rig.sqlite"
    campaign = read_campaign(Path(__file__).parents[2] / "campaigns" / "one-axis.toml")
    runner.start(campaign, read_rig(campaign.rig_path), store, runner.Options(unattended=True))
    return store
