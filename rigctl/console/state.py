"""What the console keeps across restarts: what was open and shown, and every action of the operator."""

from __future__ import annotations

import json
import tempfile
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import platformdirs

from rigctl.console.widgets.bars import SCREENS
from rigctl.core.clock import utc_now

ACTIONS = "actions.jsonl"


@dataclass
class ConsoleState:
    """Settings, and what was open."""

    screen: str = "rig"
    theme: str = "rigctl-dark"
    bell: bool = True
    rig: str = ""
    campaign: str = ""
    store: str = ""
    covariate: str = ""
    jog_step: float = 1.0
    recent: dict[str, str] = field(default_factory=dict)
    """Files that were opened, the last first, each with its title."""
    notice: str = ""
    """What the operator could not be told when the terminal was lost; shown at the next start."""


def state_directory() -> Path:
    """Where this user's console keeps its files."""
    return platformdirs.user_state_path("rigctl")


def load(directory: Path) -> ConsoleState:
    """The state as it was left; defaults for what cannot be read of it."""
    try:
        kept = dict(json.loads((directory / "console.json").read_text(encoding="utf-8")))
    except (OSError, TypeError, ValueError):
        return ConsoleState()
    untouched = ConsoleState()
    usable = {
        # A file of another version, or edited by hand, must not end the console.
        each.name: kept[each.name]
        for each in fields(ConsoleState)
        if type(kept.get(each.name)) is type(getattr(untouched, each.name))
    }
    state = ConsoleState(**usable)
    if not all(isinstance(title, str) for title in state.recent.values()):
        state.recent = {}
    return state if state.screen in SCREENS else ConsoleState()


def save(directory: Path, state: ConsoleState) -> None:
    """Keep the state, whole or not at all; a directory that cannot be written is no reason to fail."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        # Another console may save at the same time: whole files take turns.
        with tempfile.NamedTemporaryFile("w", dir=directory, delete=False, encoding="utf-8") as file:
            json.dump(asdict(state), file, indent=1)
        Path(file.name).replace(directory / "console.json")
    except OSError:
        return


def record_action(directory: Path, action: str) -> None:
    """Add an operator's action, with the time, to the file of all of them."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with (directory / ACTIONS).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"time": utc_now(), "action": action}, ensure_ascii=False) + "\n")
    except OSError:
        return
