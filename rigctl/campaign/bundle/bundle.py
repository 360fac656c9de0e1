"""Bundles, the exchange format: in, out, and between them and a store."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rigctl.campaign.bundle.files import open_bundle
from rigctl.campaign.bundle.reader import BundleReader
from rigctl.campaign.bundle.salvage import HEADER_LOST, Salvage
from rigctl.campaign.bundle.writer import RunWithSamples, padded, whole_directory, write_readings, write_runs
from rigctl.campaign.recording import Header, ImportReport, Recording, RunSource, on_rig_time, own_clocks
from rigctl.campaign.store import synced
from rigctl.campaign.store.entries import IMPORTED
from rigctl.campaign.store.store import Store
from rigctl.campaign.table_constants import TableConstants
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.experiments import experiment_named, of_readings

_PIECE = 1 << 20

__all__ = ["import_bundle", "import_report", "read_bundle", "salvage_bundle", "write_bundle"]


def read_bundle(path: Path) -> Recording:
    """The recording in the directory or .zip at `path`, all of it in memory.

    `DataError`, one line with file, line and mend, for what cannot be accepted; runs that cannot be used and
    remarks are in the recording's `report`.
    """
    with open_bundle(path) as files:
        reader = BundleReader(files)
        runs = list(reader.runs())
    columns = {record.run_id: samples for record, samples in runs}
    return Recording(reader.header, tuple(record for record, _ in runs), columns, reader.report)


def import_bundle(path: Path, store_path: Path, constants: TableConstants | None = None) -> Store:
    """A new store with the recording in the bundle at `path`; `import_report` tells what was found.

    `constants` of a table's baseline stand in place of those of its recording.toml.
    Runs are read one at a time; the baseline of a table is fitted once. `DataError` as `read_bundle`, where that
    cannot be done, and when `store_path` exists; then nothing is left.
    """
    if store_path.exists():
        raise DataError(f"{store_path}: exists already; name another store")
    if not store_path.parent.is_dir():
        raise DataError(f"{store_path}: no such directory; make it first")
    # In the same directory, so that the rename is one step of one file system; a store has its name only when whole.
    partial = store_path.with_name(f".{store_path.name}.{os.getpid()}")
    try:
        with open_bundle(path) as files:
            reader = BundleReader(files)
            _fill(partial, reader, reader.header if constants is None else reader.header.with_constants(constants))
        partial.rename(store_path)
    # Ctrl-C too: whatever ends an import must not leave part of a store.
    except BaseException:
        for suffix in ("", "-wal", "-shm", synced.SUFFIX):
            with suppress(OSError):  # not there, or on a medium that takes nothing
                partial.with_name(partial.name + suffix).unlink()
        raise
    return Store.open(store_path)


def _fill(path: Path, reader: BundleReader, header: Header) -> None:
    with Store.create(path, header) as store, store.filling():
        for record, samples in reader.runs():
            if header.table is not None:
                _require_answerable(reader, Recording(header, (record,), {record.run_id: samples}, ImportReport(1)))
            with store.begin_run(record.key, record.step, record.conditions, record.run_id) as writer:
                for piece in _pieces(samples):
                    writer.append(piece)
                writer.finish(valid=record.valid, reason=record.reason)
        store.add_event(IMPORTED, asdict(reader.report))


def _require_answerable(reader: BundleReader, readings: Recording) -> None:
    """`DataError` for a table that no command could use: a store could not be mended. What it leaves out is told."""
    declared = experiment_named(readings.header.experiment)
    if declared.question:
        try:
            reader.warn(declared.load(declared.question)(readings))
        except DataError as error:
            raise reader.located(error) from error


def _pieces(samples: Mapping[str, FloatArray]) -> Iterator[dict[str, FloatArray]]:
    """The columns of a run cut alike, so that a long run can be read again piece by piece."""
    longest = max((column.size for column in samples.values()), default=0)
    for first in range(0, max(longest, 1), _PIECE):
        yield {name: column[first : first + _PIECE] for name, column in samples.items()}


def import_report(store: Store) -> ImportReport | None:
    """What was found when the store was imported; None for one that was recorded."""
    events = store.events(IMPORTED)
    if not events:
        return None
    data = events[0].data
    invalid = tuple((run_id, reason) for run_id, reason in data["invalid"])
    return ImportReport(data["runs"], invalid, tuple(data["warnings"]))


def write_bundle(source: RunSource, directory: Path) -> None:
    """Write the recording or store as a bundle to `directory`, which does not exist or is empty.

    `DataError`, and `DamagedStore` for a run that is not as it was written; then nothing is left.
    """
    _write(source, ((record, source.samples(record.run_id)) for record in source.runs()), directory)


@dataclass(frozen=True)
class Salvaged:
    """What became of the runs of a store: the run_id of each that was saved, a line for each that was not."""

    saved: tuple[str, ...]
    lost: tuple[str, ...]


def salvage_bundle(store: Path, directory: Path) -> Salvaged:
    """Write every run of a store that is as it was written, whatever became of the rest of the file, as a bundle.

    What there is of runs that were cut off comes too, marked invalid. `DataError` when there is nothing to save;
    then nothing is left.
    """
    salvage = Salvage(store)
    header = salvage.header or Header(salvage.guessed, extra={"salvaged": HEADER_LOST})
    saved: list[str] = []
    # Only the header is taken from this: `_saved` gives the runs, and tells `saved` and `lost` as they pass.
    _write(Recording(header, (), {}, ImportReport(0)), _saved(salvage, header, saved), directory)
    return Salvaged(tuple(saved), (*(() if salvage.header else (HEADER_LOST,)), *salvage.lost))


def _saved(salvage: Salvage, header: Header, saved: list[str]) -> Iterator[RunWithSamples]:
    channels = set(header.channels) - set(own_clocks(header))
    for record, samples in salvage.runs():
        if record.state == "finished":
            channels |= on_rig_time(samples).keys()
            saved.append(record.run_id)
            yield record, samples
        elif "t_s" in samples:
            saved.append(record.run_id)
            cut_off = replace(record, valid=False, reason=f"interrupted: {record.reason or 'cut off'}")
            yield cut_off, padded(samples, sorted(channels))
        else:
            salvage.lost.append(f"run {record.run_id}: {record.state}, without samples")


def _write(source: RunSource, runs: Iterator[RunWithSamples], directory: Path) -> None:
    with whole_directory(directory) as partial:
        write = write_readings if of_readings(source.header.experiment) else write_runs
        write(source, runs, partial)
