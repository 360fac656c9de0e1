"""The command that opens the operator's console."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Plugins
from rigctl.console.start import start

app = typer.Typer(add_completion=False)


@app.command()
def console(
    place: Annotated[
        Path | None, typer.Argument(metavar="RIG|STORE", help="What to open; default: what was open last.")
    ] = None,
    plugin: Plugins = None,
) -> None:
    """The operator's console: rig, campaign, results, workbench, log."""
    start(place, plugin or ())
