"""Commands that ask where a model fails and why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.cli.io import Json, Plugins, StoreFile, number, print_json, tell, workbench

app = typer.Typer()
model = typer.Typer(no_args_is_help=True)
app.add_typer(model, name="model", help="The versions of a store's model.")

Effects = Annotated[
    list[str], typer.Argument(metavar="EFFECT...", help="Ids of effects; `rigctl effects` lists them.")
]


@app.command()
def compare(
    store: StoreFile,
    with_: Annotated[
        Path | None, typer.Option("--with", metavar="STORE2", help="Also another store, with the same model.")
    ] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """The current model beside the data: where does it fail?"""
    from rigctl.report.terminal_workbench import print_comparison

    with workbench(store, plugin) as bench:
        found = bench.compare().as_json()
        if with_ is not None:
            with workbench(with_, plugin) as other:
                found["with"] = {"store": str(with_), **bench.compare_with(other).as_json()}
    if as_json:
        print_json(found)
    else:
        print_comparison(found)


@app.command()
def diagnose(
    store: StoreFile,
    alpha: Annotated[
        float, typer.Option(metavar="LEVEL", parser=number, help="Level over all trials together.")
    ] = 0.01,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Which physical effect is missing? Adds nothing."""
    from rigctl.report.terminal_workbench import print_diagnosis

    with workbench(store, plugin) as bench:
        version = bench.current
        found = bench.diagnose(alpha, tell).as_json()
    found["model"]["version"] = version.version
    if as_json:
        print_json(found)
    else:
        print_diagnosis(found, str(store))


@app.command()
def fit(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """Fit the current model and show its parameters."""
    from rigctl.report.terminal_workbench import print_fit

    with workbench(store, plugin) as bench:
        version = bench.current
        found = {"version": version.version, **bench.fit(version).as_json()}
    if as_json:
        print_json(found)
    else:
        print_fit(found)


@model.command()
def show(store: StoreFile, as_json: Json = False) -> None:
    """The current version: its effects, what was chosen of them, and where they came from."""
    from rigctl.campaign.store.store import Store
    from rigctl.workbench.model.versions import current

    with Store.open(store, readonly=True) as opened:
        _print_versions([current(opened).as_json()], as_json=as_json, single=True)


@model.command()
def history(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """The error ladder: how well each version describes the data, fitted and held out."""
    from rigctl.report.terminal_workbench import print_history

    with workbench(store, plugin) as bench:
        found = bench.history(tell)
    if as_json:
        print_json(found)
    else:
        print_history(found)


@model.command()
def add(store: StoreFile, effect: Effects, plugin: Plugins = None, as_json: Json = False) -> None:
    """Add effects: one new version each."""
    with workbench(store, plugin) as bench:
        _print_versions([each.as_json() for each in bench.add(effect)], as_json=as_json)


@model.command()
def remove(store: StoreFile, effect: Effects, as_json: Json = False) -> None:
    """Take effects out: one new version each."""
    from rigctl.campaign.store.store import Store
    from rigctl.workbench.model.versions import remove_all

    with Store.open(store) as opened:
        _print_versions([each.as_json() for each in remove_all(opened, effect)], as_json=as_json)


def _print_versions(found: list[dict[str, Any]], *, as_json: bool, single: bool = False) -> None:
    from rigctl.report.terminal_workbench import print_versions

    if as_json:
        print_json(found[0] if single else found)
    else:
        print_versions(found)
