"""The command that opens the operator's console."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Plugins

app = typer.Typer()


@app.command()
def console(
    place: Annotated[
        Path | None, typer.Argument(metavar="RIG|STORE", help="What to open; default: what was open last.")
    ] = None,
    plugin: Plugins = None,
) -> None:
    """The operator's console: rig, campaign, results, workbench, log."""
    from rigctl.console.start import start

    start(place, plugin or ())
