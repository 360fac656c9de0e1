"""The samples of a run in a store, as columns of 64-bit floats."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing

import numpy as np

from rigctl.campaign.store.checked_rows import CheckedRows, Row
from rigctl.core.arrays import FloatArray


def joined_columns(chunks: Iterable[tuple[str, bytes]]) -> dict[str, FloatArray]:
    """The columns of chunks that come with their names, in the order they first came; half a number is left out."""
    parts: dict[str, list[bytes]] = {}
    for name, data in chunks:
        parts.setdefault(name, []).append(data[: len(data) // 8 * 8])
    return {name: _joined(column) for name, column in parts.items()}


def _joined(parts: Sequence[bytes]) -> FloatArray:
    # Copied once: those of an orbit are ten megabytes, and all their memory is touched for the first time.
    column, first = np.empty(sum(map(len, parts)) // 8), 0
    for part in parts:
        last = first + len(part) // 8
        column[first:last] = np.frombuffer(part, dtype="<f8")
        first = last
    return column


def sample_pieces(
    rows: CheckedRows, run: Row, columns: Sequence[str] | None = None
) -> Iterator[dict[str, FloatArray]]:
    """The columns, all or those named, piece by piece, each piece of one length in all of them; `DamagedStore`."""
    # Gone through twice: this first pass verifies all of it, and holds one chunk at a time.
    there = dict.fromkeys(name for name, _ in rows.samples(run))
    waiting: dict[str, list[FloatArray]] = {name: [] for name in there if columns is None or name in columns}
    for name, data in rows.chunks(run):
        if name not in waiting:
            continue
        waiting[name].append(np.frombuffer(data, dtype="<f8").astype(np.float64))
        # Channels come in chunks of their own length: what all have is given out, the rest waits.
        if all(waiting.values()):
            joined = {each: np.concatenate(parts) for each, parts in waiting.items()}
            count = min(column.size for column in joined.values())
            yield {each: column[:count] for each, column in joined.items()}
            waiting = {each: [column[count:]] if column.size > count else [] for each, column in joined.items()}


def last_samples(rows: CheckedRows, run: Row, count: int) -> dict[str, FloatArray]:
    """At most the last `count` of every column, not verified."""
    chunks: dict[str, list[bytes]] = {}
    lengths: dict[str, int] = {}
    # The query stays open while its generator lives, and an open query holds the log back.
    with closing(rows.chunks(run, "DESC")) as latest:
        for name, data in latest:
            if name in chunks and min(lengths.values()) >= count:
                break
            chunks.setdefault(name, []).append(data)
            lengths[name] = lengths.get(name, 0) + len(data) // 8
    return {
        name: np.frombuffer(b"".join(reversed(parts)), dtype="<f8")[-count:].astype(np.float64)
        for name, parts in reversed(chunks.items())
    }
