"""The versions of a store's model."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from rigctl.campaign.store.store import Store
from rigctl.cli.io import Json, Plugins, StoreFile, print_json, tell
from rigctl.composition import opened_workbench
from rigctl.report.terminal_workbench import print_history, print_versions
from rigctl.workbench.model.versions import current, remove_all

app = typer.Typer(name="model", add_completion=False, help=__doc__)

Effects = Annotated[
    list[str], typer.Argument(metavar="EFFECT...", help="Ids of effects; `rigctl effects` lists them.")
]


@app.command()
def show(store: StoreFile, as_json: Json = False) -> None:
    """The current version: its effects, what was chosen of them, and where they came from."""
    with Store.open(store, readonly=True) as opened:
        _print_versions([current(opened).as_json()], as_json=as_json, single=True)


@app.command()
def history(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """The error ladder: how well each version describes the data, fitted and held out."""
    with opened_workbench(store, plugin or ()) as workbench:
        ladder = workbench.history(tell)
    (print_json if as_json else print_history)(ladder)


@app.command()
def add(store: StoreFile, effect: Effects, plugin: Plugins = None, as_json: Json = False) -> None:
    """Add effects: one new version each."""
    with opened_workbench(store, plugin or (), readonly=False) as workbench:
        _print_versions([each.as_json() for each in workbench.add(effect)], as_json=as_json)


@app.command()
def remove(store: StoreFile, effect: Effects, as_json: Json = False) -> None:
    """Take effects out: one new version each."""
    with Store.open(store) as opened:
        _print_versions([each.as_json() for each in remove_all(opened, effect)], as_json=as_json)


def _print_versions(listed: list[dict[str, Any]], *, as_json: bool, single: bool = False) -> None:
    if as_json:
        print_json(listed[0] if single else listed)
    else:
        print_versions(listed)
