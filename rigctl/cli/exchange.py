"""Commands that take recordings in and out as plain files."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from rigctl.campaign.bundle.bundle import import_bundle, import_report, salvage_bundle, write_bundle
from rigctl.campaign.bundle.hdf5 import write_hdf5
from rigctl.campaign.recording import READINGS, ImportReport
from rigctl.campaign.store.store import Store
from rigctl.cli.io import Json, StoreFile, print_json, print_outcome, say, tell
from rigctl.cli.steering import tell_if_unchecked
from rigctl.core.errors import ConfigError
from rigctl.core.experiments import of_readings
from rigctl.experiments.analysis import analysis_of
from rigctl.report.quantities import counted

SAY_EVERY_S = 2.0

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
        read = _read(imported, report)
        # At once, so that the first question put to the store is as fast as every later one.
        left_out = _reduced(imported)
    if as_json:
        print_json(
            {
                "runs": report.runs,
                "invalid": dict(report.invalid),
                "warnings": list(report.warnings),
                "not_reduced": left_out,
            }
        )
        return
    say(read)
    for run_id, why in report.invalid:
        say(f"run {run_id} invalid: {why}")
    for why in left_out.values():
        say(f"not reduced: {why}")
    for warning in report.warnings:
        say(f"warning: {warning}")


def _read(store: Store, report: ImportReport) -> str:
    """What was read: runs, or the rows of a table, which are one run."""
    if of_readings(store.header.experiment):
        rows = max(map(len, store.samples(READINGS).values()), default=0)
        return f"{counted(rows, 'row')} read into {store.path}"
    return f"{counted(report.runs, 'run')} read into {store.path}, {len(report.invalid)} of them invalid"


def _reduced(store: Store) -> dict[str, str]:
    """Reduce the valid runs once and for all, saying how fast; which were left out, and why."""
    began_s = said_s = time.monotonic()

    def progress(done: int, runs: int) -> None:
        nonlocal said_s
        now_s = time.monotonic()
        if done == runs or now_s - said_s >= SAY_EVERY_S:
            said_s = now_s
            tell(f"{done} of {runs} runs reduced, {done / max(now_s - began_s, 1e-9):.0f} runs/s")

    return dict(analysis_of(store.header.experiment, store.path).reduced(store, progress))


@app.command()
def export(
    store: StoreFile,
    directory: Annotated[Path, typer.Argument(metavar="DIR")],
    format_: Annotated[str, typer.Option("--format", metavar="FORMAT", help="bundle or hdf5")] = "bundle",
    salvage: Annotated[
        bool, typer.Option("--salvage", help="Save what verifies of a damaged store, and runs that were cut off.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a store as a bundle of plain files, or as one HDF5 file in DIR."""
    if format_ not in {"bundle", "hdf5"}:
        raise ConfigError(f"--format {format_} is unknown; bundle or hdf5")
    if salvage:
        _salvage(store, directory, format_, as_json=as_json)
        return
    tell_if_unchecked(store)
    written = directory
    with Store.open(store, readonly=True) as opened:
        if format_ == "hdf5":
            directory.mkdir(parents=True, exist_ok=True)
            written = directory / f"{store.stem}.h5"
            write_hdf5(opened, written)
        else:
            write_bundle(opened, directory)
    print_outcome({"written": str(written), "lost": []}, f"written: {written}", as_json=as_json)


def _salvage(store: Path, directory: Path, format_: str, *, as_json: bool) -> None:
    if format_ != "bundle":
        raise ConfigError("--salvage writes a bundle; leave out --format")
    # Asked here: salvaging would tell a missing file as one in which nothing is left.
    if not store.is_file():
        raise ConfigError(f"{store}: no such store; check the name")
    salvaged = salvage_bundle(store, directory)
    for line in salvaged.lost:
        tell(line)
    document = {"written": str(directory), "saved": list(salvaged.saved), "lost": list(salvaged.lost)}
    text = f"saved: {', '.join(salvaged.saved) or 'no run'}\nwritten: {directory}"
    print_outcome(document, text, as_json=as_json)
