"""The application that all commands are in."""

from __future__ import annotations

from typing import Annotated

import typer

from rigctl.cli.commands import Commands

app = typer.Typer(cls=Commands, add_completion=False, pretty_exceptions_enable=False)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"rigctl {version('rigctl')}")
        raise typer.Exit


@app.callback()
def rigctl(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Which this is.")
    ] = False,
) -> None:
    """Instrument control and model building for precision accelerometer calibration."""
