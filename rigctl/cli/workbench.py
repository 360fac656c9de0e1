"""Commands that ask where a model fails and why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, Plugins, StoreFile, number, print_json, tell
from rigctl.composition import opened_workbench
from rigctl.core.whole_file import writing
from rigctl.report.terminal_workbench import print_comparison, print_diagnosis, print_fit

app = typer.Typer()


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
    with opened_workbench(store, plugin or ()) as workbench:
        document = workbench.comparison()
        if with_ is not None:
            with opened_workbench(with_, plugin or ()) as other:
                document["with"] = {"store": str(with_), **workbench.compare_with(other).as_json()}
    (print_json if as_json else print_comparison)(document)


@app.command()
def diagnose(
    store: StoreFile,
    alpha: Annotated[
        float, typer.Option(metavar="LEVEL", parser=number, help="Level over all trials together.")
    ] = 0.01,
    draft: Annotated[
        Path | None, typer.Option(metavar="FILE.py", help="Write what stays unexplained as a plug-in to be named.")
    ] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Which physical effect is missing? Adds nothing."""
    with opened_workbench(store, plugin or ()) as workbench:
        version = workbench.current
        if draft is None:
            document = workbench.diagnosis(alpha, tell)
        else:
            from rigctl.workbench.draft import drafted  # scipy, which only a draft needs here

            diagnosis = workbench.diagnose(alpha, tell)
            text = drafted(workbench, diagnosis)
            with writing(draft):
                draft.write_text(text, encoding="utf-8")
            tell(f"written: {draft}; name the physics in it, then `rigctl diagnose {store} --plugin {draft}`")
            document = diagnosis.as_json()
    document["model"]["version"] = version.version
    if as_json:
        print_json(document)
    else:
        print_diagnosis(document, str(store))


@app.command()
def fit(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """Fit the current model and show its parameters."""
    with opened_workbench(store, plugin or ()) as workbench:
        document = {"version": workbench.current.version, **workbench.model_fit()}
    (print_json if as_json else print_fit)(document)
