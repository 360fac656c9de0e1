"""The application that all commands are in."""

from __future__ import annotations

import os

# Plain help: panels and colours take longer to import than all that a page of help needs.
os.environ.setdefault("TYPER_USE_RICH", "0")

import typer

from rigctl.cli.commands import Commands

app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


@app.callback()
def rigctl() -> None:
    """Instrument control and model building for precision accelerometer calibration."""
