"""The command that writes a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, Plugins, StoreFile, print_outcome, tell
from rigctl.composition import opened_workbench
from rigctl.core.errors import ConfigError
from rigctl.report.document import write_report

app = typer.Typer(add_completion=False)


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
    with opened_workbench(store, plugin or ()) as workbench:
        written = [str(path) for path in write_report(workbench, out, figures, tell)]
    print_outcome({"written": written}, "\n".join(written), as_json=as_json)
