"""A campaign on disk: one SQLite file that keeps every step and survives being killed at any instant.

One process writes, others read at the same time (write-ahead log). A `Store` belongs to the thread that
opened it; another thread or process opens its own. Samples are 64-bit floats, kept bit for bit.
"""

from __future__ import annotations

import difflib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from rigctl.campaign.recording import READINGS, Header, RunRecord, flaw_of_run_id
from rigctl.campaign.store import ledger, schema
from rigctl.campaign.store.checked_rows import CheckedRows, Row
from rigctl.campaign.store.entries import Document, Event
from rigctl.campaign.store.header_json import dumps, header_from_json
from rigctl.campaign.store.opening import create_file, open_file
from rigctl.core.clock import utc_now
from rigctl.core.errors import DataError
from rigctl.core.interfaces import Identity

if TYPE_CHECKING:
    from rigctl.campaign.store.run_writer import RunWriter
    from rigctl.core.arrays import FloatArray

_WITH_REDUCTIONS = 2


class Store:
    """An open campaign file; `close` it, or use it in `with`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._rows = CheckedRows(connection, path)
        self._index_is_whole = False
        self.header = _header(self._rows)

    @classmethod
    def create(cls, path: Path | str, header: Header) -> Store:
        """A new campaign file, whole from the moment it is there; `DataError` if `path` exists or cannot be made."""
        path = Path(path)
        create_file(path, header)
        return cls.open(path)

    @classmethod
    def open(cls, path: Path | str, *, readonly: bool = False) -> Store:
        """An existing campaign file, brought to the current schema unless `readonly`.

        `DataError` when it is missing, not a store, or of a newer schema; `DamagedStore` when it is not what was
        written.
        """
        path = Path(path)
        connection = open_file(path, readonly=readonly)
        try:
            return cls(path, connection)
        except BaseException:
            connection.close()
            raise

    @contextmanager
    def filling(self) -> Iterator[None]:
        """For a new store that has its name only when it is whole: all is written at once, and without a log.

        Readers and writer exclude each other meanwhile. Its end brings all to stable storage.
        """
        with schema.database_errors(self.path), schema.without_log(self._connection):
            yield

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._rows.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        # Without its runs: a notebook may show a store that is closed.
        said = (self.header.title, self.header.experiment, self.header.started, str(self.path))
        return f"<p>{escape('; '.join(filter(None, said)))}</p>"

    # Runs

    def begin_run(self, key: str, step: str, conditions: Mapping[str, Any], run_id: str | None = None) -> RunWriter:
        """Begin an acquisition; `key` is the procedure's own name for it, `run_id` by default a number.

        A key that was begun before and never finished may begin again: the earlier attempt stays as
        interrupted. `DataError` when the key is finished already, or `run_id` is taken or cannot name a file.
        """
        if run_id is not None and (flaw := flaw_of_run_id(run_id)):
            raise DataError(f"run_id {run_id!r} {flaw}; give it another")
        self._require_index()
        # Not durable: a begun run that a power cut takes away has nothing that anybody counts on.
        with self._rows.writing():
            for run in self._rows.rows("runs", "WHERE key = ? AND state <> 'interrupted'", (key,)):
                if run[7] == "finished":
                    raise DataError(f"{self.path}: {key} is recorded already; give the run another key")
                self._rows.end_run(*run[:6], "cut off", "interrupted", None)
            number, name = self._next_run(run_id)
            record = RunRecord(name, key, step, dict(conditions), state="acquiring")
            self._rows.begin_run(number, name, key, step, dumps(record.conditions), 1, "", record.state, None)
        # Imported where it is used, here and below: what only asks for a store's state does not wait for numpy.
        from rigctl.campaign.store.run_writer import RunWriter

        return RunWriter(self._rows, number, record)

    def _next_run(self, run_id: str | None) -> tuple[int, str]:
        (number,) = self._connection.execute("SELECT COALESCE(MAX(number), 0) + 1 FROM runs").fetchone()
        taken = "SELECT 1 FROM runs WHERE run_id = ?"
        if run_id is None:
            # Imported runs have names of their own, which may be numbers.
            while self._connection.execute(taken, (str(number),)).fetchone():
                number += 1
            return number, str(number)
        if self._connection.execute(taken, (run_id,)).fetchone():
            raise DataError(f"{self.path}: run {run_id} exists already; give the run another run_id")
        return number, run_id

    def run_by_key(self, key: str) -> RunRecord | None:
        """The finished run the procedure calls `key`; None when there is none."""
        self._require_index()
        rows = self._rows.rows("runs", "WHERE key = ? AND state = 'finished'", (key,))
        return _record(rows[0]) if rows else None

    def runs(self, *, valid_only: bool = False, skip: int = 0) -> list[RunRecord]:
        """The finished runs in the order they were begun; those after the first `skip`, if any are skipped.

        `DamagedStore` when one is not as it was written, or, of all runs, when one is missing.
        """
        if skip:
            # A part of the table cannot be held against the ledger, which is over the whole.
            rows = self._rows.rows("runs", "WHERE state = 'finished' ORDER BY number LIMIT -1 OFFSET ?", (skip,))
        else:
            rows = self._rows.whole("runs", "ORDER BY number")
        records = (_record(row) for row in rows)
        return [run for run in records if run.state == "finished" and (run.valid or not valid_only)]

    def run(self, run_id: str) -> RunRecord | None:
        """One of the finished runs, by a look-up; None where there is no such run. `DamagedStore` as `runs`."""
        found = [_record(row) for row in self._rows_of(run_id)]
        return next((run for run in found if run.state == "finished"), None)

    def run_counts(self) -> tuple[int, int]:
        """How many runs are finished, and how many of them are declared invalid; cheap."""
        if self._rows.summed:
            with schema.database_errors(self.path):
                counted = ledger.parts(self._connection)
            return counted[ledger.FINISHED][0], counted[ledger.INVALID][0]
        rows = self._rows.read("SELECT COUNT(*), COALESCE(SUM(NOT valid), 0) FROM runs WHERE state = 'finished'")
        return int(rows[0][0]), int(rows[0][1])

    def remarked_runs(self, most: int) -> list[RunRecord]:
        """The latest finished runs with a reason, of which something was remarked or which are invalid.

        Cheap, as only the last thousand are looked at.
        """
        late = "number > (SELECT MAX(number) FROM runs) - 1000"
        chosen = f"WHERE {late} AND state = 'finished' AND reason <> '' ORDER BY number DESC LIMIT ?"
        return [_record(row) for row in self._rows.rows("runs", chosen, (most,))]

    def interrupted_runs(self) -> list[RunRecord]:
        """Runs begun and never finished: cut off or, while a campaign is at it, still `acquiring`."""
        return [_record(row) for row in self._rows.rows("runs", "WHERE state <> 'finished' ORDER BY number")]

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        """The columns of a run, each of shape (samples,), in the order they first came.

        An interrupted run's columns may differ in length. `DataError` for an unknown run, `DamagedStore` when a
        finished run's are not as they were written.
        """
        from rigctl.campaign.store.samples import joined_columns

        return joined_columns(self._rows.samples(self._run(run_id)))

    def column_names(self, run_id: str) -> tuple[str, ...]:
        """The names of a run's columns in the order they first came, without reading samples; `DataError`."""
        return self._rows.column_names(self._run(run_id))

    def sample_chunks(self, run_id: str, columns: Sequence[str] | None = None) -> Iterator[dict[str, FloatArray]]:
        """The columns of a run, all or those named, piece by piece, each piece of one length in all of them.

        What the columns of an interrupted run do not share is left out. `DataError` for an unknown run,
        `DamagedStore` as `samples`, before the first piece.
        """
        from rigctl.campaign.store.samples import sample_pieces

        return sample_pieces(self._rows, self._run(run_id), columns)

    def last_samples(self, run_id: str, count: int) -> dict[str, FloatArray]:
        """At most the last `count` of every column, not verified, without reading the whole of a long run."""
        from rigctl.campaign.store.samples import last_samples

        return last_samples(self._rows, self._run(run_id), count)

    def mark(self, run_id: str, valid: bool, reason: str) -> None:
        """Declare a finished run valid or not; its samples stay.

        `DataError` for an interrupted run and for an unknown one, naming the nearest.
        """
        run = self._run(run_id)
        if run[7] != "finished":
            raise DataError(f"{self.path}: run {run_id} is {run[7]}, it is never used; name a finished run")
        with self._rows.writing(durable=True):
            # The mark and its reason as an event, in one commit.
            self._rows.mark_run(*run[:5], int(valid), reason, *run[7:9])
            self._rows.append_event("mark", {"run_id": run_id, "valid": valid, "reason": reason}, None)

    def _run(self, run_id: str) -> Row:
        if not (rows := self._rows_of(run_id)):
            raise DataError(f"{self.path}: no run {run_id}; {self._nearest(run_id)}")
        return rows[0]

    def _rows_of(self, run_id: str) -> list[Row]:
        rows = self._rows.rows("runs", "WHERE run_id = ?", (run_id,))
        # No checksum covers the index: it may lead nowhere. One that leads to another run does not verify.
        return rows or self._rows.rows("runs", "NOT INDEXED WHERE run_id = ?", (run_id,))

    def _require_index(self) -> None:
        """Before runs are looked for by key in a file that is written: what is not found is measured again."""
        if not self._index_is_whole and not self.readonly:
            with schema.database_errors(self.path):
                schema.require_index(self._connection, self.path)
            self._index_is_whole = True

    def _nearest(self, run_id: str) -> str:
        known = [name for (name,) in self._rows.read("SELECT run_id FROM runs ORDER BY number")]
        if not known:
            return "it has no runs; measure some, and of a study of draws look at `rigctl result`"
        if known == [READINGS]:
            left_out = "a row is left out by valid = 0 in readings.csv, imported anew"
            return f"the rows of a table are one run, {READINGS}; {left_out}"
        return f"the nearest are {', '.join(difflib.get_close_matches(run_id, known, n=3, cutoff=0.0))}"

    # Events, requests, status

    def add_event(self, kind: str, data: Mapping[str, Any], rig_time_s: float | None = None) -> int:
        """Keep that something happened, now; returns its number, durable."""
        rig_time = None if rig_time_s is None else float(rig_time_s)
        with self._rows.writing(durable=True):
            return self._rows.append_event(kind, data, rig_time)

    def events(self, kind: str | None = None, *, after: int = 0) -> list[Event]:
        """All events in order, or those of one kind, or those after event number `after`.

        `DamagedStore` when one is not as it was written, or, without `after`, when one is missing.
        """
        if after:
            rows = self._rows.rows("events", "WHERE id > ? ORDER BY id", (after,))
        else:
            # All are read, whatever the kind: only the whole table can be held against the ledger.
            rows = self._rows.whole("events", "ORDER BY id")
        return [_event(row) for row in rows if kind in (None, row[3])]

    def last_event(self, kind: str) -> Event | None:
        """The latest event of a kind."""
        rows = self._rows.rows("events", "WHERE kind = ? ORDER BY id DESC LIMIT 1", (kind,))
        return _event(rows[0]) if rows else None

    def add_request(self, kind: str) -> int:
        """Ask the campaign, from any process, for something: `pause`, `abort`, `resume`."""
        # Not durable: a request counts while the campaign runs, and is forgotten afterwards.
        with self._rows.writing():
            number = self._connection.execute("INSERT INTO requests (kind) VALUES (?)", (kind,)).lastrowid
            assert number is not None
            return number

    def take_request(self) -> str | None:
        """The oldest request, so that nobody else gets it; None, at the cost of one look-up, without one."""
        open_request = "SELECT id FROM requests WHERE taken = 0 ORDER BY id LIMIT 1"
        # Looked for without a transaction: this is asked 25 times a second and must not keep writers waiting.
        if not self._rows.read(open_request):
            return None
        with self._rows.writing():
            taken = self._connection.execute(
                f"UPDATE requests SET taken = 1 WHERE id = ({open_request}) RETURNING kind"  # noqa: S608
            ).fetchone()
        return None if taken is None else str(taken[0])

    def set_status(self, status: Mapping[str, Any], *, durable: bool = False) -> None:
        """Replace what `status` returns; `durable`: on stable storage when this returns."""
        with self._rows.writing(durable=durable):
            self._rows.put("status", 1, dumps(status))

    def status(self) -> dict[str, Any]:
        """What the campaign last said of itself; empty when it has not."""
        rows = self._rows.rows("status")
        return dict(json.loads(rows[0][1])) if rows else {}

    def set_identity(self, name: str, identity: Identity | Mapping[str, Any]) -> None:
        """Keep who answered as instrument `name`."""
        data = asdict(identity) if isinstance(identity, Identity) else dict(identity)
        with self._rows.writing(durable=True):
            self._rows.replace("identities", name, dumps(data))

    def identities(self) -> dict[str, dict[str, Any]]:
        """Who answered, by instrument name."""
        # From the table itself, sorted here: by its index, which no checksum covers, rows could be hidden or doubled.
        return {row[0]: json.loads(row[1]) for row in sorted(self._rows.whole("identities", "NOT INDEXED"))}

    # Documents

    def add_document(self, kind: str, data: Mapping[str, Any]) -> int:
        """Keep something worked out from the runs; returns its number, durable."""
        with self._rows.writing(durable=True):
            return self._rows.append("documents", utc_now(), kind, dumps(data))

    def documents(self, kind: str | None = None) -> list[Document]:
        """The documents of one kind, or all, oldest first; `DamagedStore` as `events`."""
        return [
            Document(number, time, name, json.loads(data))
            for number, time, name, data, _ in self._rows.whole("documents", "ORDER BY id")
            if kind in (None, name)
        ]

    # Reductions

    def keep_reductions(self, recipe: str, blobs: Mapping[str, bytes]) -> None:
        """Keep what was worked out from samples by `recipe`, by run_id or another name; replaces what was there."""
        # Not durable: what is lost can be worked out again.
        with self._rows.writing():
            for name, data in blobs.items():
                self._rows.put("reductions", recipe, name, data)

    def reduction(self, recipe: str, name: str) -> bytes | None:
        """What is kept by `recipe` under one name; None for nothing, or for what is not as it was written."""
        if schema.schema_version(self._connection) < _WITH_REDUCTIONS:
            return None
        rows = self._rows.undamaged("reductions", "WHERE recipe = ? AND name = ?", (recipe, name))
        return next((bytes(row[2]) for row in rows), None)

    def reduced_names(self, recipe: str) -> set[str]:
        """The names of everything kept by `recipe` as it was written; none in a file from before there were any."""
        if schema.schema_version(self._connection) < _WITH_REDUCTIONS:
            return set()
        return {row[1] for row in self._rows.undamaged("reductions", "WHERE recipe = ?", (recipe,))}

    @property
    def readonly(self) -> bool:
        """Whether the file was opened for reading only."""
        return bool(self._rows.read("PRAGMA query_only")[0][0])

    def commits_seen(self) -> int:
        """A number that changes with every commit of somebody else, here or in another process."""
        return int(self._rows.read("PRAGMA data_version")[0][0])

    @property
    def has_checksums(self) -> bool:
        """False for a file made before there were any, until it is opened for writing."""
        return self._rows.summed


def _header(rows: CheckedRows) -> Header:
    headers = rows.rows("header")
    if not headers:
        raise rows.damaged("the header is missing")
    return header_from_json(headers[0][1])


def _record(row: Row) -> RunRecord:
    _, run_id, key, step, conditions, valid, reason, state, *_ = row
    return RunRecord(run_id, key, step, json.loads(conditions), bool(valid), reason, state)


def _event(row: Row) -> Event:
    number, time, rig_time_s, kind, data, *_ = row
    return Event(number, time, rig_time_s, kind, json.loads(data))
