"""What can be saved of a damaged store: every run that is as it was written, and what became of the others."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Any

from rigctl.campaign.layout import layout_of
from rigctl.campaign.recording import READINGS, Header, RunRecord, flaw_of_run_id
from rigctl.campaign.store import synced
from rigctl.campaign.store.checksums import ColumnSums, row_sum
from rigctl.campaign.store.header_json import header_from_json
from rigctl.campaign.store.ledger import PARTS, Mark
from rigctl.campaign.store.samples import joined_columns
from rigctl.campaign.store.schema import first_chunk_id
from rigctl.campaign.store.sqlite_pages import Cell, Pages, Values
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.experiments import EXPERIMENTS

HEADER_LOST = "the header was lost: title, constants, channels and lasers are missing, the experiment is a guess"

_FINISHED = "finished"
# Copies of chunks multiply: without a bound a log with many copies would be tried for ever.
_MOST_WAYS = 64
# Columns of a run's row, before and since there are checksums.
_WITHOUT_SUMS, _WITH_SUMS = 8, 10
_FIRST_CHUNK = first_chunk_id(1)

Samples = Mapping[str, FloatArray]


@dataclass(frozen=True)
class _Run:
    """A copy of a run's row; `verified` is None where there are no checksums."""

    record: RunRecord
    samples_sum: str | None
    verified: bool | None
    age: int

    @property
    def rank(self) -> tuple[bool, bool, bool, int, bool]:
        """The least is to be believed: the newest of what verifies, and of two of one age the one marked invalid."""
        unfinished = self.record.state != _FINISHED
        return not self.verified, self.verified is False, unfinished, self.age, self.record.valid


class Salvage:
    """A store read without believing what does not verify; `DataError` when nothing in it looks like one.

    `header` is None when it is lost. `lost` says what there was beside `runs`, once these have been gone through.
    """

    def __init__(self, path: Path) -> None:
        self.header: Header | None = None
        self.lost: list[str] = []
        self._finished: int | None = None
        self._mark: Mark | None = None
        self._runs: dict[int, _Run] = {}
        self._chunks: dict[int, dict[int, list[Cell]]] = {}
        # Before the pages: the note may lag behind the store, but must not be read ahead of it.
        self._noted = synced.read(path)
        self._pages = Pages(path)
        for cell in self._pages.cells():
            # All rows first, as pages stand in the file in no order: a run's row may come after its samples.
            self._take(cell)
        if not self._runs and not self._chunks and self.header is None:
            raise DataError(f"{path}: nothing in it is of a campaign store; check the name")

    @property
    def guessed(self) -> str:
        """The experiment, as the runs look."""
        required = {name: _required(name) for name in EXPERIMENTS}
        for run in self._runs.values():
            # A table's run has a name of its own, and no condition that every table has.
            if run.record.run_id == READINGS:
                return next(name for name, columns in required.items() if not columns)
            for name, columns in required.items():
                if columns and columns <= run.record.conditions.keys():
                    return name
        return next(iter(EXPERIMENTS))

    def runs(self) -> Iterator[tuple[RunRecord, Samples]]:
        """The runs that verify, and those cut off as far as they came, in order, with their samples."""
        taken: set[str] = set()
        for number, run in sorted(self._runs.items()):
            samples = self._samples(number, run)
            flaw = samples if isinstance(samples, str) else ""
            if run.verified is False:
                flaw = "what is known of it is not as it was written"
            if run.record.run_id in taken:
                flaw = "another run has this name"
            if isinstance(samples, str) or flaw:
                self.lost.append(f"run {run.record.run_id}: {flaw}")
                continue
            taken.add(run.record.run_id)
            yield run.record, samples
        self.lost += self._without_row()
        if self._mark is not None and (late := synced.missing(self._noted, self._mark)):
            self.lost.append(f"the last {late} changes: runs, or marks of runs that are saved without them")

    def _without_row(self) -> Iterator[str]:
        for number in sorted(self._chunks.keys() - self._runs.keys()):
            yield f"run number {number}: samples are there, but not what they are of"
        known = sum(run.record.state == _FINISHED for run in self._runs.values())
        vanished = 0 if self._finished is None else self._finished - known
        # The ledger counts what was finished, so a row that vanished without a trace is missed too.
        if vanished > 0:
            numbers = sorted({*range(1, max(self._runs, default=0))} - self._runs.keys() - self._chunks.keys())
            yield f"finished runs of which there is nothing: {vanished}" + (
                f", of the numbers {numbers}" if numbers else ""
            )

    def _take(self, cell: Cell) -> None:
        # Ids of chunks begin at 2**32, ids of all other rows are small: no table's name is needed to tell.
        if cell.rowid >= _FIRST_CHUNK:
            self._chunks.setdefault(cell.rowid >> 32, {}).setdefault(cell.rowid, []).append(cell)
            return
        for values in self._pages.values(cell):
            # SQLite stores NULL for the column that is an alias of the row id: every table of a store has one.
            if not values or values[0] is not None:
                continue
            if (run := _run(cell, values)) is not None:
                best = self._runs.get(cell.rowid)
                if best is None or run.rank < best.rank:
                    self._runs[cell.rowid] = run
            elif self.header is None and cell.rowid == 1:
                self.header = _header(values)
            # The ledger's row, by its form. The first seen is the newest, since pages of the log come newest first.
            if self._mark is None and len(values) == 3 + 2 * len(PARTS) and _is(values[1:4], str, int, int):
                self._mark, self._finished = Mark(values[1], values[2]), values[3]

    def _samples(self, number: int, run: _Run) -> Samples | str:
        """The columns of a run, or what is wrong with them."""
        # What was cut off has no sum to hold it against.
        kept = run.samples_sum if run.record.state == _FINISHED else None
        copies = [self._copies(cells) for _, cells in sorted(self._chunks.get(number, {}).items())]
        flaw = "without samples"
        # A chunk may be in the log and in the file, or twice in the log; the sum tells which copies belong together.
        for chunks in islice(product(*copies), _MOST_WAYS):
            sums = ColumnSums()
            for name, data in chunks:
                sums.add(name, data)
            columns = sums.differing(kept) if kept is not None else []
            if not columns:
                return joined_columns(chunks)
            flaw = f"its samples are not as they were written ({', '.join(columns)})"
        return flaw

    def _copies(self, cells: list[Cell]) -> list[tuple[str, bytes]]:
        """The copies of a chunk that differ, the newest first."""
        copies = [values[1:3] for cell in cells for values in self._pages.values(cell) if _is(values[1:], str, bytes)]
        # Most copies are the same bytes: only those that differ multiply the ways to try.
        return list(dict.fromkeys((name, data) for name, data in copies)) or [("?", b"")]


def _required(experiment: str) -> set[str]:
    """The conditions that every run of an experiment has."""
    layout = layout_of(experiment)
    return {name for name, field in layout.fields.items() if field.required} if layout else set()


def _is(values: Values, *kinds: type) -> bool:
    return len(values) == len(kinds) and all(type(value) is kind for value, kind in zip(values, kinds, strict=True))


def _run(cell: Cell, values: Values) -> _Run | None:
    """A row of the table of runs; None for any other."""
    # Tables are told apart by number and types of their values; the declarations may be lost.
    if len(values) not in (_WITHOUT_SUMS, _WITH_SUMS) or not _is(values[1:8], str, str, str, str, str, int, str):
        return None
    run_id, key, step, conditions, state, valid, reason = values[1:8]
    # A row from before there were checksums cannot be verified, which is not the same as being wrong.
    samples_sum, verified = None, None
    if len(values) == _WITH_SUMS:
        samples_sum = values[8]
        total = row_sum("runs", cell.rowid, run_id, key, step, conditions, valid, reason, state, samples_sum)
        verified = total == values[9]
    # A damaged name must not lead outside the directory of the bundle.
    if verified is False and flaw_of_run_id(run_id):
        run_id = f"number {cell.rowid}"
    record = RunRecord(run_id, key, step, _read(conditions), bool(valid), reason, state)
    return _Run(record, samples_sum, verified, cell.age)


def _read(conditions: str) -> dict[str, Any]:
    try:
        return dict(json.loads(conditions))
    except (ValueError, TypeError):
        return {}


def _header(values: Values) -> Header | None:
    """The header, if this is its row and as it was written."""
    known = _is(values[1:], str) or (_is(values[1:], str, int) and row_sum("header", 1, values[1]) == values[2])
    try:
        return header_from_json(values[1]) if known else None
    except (ValueError, TypeError, KeyError):
        return None
