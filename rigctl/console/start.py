"""Opens the console; what is wrong with its argument is told as any command tells it."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path

from rigctl.console.app import Console
from rigctl.console.place import kind_of, require_store
from rigctl.console.terminal import leave_terminal, watch_terminal
from rigctl.core.errors import Aborted, ConfigError
from rigctl.core.making_safe import require_rest

HAS_RUN = threading.Event()
"""Set when a console has been on the terminal: it leaves threads behind."""


def start(place: Path | None, plugins: Sequence[Path]) -> None:
    """Run the console on this terminal until the operator quits; `ConfigError`, `DataError` before it is drawn.

    `Aborted` when a signal ended it, `RigError` when an instrument has not confirmed that it is at rest.
    """
    if place is not None:
        check(place)
    # Keys come in on the one, the screen goes out on the other, as textual has it.
    if not (os.isatty(0) and os.isatty(2)):
        raise ConfigError(
            "the console needs a terminal; without one use `rigctl run`, `rigctl status`, `rigctl answer`"
        )
    console = Console(place, plugins, leave_terminal=leave_terminal)
    watch_terminal()
    HAS_RUN.set()
    try:
        console.run()
    finally:
        # Also where the screen could not be drawn or has failed on its way.
        console.make_safe()
    require_rest(console.unsafe)
    if console.interrupted:
        raise Aborted(console.interrupted)


def check(place: Path) -> None:
    """Raise what the commands raise for a rig file, campaign file or store that cannot be used."""
    from rigctl.files.campaign_file import parse_campaign
    from rigctl.files.rig_file import parse_rig

    if place.suffix != ".toml":
        require_store(place)
        return
    kind, text = kind_of(place)
    if kind == "rig":
        parse_rig(text, place)
    else:
        parse_campaign(text, place)
