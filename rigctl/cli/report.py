"""The command that writes a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, Plugins, Processes, Scheduler, print_outcome, tell, workers_of
from rigctl.composition import opened_workbench
from rigctl.core.errors import ConfigError, ProcedureError
from rigctl.core.workers import Workers
from rigctl.report.document import write_report
from rigctl.reports import write_reports

app = typer.Typer(add_completion=False)


@app.command()
def report(
    stores: Annotated[
        list[Path], typer.Argument(metavar="STORE...", help="Campaign files, by convention *.rig.sqlite.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Everything in one file; of several stores, a directory.")
    ] = None,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per figure.")] = None,
    plugin: Plugins = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Write what is known of a store, or of several: one HTML file each, the figures, or both."""
    by = workers_of(workers, scheduler)
    if out is None and figures is None:
        raise ConfigError("nothing to write: pass --out FILE.html, --figures DIR, or both")
    if len(stores) > 1:
        _of_many(stores, out, figures, plugin or [], by or Workers(), as_json=as_json)
        return
    if by is not None:
        raise ConfigError("one report is written by this process; leave out --workers and --scheduler")
    with opened_workbench(stores[0], plugin or ()) as workbench:
        written = [str(path) for path in write_report(workbench, out, figures, tell)]
    print_outcome({"written": written}, "\n".join(written), as_json=as_json)


def _of_many(
    stores: list[Path], out: Path | None, figures: Path | None, plugins: list[Path], by: Workers, *, as_json: bool
) -> None:
    reports = write_reports(stores, out, figures, plugins, by, tell)
    failed = {str(each.store): each.failed for each in reports if each.failed}
    # A page is what is opened; the figures of each lie in one directory.
    files = [str(path) for each in reports for path in each.files]
    shown = [str(each.files[0] if out else each.files[0].parent) for each in reports if each.files]
    print_outcome({"written": files, "failed": failed}, "\n".join(shown), as_json=as_json)
    if failed:
        raise ProcedureError(f"{len(failed)} of {len(reports)} reports not written: {'; '.join(failed.values())}")
