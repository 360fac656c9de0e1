"""Commands that take recordings in and out as plain files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rigctl.campaign.bundle.bundle import import_bundle, import_report, salvage_bundle, write_bundle
from rigctl.campaign.recording import READINGS, ImportReport
from rigctl.campaign.store.store import Store
from rigctl.cli.io import Json, Plugins, StoreFile, print_json, print_outcome, say, tell, words
from rigctl.cli.steering import tell_if_unchecked
from rigctl.composition import opened_workbench
from rigctl.core.errors import UNFIT, ConfigError, either
from rigctl.core.experiments import of_readings
from rigctl.core.extra import FILES, needed
from rigctl.exchange.store_table import StoreTable, store_table
from rigctl.experiments.analysis import analysis_of, measurement_result_of
from rigctl.report.quantities import counted
from rigctl.report.time_left import Pace
from rigctl.workbench.workbench import Workbench

app = typer.Typer()


@app.command("import")
def import_(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="A bundle: a directory or a .zip of one.")],
    store: Annotated[Path, typer.Option(metavar="STORE", help="The store to make.")],
    as_json: Json = False,
) -> None:
    """Read a recording, ours or another laboratory's, into a store."""
    with import_bundle(bundle, store) as imported:
        report = import_report(imported) or ImportReport(len(imported.runs()))
        # At once, so that the first question put to the store is as fast as every later one.
        left_out = _reduced(imported)
        for run_id, why in left_out.items():
            # What no fit can use is no valid run: every count, and a certificate, says so.
            imported.mark(run_id, valid=False, reason=f"not reduced: {why}")
        invalid = {**dict(report.invalid), **left_out}
        read = _read(imported, len(invalid))
    if as_json:
        print_json(
            {
                "runs": report.runs,
                "invalid": invalid,
                "warnings": list(report.warnings),
                "not_reduced": left_out,
            }
        )
        return
    say(read)
    for name, why in invalid.items():
        say(f"{name if of_readings(imported.header.experiment) else f'run {name}'} invalid: {why}")
    for warning in report.warnings:
        say(f"warning: {warning}")


def _read(store: Store, invalid: int) -> str:
    """What was read: runs, or the rows of a table, which are one run."""
    if of_readings(store.header.experiment):
        rows = max(map(len, store.samples(READINGS).values()), default=0)
        said = f", {invalid} of them invalid" if invalid else ""
        return f"{counted(rows, 'row')} read into {store.path}{said}"
    return f"{counted(len(store.runs()), 'run')} read into {store.path}, {invalid} of them invalid"


def _reduced(store: Store) -> dict[str, str]:
    """Reduce the valid runs once and for all, saying how long it takes; of which that could not be done, and why."""
    pace = Pace("runs reduced", tell)
    left_out = analysis_of(store.header.experiment, store.path).reduced(store, pace.reached)
    return {run_id: why.removeprefix(f"run {run_id}: ") for run_id, why in left_out.items()}


@app.command()
def export(
    store: StoreFile,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A directory, or a .nxs, .h5, .parquet or .csv file.")],
    format_: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="bundle, hdf5, nexus, parquet or csv; else as OUT is named"),
    ] = "",
    run: Annotated[
        str | None, typer.Option("--run", metavar="RUN", parser=words, help="csv: the run whose samples to write.")
    ] = None,
    salvage: Annotated[
        bool, typer.Option("--salvage", help="Save what verifies of a damaged store, and runs that were cut off.")
    ] = False,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Write a store as a bundle of plain files, or for other programs: HDF5, NeXus, Parquet, CSV."""
    form = format_ or FORM_BY_SUFFIX.get(out.suffix.lower(), BUNDLE)
    if form not in FORMS:
        raise ConfigError(f"--format {form} is unknown; {either(FORMS)}")
    if run is not None and form != CSV:
        raise ConfigError(f"--run is for the samples of one run as csv; leave it out for {form}")
    if salvage:
        _salvage(store, out, form, as_json=as_json)
        return
    tell_if_unchecked(store)
    written = FORMS[form](store, out, Wanted(run, tuple(plugin or ())))
    print_outcome({"written": str(written), "lost": []}, f"written: {written}", as_json=as_json)


@dataclass(frozen=True)
class Wanted:
    """Options that only some forms take: a run, and files with effects of the model."""

    run: str | None
    plugins: tuple[Path, ...]


def _bundle(store: Path, out: Path, _: Wanted) -> Path:
    with Store.open(store, readonly=True) as opened:
        write_bundle(opened, out)
    return out


def _hdf5(store: Path, out: Path, _: Wanted) -> Path:
    from rigctl.campaign.bundle.hdf5 import write_hdf5

    with Store.open(store, readonly=True) as opened:
        out.mkdir(parents=True, exist_ok=True)
        written = out / f"{store.stem}.h5"
        write_hdf5(opened, written)
    return written


def _nexus(store: Path, out: Path, wanted: Wanted) -> Path:
    from rigctl.exchange.nexus.file import write_nexus

    with opened_workbench(store, wanted.plugins, readonly=True) as workbench:
        table = _table(workbench)
        result = None
        try:
            result = measurement_result_of(workbench)
        except UNFIT as error:
            tell(f"without a result: {error}")
        write_nexus(workbench.store, table, result, out)
    return out


def _parquet(store: Path, out: Path, wanted: Wanted) -> Path:
    from rigctl.exchange.parquet import write_parquet

    needed("pyarrow", FILES)  # asked before the runs are reduced
    with opened_workbench(store, wanted.plugins, readonly=True) as workbench:
        write_parquet(_table(workbench), workbench.store.header, out)
    return out


def _csv(store: Path, out: Path, wanted: Wanted) -> Path:
    from rigctl.exchange.stream_csv import write_stream_csv

    with Store.open(store, readonly=True) as opened:
        for stream in write_stream_csv(opened, wanted.run, out):
            tell(f"without {stream.channel}: it has a clock of its own; --format nexus and bundle have it")
    return out


def _table(workbench: Workbench) -> StoreTable:
    table = store_table(workbench)
    if table.without_data:
        tell(f"only settings, nothing that was measured: {table.without_data}")
    return table


BUNDLE, CSV = "bundle", "csv"
FORMS: Mapping[str, Callable[[Path, Path, Wanted], Path]] = {
    BUNDLE: _bundle,
    "hdf5": _hdf5,
    "nexus": _nexus,
    "parquet": _parquet,
    CSV: _csv,
}
"""What writes a store, and returns what was written, by the name of the form."""

FORM_BY_SUFFIX = {".nxs": "nexus", ".h5": "nexus", ".parquet": "parquet", ".csv": CSV}


def _salvage(store: Path, directory: Path, form: str, *, as_json: bool) -> None:
    if form != BUNDLE:
        raise ConfigError("--salvage writes a bundle; leave out --format, and name a directory")
    # Asked here: salvaging would tell a missing file as one in which nothing is left.
    if not store.is_file():
        raise ConfigError(f"{store}: no such store; check the name")
    salvaged = salvage_bundle(store, directory)
    for line in salvaged.lost:
        tell(line)
    document = {"written": str(directory), "saved": list(salvaged.saved), "lost": list(salvaged.lost)}
    text = f"saved: {', '.join(salvaged.saved) or 'no run'}\nwritten: {directory}"
    print_outcome(document, text, as_json=as_json)
