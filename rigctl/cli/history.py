"""The command that puts the calibrations of an item beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.io import Json, Plugins, Processes, Scheduler, print_json, say, tell, workers_of
from rigctl.core.errors import DataError, ProcedureError
from rigctl.core.workers import Workers
from rigctl.history.catalogue import Catalogue, catalogue_of
from rigctl.history.item_history import ItemHistory, histories_of
from rigctl.history.tables import document_of, terminal_tables, warnings_of
from rigctl.report.tables.result_table import print_tables

app = typer.Typer(add_completion=False)


@app.command()
def history(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A directory with stores, also below it.")],
    serial: Annotated[str | None, typer.Option(metavar="S", help="Only the item with this serial number.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Everything in one file.")] = None,
    figures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per control chart.")
    ] = None,
    plugin: Plugins = None,
    workers: Processes = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """All calibrations of an item: drift, control charts, and does the newest agree with the former ones?"""
    _require_place(out)
    catalogue = catalogue_of(directory, serial, plugin or (), tell, workers_of(workers, scheduler) or Workers())
    for store in catalogue.not_listed:
        tell(f"{store.store}: {store.reason}")
    if not catalogue.calibrations:
        raise DataError(
            f"{directory}: none of its {catalogue.stores} stores is a finished calibration of a known item"
        )
    histories = histories_of(catalogue.calibrations)
    written = _written(catalogue, histories, out, figures)
    if as_json:
        print_json({**document_of(catalogue, histories), "written": written})
    else:
        for each in histories:
            print_tables(terminal_tables(each))
            say("")
        for path in written:
            say(path)
    if warnings := [warning for each in histories for warning in warnings_of(each)]:
        raise ProcedureError(f"{directory}: {'; '.join(warnings)}")


def _require_place(out: Path | None) -> None:
    if out is not None:
        from rigctl.report.html import require_directory  # drawing, which only a page needs

        require_directory(out)


def _written(catalogue: Catalogue, histories: list[ItemHistory], out: Path | None, figures: Path | None) -> list[str]:
    if out is None and figures is None:
        return []
    from rigctl.history.charts import all_charts, page
    from rigctl.report.figures.data import write_plates
    from rigctl.report.html import write_page

    written: list[Path] = []
    if out is not None:
        write_page(out, page(catalogue, histories))
        written.append(out)
    if figures is not None:
        written += write_plates(list(all_charts(histories)), {}, figures)
    return list(map(str, written))
