"""The command that shows what a store amounts to."""

from __future__ import annotations

import typer

from rigctl import results
from rigctl.cli.io import Json, Plugins, StoreFile, print_json
from rigctl.cli.steering import tell_if_unchecked

app = typer.Typer(add_completion=False)


@app.command()
def result(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """What a store amounts to: the sensing axes with their uncertainty, or the fit of a table."""
    tell_if_unchecked(store)
    document = results.of(store, plugin or ())
    if as_json:
        print_json(document)
    else:
        results.show(store, document)
