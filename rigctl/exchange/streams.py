"""The samples of a run as streams: columns that were sampled at the same times, read block by block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.campaign.recording import OWN_CLOCK, ChannelInfo, time_column
from rigctl.campaign.store.store import Store
from rigctl.core.arrays import FloatArray
from rigctl.core.units import unit_of_column

BLOCK = 1 << 16
"""Samples of a column that are in memory at a time: half a MiB."""

TIME = "t_s"

Block = dict[str, FloatArray]


@dataclass(frozen=True)
class Stream:
    """Columns of one clock: the rig's, or that of the `channel` which has one of its own. `time` is among them."""

    channel: str
    time: str | None
    columns: tuple[str, ...]


def streams_of(store: Store, run_id: str) -> tuple[Stream, ...]:
    """The streams of a run, that of the rig's clock first; none where it has no samples. `DataError`."""
    names = store.column_names(run_id)
    own = [name for name in names if time_column(name) in names]
    apart = {*own, *map(time_column, own)}
    common = tuple(name for name in names if name not in apart)
    of_rig = [Stream("", TIME if TIME in common else None, common)] if common else []
    return (*of_rig, *(Stream(name, time_column(name), (time_column(name), name)) for name in own))


def blocks(store: Store, run_id: str, stream: Stream) -> Iterator[Block]:
    """The columns of a stream, `BLOCK` samples at a time, the last block shorter; `DamagedStore` before the first."""
    waiting: list[Block] = []
    count = 0
    for piece in store.sample_chunks(run_id, stream.columns):
        waiting.append(piece)
        count += len(piece[stream.columns[0]])
        if count >= BLOCK:
            joined = _joined(waiting, stream)
            whole = count // BLOCK * BLOCK
            for first in range(0, whole, BLOCK):
                yield {name: column[first : first + BLOCK] for name, column in joined.items()}
            waiting, count = [{name: column[whole:] for name, column in joined.items()}], count - whole
    if count:
        yield _joined(waiting, stream)


def _joined(pieces: list[Block], stream: Stream) -> Block:
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in stream.columns}


def unit_of(channels: Mapping[str, ChannelInfo], column: str) -> str:
    """The unit of a column of samples: its channel's, or the one that its name tells; "" for none."""
    known = channels.get(column)
    return known.unit if known and known.unit else unit_of_column(column)


def noise_of(channels: Mapping[str, ChannelInfo], column: str) -> float | None:
    """The standard uncertainty of each sample of a column, in its unit; None where the recording does not say.

    Of a time on a clock of its own how well that clock is known on the rig's time.
    """
    own = next((each for name, each in channels.items() if time_column(name) == column), None)
    if own is not None and own.clock == OWN_CLOCK:
        return own.clock_u_s
    known = channels.get(column)
    return known.noise_rms if known else None
