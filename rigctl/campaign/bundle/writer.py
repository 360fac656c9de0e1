"""A recording as the files of a bundle."""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.campaign.bundle.files import HEADER_FILE
from rigctl.campaign.bundle.recording_toml import header_to_toml
from rigctl.campaign.bundle.sample_file import csv_bytes, npz_bytes
from rigctl.campaign.recording import (
    OWN_CLOCK,
    ChannelInfo,
    Header,
    RunRecord,
    RunSource,
    on_rig_time,
    time_column,
)
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.whole_file import writing

LONG_RUN_VALUES = 1_000_000
"""A run with more numbers than this is written as .npz: a spreadsheet could not open it anyway."""

RunWithSamples = tuple[RunRecord, Mapping[str, FloatArray]]


@contextmanager
def whole_directory(directory: Path) -> Iterator[Path]:
    """A directory to write in that takes its name only when all is written; `DataError` if the name is in use."""
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise DataError(f"{directory}: exists and is not an empty directory; name another")
    with writing(directory, "cannot be made", "name another place"):
        directory.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{directory.name}.", dir=directory.parent))
    try:
        with writing(directory, mend="name another place"):
            yield partial
            # mkdtemp makes directories that only their owner can read.
            partial.chmod(0o755)
            partial.replace(directory)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def write_runs(source: RunSource, runs: Iterator[RunWithSamples], directory: Path) -> None:
    """recording.toml, runs.csv, one file per run and, where there are custom patterns, patterns.csv."""
    (directory / "runs").mkdir()
    records = []
    own: set[str] = set()
    for record, samples in runs:
        _write_samples(directory / "runs", record.run_id, samples)
        own |= {name for name in samples if time_column(name) in samples}
        records.append(record)
    # Last: the runs come one at a time, and their rows are complete only when all samples have passed.
    header = _with_own_clocks(source.header, own)
    (directory / HEADER_FILE).write_text(header_to_toml(header), encoding="utf-8")
    _write_table(directory / "runs.csv", *_run_table(records))
    if patterns := source.header.extra.get("patterns"):
        _write_table(directory / "patterns.csv", list(patterns), zip(*patterns.values(), strict=True))


def _with_own_clocks(header: Header, own: Iterable[str]) -> Header:
    """A header that says which channels have a clock of their own, should it have been lost."""
    unsaid = {name: header.channels.get(name, ChannelInfo()) for name in sorted(own)}
    said = {name: replace(channel, clock=OWN_CLOCK) for name, channel in unsaid.items()}
    return replace(header, channels={**header.channels, **said})


def write_readings(source: RunSource, runs: Iterator[RunWithSamples], directory: Path) -> None:
    """recording.toml and readings.csv of a `table` recording."""
    (directory / HEADER_FILE).write_text(header_to_toml(source.header), encoding="utf-8")
    for record, samples in runs:
        columns: dict[str, Sequence[Any]] = {name: column.tolist() for name, column in samples.items()}
        columns |= record.conditions
        _write_table(directory / "readings.csv", list(columns), zip(*columns.values(), strict=True))


def _run_table(records: Sequence[RunRecord]) -> tuple[list[str], Iterator[list[Any]]]:
    # In the order in which runs first had them: not every run has every condition.
    names = list(dict.fromkeys(name for record in records for name in record.conditions))
    reason = ["reason"] if any(record.reason for record in records) else []
    rows = (
        [
            record.run_id,
            *(record.conditions.get(name) for name in names),
            int(record.valid),
            *([record.reason] if reason else []),
        ]
        for record in records
    )
    return ["run_id", *names, "valid", *reason], rows


def _write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_field(value) for value in row] for row in rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def _field(value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    # Before numbers: bool is an int in Python, and True would be written as text.
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, str | int | float):
        # str of a float is its shortest text that reads back bit for bit.
        return str(value)
    return json.dumps(value)


def _write_samples(directory: Path, run_id: str, samples: Mapping[str, FloatArray]) -> None:
    common = on_rig_time(samples)
    _write_columns(directory, run_id, common)
    for name in samples:
        if (time := time_column(name)) in samples:
            _write_columns(directory, f"{run_id}.{name}", {"t_s": samples[time], name: samples[name]})


def _write_columns(directory: Path, name: str, columns: Mapping[str, FloatArray]) -> None:
    long = sum(column.size for column in columns.values()) > LONG_RUN_VALUES
    suffix, data = (".npz", npz_bytes(columns)) if long else (".csv", csv_bytes(columns))
    (directory / f"{name}{suffix}").write_bytes(data)


def padded(samples: Mapping[str, FloatArray], channels: Iterable[str]) -> dict[str, FloatArray]:
    """The columns of a run that was cut off, all of `channels` and as long as t_s: what had not come is NaN.

    A channel on a clock of its own comes at the end of a run: one that was cut off has none.
    """
    length = samples["t_s"].size
    columns = {**on_rig_time(samples), **{name: np.empty(0) for name in channels if name not in samples}}
    return {
        name: np.append(column[:length], np.full(max(0, length - column.size), np.nan))
        for name, column in columns.items()
    }
