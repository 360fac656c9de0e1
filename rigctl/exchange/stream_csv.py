"""The samples of one run as CSV: a column for each channel on the rig's clock, units in the header, in any length."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigctl.campaign.bundle.sample_file import csv_header, csv_rows
from rigctl.campaign.recording import RunRecord
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.units import unit_of_column
from rigctl.core.whole_file import whole_file
from rigctl.exchange.streams import Block, Stream, blocks, noise_of, streams_of, unit_of

SHOWN = 5


def write_stream_csv(store: Store, run_id: str | None, path: Path) -> tuple[Stream, ...]:
    """Write the samples of a run, the only one where none is named, to a new file; which streams are not in it.

    A unit stands in brackets behind the name where the name does not tell it; `u_NAME` is the standard uncertainty of
    each sample of a channel whose noise is known. `DataError` for a run that there is not, `DamagedStore`.
    """
    run_id = run_id if run_id is not None else _only(store).run_id
    streams = streams_of(store, run_id)
    if not streams or streams[0].channel:
        raise DataError(f"{store.path}: run {run_id} has no samples on the rig's clock; name another run")
    stream = streams[0]
    with whole_file(path) as partial, partial.open("wb") as file:
        file.write(csv_header(_names(store, stream)))
        for block in blocks(store, run_id, stream):
            file.write(csv_rows(_columns(store, block)))
    return streams[1:]


def _only(store: Store) -> RunRecord:
    runs = store.runs()
    if not runs:
        raise DataError(f"{store.path}: no finished run in it, so no samples; see `rigctl status`")
    if len(runs) > 1:
        shown = ", ".join(run.run_id for run in runs[:SHOWN]) + (", ..." if len(runs) > SHOWN else "")
        raise DataError(f"{store.path}: {len(runs)} runs in it ({shown}); name one with --run")
    return runs[0]


def _names(store: Store, stream: Stream) -> Iterator[str]:
    channels = store.header.channels
    for name in stream.columns:
        unit = unit_of(channels, name)
        told = f" [{unit}]" if unit and unit_of_column(name) != unit else ""
        yield name + told
        if noise_of(channels, name) is not None:
            yield f"u_{name}{told}"


def _columns(store: Store, block: Block) -> list[FloatArray]:
    columns: list[FloatArray] = []
    for name, column in block.items():
        columns.append(column)
        if (noise := noise_of(store.header.channels, name)) is not None:
            columns.append(np.full(column.shape, noise))
    return columns
