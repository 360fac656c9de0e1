"""Commands that show what a store amounts to: the result, the report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, Plugins, StoreFile, print_json, say, tell, tell_if_unchecked, workbench
from rigctl.core.errors import ConfigError

app = typer.Typer()


@app.command()
def result(store: StoreFile, plugin: Plugins = None, as_json: Json = False) -> None:
    """What a store amounts to: the sensing axes with their uncertainty, or the fit of a table."""
    from rigctl import results

    tell_if_unchecked(store)
    found = results.of(store, plugin or ())
    if as_json:
        print_json(found)
    else:
        results.show(store, found)


@app.command()
def report(
    store: StoreFile,
    out: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Everything in one file.")] = None,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per figure.")] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Write what is known of a store: one HTML file, the figures, or both."""
    if out is None and figures is None:
        raise ConfigError("nothing to write: pass --out FILE.html, --figures DIR, or both")
    from rigctl.report.document import write_report

    with workbench(store, plugin) as bench:
        written = [str(path) for path in write_report(bench, out, figures, tell)]
    if as_json:
        print_json({"written": written})
    else:
        say("\n".join(written))
