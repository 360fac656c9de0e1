"""One run while it is being acquired: committed chunk by chunk, durable at the end."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from rigctl.campaign.recording import RunRecord, flaw_of_column, time_column
from rigctl.campaign.store.checked_rows import CheckedRows
from rigctl.campaign.store.checksums import ColumnSums
from rigctl.campaign.store.entries import RUN_ENDED
from rigctl.campaign.store.header_json import dumps
from rigctl.campaign.store.schema import database_errors, first_chunk_id, transaction
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError

_INSERT = "INSERT INTO samples (id, name, data) VALUES (?, ?, ?)"

COMMIT_EVERY_S = 1.0
"""Of real time: what a stream of samples loses at most when its process is killed."""


class RunWriter:
    """Made by `Store.begin_run`; use it in `with`: leaving without `finish` marks the run interrupted."""

    def __init__(self, rows: CheckedRows, number: int, record: RunRecord) -> None:
        self._rows = rows
        self._number = number
        self._record = record
        self._lengths: dict[str, int] = {}
        # A run's chunks have ids of their own range, so that nobody has to ask for the next free one.
        self._next_chunk_id = first_chunk_id(number)
        self._pending: dict[str, list[bytes]] = {}
        self._sums = ColumnSums()
        self._committed_s = time.monotonic()
        self._open = True

    @property
    def run_id(self) -> str:
        """The name the run has in the store, in bundles and for the operator."""
        return self._record.run_id

    def append(self, columns: Mapping[str, FloatArray]) -> None:
        """Add a chunk to each of `columns`, shape (n,) each, in one commit.

        Columns may come at different times and in chunks of their own; at `finish` all are equally long, but for
        channels on a clock of their own, each of which is as long as its times.
        """
        self._take(columns)
        self._commit()

    def stream(self, columns: Mapping[str, FloatArray]) -> None:
        """As `append`, but committed at most once a second of real time, and at the end: for samples that pour in."""
        self._take(columns)
        if time.monotonic() - self._committed_s >= COMMIT_EVERY_S:
            self._commit()

    def _take(self, columns: Mapping[str, FloatArray]) -> None:
        self._require_open()
        chunks = {name: self._bytes(name, column) for name, column in columns.items()}
        for name, data in chunks.items():
            self._lengths[name] = self._lengths.get(name, 0) + len(data) // 8
            self._pending.setdefault(name, []).append(data)

    def _commit(self) -> None:
        """Samples are in no ledger before their run ends."""
        with database_errors(self._rows.path), transaction(self._rows.connection):
            self._insert_pending()
        self._committed_s = time.monotonic()

    def _insert_pending(self) -> None:
        rows = [
            (chunk_id, name, b"".join(chunks) if len(chunks) > 1 else chunks[0])
            for chunk_id, (name, chunks) in enumerate(self._pending.items(), self._next_chunk_id)
        ]
        for _, name, data in rows:
            self._sums.add(name, data)
        self._next_chunk_id += len(rows)
        self._pending = {}
        self._rows.connection.executemany(_INSERT, rows)

    def finish(
        self,
        conditions: Mapping[str, Any] | None = None,
        *,
        valid: bool = True,
        reason: str = "",
        rig_time_s: float | None = None,
    ) -> RunRecord:
        """End the run with `conditions` added to those it began with; on stable storage when this returns.

        `rig_time_s`: when it was over, where that is to be kept. `DataError` when columns differ in length.
        """
        self._require_open()
        self._require_equal_lengths()
        kept = dumps({**self._record.conditions, **(conditions or {})})
        # Last samples, time and verdict in one commit: no kill leaves a finished run without one of them.
        with self._rows.writing(durable=True):
            self._insert_pending()
            if rig_time_s is not None:
                self._rows.append_event(RUN_ENDED, {"key": self._record.key}, rig_time_s)
            self._end(kept, valid, reason, "finished")
        self._open = False
        # Through JSON, so that the campaign goes on with the values a replay will read.
        return replace(self._record, conditions=json.loads(kept), valid=valid, reason=reason, state="finished")

    def _bytes(self, name: str, column: FloatArray) -> bytes:
        if name not in self._lengths and (flaw := flaw_of_column(name)):
            raise DataError(f"run {self.run_id}: column name {name!r} {flaw}; rename the channel")
        # Little-endian whatever the machine: a store is read elsewhere.
        data = np.asarray(column, dtype="<f8")
        if data.ndim != 1:
            raise DataError(f"run {self.run_id}: column {name} has shape {data.shape}; append one dimension")
        return data.tobytes()

    def _require_open(self) -> None:
        if not self._open:
            raise DataError(f"run {self.run_id} is ended; begin another run")

    def _require_equal_lengths(self) -> None:
        times = {name: time_column(name) for name in self._lengths if time_column(name) in self._lengths}
        # A channel with times of its own is as long as these.
        alike = {name: length for name, length in self._lengths.items() if name not in {*times, *times.values()}}
        odd = {name for each in times.items() if self._lengths[each[0]] != self._lengths[each[1]] for name in each}
        if odd or len(set(alike.values())) > 1:
            listed = ", ".join(
                f"{name} {self._lengths[name]}" for name in self._lengths if name in odd or name in alike
            )
            raise DataError(f"run {self.run_id}: columns differ in length ({listed}); the run stays unfinished")

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._open:
            return
        self._open = False
        reason = "left unfinished" if kind is None else f"{kind.__name__}: {error}"
        try:
            # Not durable: what is lost of an attempt in a power cut is measured again anyway.
            with self._rows.writing():
                self._insert_pending()
                self._end(dumps(self._record.conditions), False, reason, "interrupted")
        # The store may be what failed in the first place; that error is under way already and says more.
        except DataError:
            if kind is None:
                raise

    def _end(self, conditions: str, valid: bool, reason: str, state: str) -> None:
        record, sums = self._record, self._sums.to_text()
        self._rows.end_run(
            self._number, record.run_id, record.key, record.step, conditions, int(valid), reason, state, sums
        )
