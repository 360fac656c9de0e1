"""A campaign on disk: one SQLite file that keeps every step and survives being killed at any instant.

One process writes, others read at the same time (write-ahead log). A `Store` belongs to the thread that
opened it; another thread or process opens its own. Samples are 64-bit floats, kept bit for bit.
"""

from __future__ import annotations

import difflib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from rigctl.campaign import schema
from rigctl.campaign.header_json import dumps, header_from_json, header_to_json
from rigctl.campaign.recording import Header, RunRecord, flaw_of_run_id
from rigctl.campaign.run_writer import RunWriter
from rigctl.errors import DataError
from rigctl.interfaces import FloatArray, Identity

_RUN = "SELECT run_id, key, step, conditions, valid, reason, state FROM runs"
_CUT_OFF = "UPDATE runs SET state = 'interrupted', reason = 'cut off' WHERE key = ? AND state = 'acquiring'"
_WITH_REDUCTIONS = 2
_ENDS = {"ASC": "first on", "DESC": "last back"}


@dataclass(frozen=True)
class Event:
    """Something that happened: `time` is UTC, ISO 8601; `rig_time_s` where the rig's clock was known."""

    id: int
    time: str
    rig_time_s: float | None
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True)
class Document:
    """Something worked out from the runs: a model version, a fit, a diagnosis."""

    id: int
    time: str
    kind: str
    data: dict[str, Any]


class Store:
    """An open campaign file; `close` it, or use it in `with`."""

    def __init__(self, path: Path, connection: sqlite3.Connection, header: Header) -> None:
        self.path = path
        self.header = header
        self._connection = connection

    @classmethod
    def create(cls, path: Path, header: Header) -> Store:
        """A new campaign file, whole from the moment it is there; `DataError` if `path` exists or cannot be made."""
        partial = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            os.close(os.open(partial, os.O_CREAT | os.O_TRUNC, 0o644))
            with schema.database_errors(path), closing(schema.connect(partial, readonly=False)) as connection:
                schema.prepare_for_writing(connection)
                with schema.transaction(connection, durable=True):
                    connection.execute(f"PRAGMA application_id = {schema.APPLICATION_ID}")
                    schema.migrate(connection, schema.MIGRATIONS)
                    connection.execute("INSERT INTO header VALUES (1, ?)", (header_to_json(header),))
            _publish(partial, path)
        except FileExistsError as error:
            raise DataError(f"{path}: exists already; name another store, or `rigctl resume` this one") from error
        except OSError as error:
            raise DataError(f"{path}: cannot be made ({error.strerror}); check the directory") from error
        finally:
            partial.unlink(missing_ok=True)
        return cls.open(path)

    @classmethod
    def open(cls, path: Path, *, readonly: bool = False, salvage: bool = False) -> Store:
        """An existing campaign file, brought to the current schema unless `readonly`.

        `salvage` reads on in a file that was cut short. `DataError` when it is missing, not a store, or of a
        newer schema.
        """
        if not path.is_file():
            raise DataError(f"{path}: no such store; check the name, or make one with `rigctl run` or `import`")
        connection = schema.connect(path, readonly=readonly)
        try:
            with schema.database_errors(path):
                connection.execute(f"PRAGMA query_only = {int(readonly)}")
                if salvage:
                    # Lets SQLite read a file that is shorter than its first page says.
                    connection.execute("PRAGMA writable_schema = ON")
                schema.require_store(connection, path)
                schema.bring_up(connection, path, readonly=readonly)
                header = connection.execute("SELECT data FROM header").fetchone()
            return cls(path, connection, header_from_json(header[0]))
        except BaseException:
            connection.close()
            raise

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Runs

    def begin_run(self, key: str, step: str, conditions: Mapping[str, Any], run_id: str | None = None) -> RunWriter:
        """Begin an acquisition; `key` is the procedure's own name for it, `run_id` by default a number.

        A key that was begun before and never finished may begin again: the earlier attempt stays as
        interrupted. `DataError` when the key is finished already, or `run_id` is taken or cannot name a file.
        """
        if run_id is not None and (flaw := flaw_of_run_id(run_id)):
            raise DataError(f"run_id {run_id!r} {flaw}; give it another")
        with self._writing():
            if self._connection.execute("SELECT 1 FROM runs WHERE key = ? AND state = 'finished'", (key,)).fetchone():
                raise DataError(f"{self.path}: {key} is recorded already; give the run another key")
            self._connection.execute(_CUT_OFF, (key,))
            number, name = self._next_run(run_id)
            record = RunRecord(name, key, step, dict(conditions), state="acquiring")
            self._connection.execute(
                "INSERT INTO runs (number, run_id, key, step, conditions) VALUES (?, ?, ?, ?, ?)",
                (number, name, key, step, dumps(record.conditions)),
            )
        return RunWriter(self._connection, self.path, number, record)

    def _next_run(self, run_id: str | None) -> tuple[int, str]:
        (number,) = self._connection.execute("SELECT COALESCE(MAX(number), 0) + 1 FROM runs").fetchone()
        taken = "SELECT 1 FROM runs WHERE run_id = ?"
        if run_id is None:
            while self._connection.execute(taken, (str(number),)).fetchone():
                number += 1
            return number, str(number)
        if self._connection.execute(taken, (run_id,)).fetchone():
            raise DataError(f"{self.path}: run {run_id} exists already; give the run another run_id")
        return number, run_id

    def run_by_key(self, key: str) -> RunRecord | None:
        """The finished run the procedure calls `key`; None when there is none."""
        found = self._records("WHERE key = ? AND state = 'finished'", (key,))
        return found[0] if found else None

    def runs(self, *, valid_only: bool = False, skip: int = 0) -> list[RunRecord]:
        """The finished runs in the order they were begun, without the first `skip`."""
        wanted = f"WHERE state = 'finished'{' AND valid' if valid_only else ''} ORDER BY number LIMIT -1 OFFSET ?"
        return self._records(wanted, (skip,))

    def run_counts(self) -> tuple[int, int]:
        """How many runs are finished, and how many of them are declared invalid; cheap."""
        found = self._read("SELECT COUNT(*), COALESCE(SUM(NOT valid), 0) FROM runs WHERE state = 'finished'")
        return int(found[0][0]), int(found[0][1])

    def interrupted_runs(self) -> list[RunRecord]:
        """Runs begun and never finished: cut off or, while a campaign is at it, still `acquiring`."""
        return self._records("WHERE state <> 'finished' ORDER BY number")

    def salvageable_runs(self, lost: list[str]) -> Iterator[RunRecord]:
        """Every run a damaged store still knows, finished or not, from both ends; `lost` gains what it does not."""
        seen: set[str] = set()
        for direction in ("ASC", "DESC"):
            try:
                for row in self._connection.execute(f"{_RUN} ORDER BY number {direction}"):
                    if row[0] in seen:
                        return
                    record = _record(row)
                    seen.add(record.run_id)
                    yield record
            except (sqlite3.DatabaseError, ValueError) as error:
                lost.append(f"{self.path}: no more runs from the {_ENDS[direction]} ({error})")
            else:
                return

    def samples(self, run_id: str) -> dict[str, FloatArray]:
        """The columns of a run, each of shape (samples,), in the order they first came.

        An interrupted run's columns may differ in length. `DataError` for an unknown run.
        """
        number = self._number(run_id)
        chunks: dict[str, list[bytes]] = {}
        query = "SELECT name, data FROM samples WHERE id >= ? AND id < ? ORDER BY id"
        for name, data in self._read(query, (schema.first_chunk_id(number), schema.first_chunk_id(number + 1))):
            chunks.setdefault(name, []).append(data)
        return {
            name: np.frombuffer(bytearray(b"".join(parts)), dtype="<f8").astype(np.float64, copy=False)
            for name, parts in chunks.items()
        }

    def sample_chunks(self, run_id: str) -> Iterator[dict[str, FloatArray]]:
        """The columns of a run piece by piece, as they were written, each piece of one length in all columns.

        What the columns of an interrupted run do not share is left out. `DataError` for an unknown run.
        """
        number = self._number(run_id)
        bounds = (schema.first_chunk_id(number), schema.first_chunk_id(number + 1))
        names = [
            name
            for (name,) in self._read(
                "SELECT name FROM samples WHERE id >= ? AND id < ? GROUP BY name ORDER BY MIN(id)", bounds
            )
        ]
        waiting: dict[str, list[FloatArray]] = {name: [] for name in names}
        with schema.database_errors(self.path):
            rows = self._connection.execute(
                "SELECT name, data FROM samples WHERE id >= ? AND id < ? ORDER BY id", bounds
            )
            for name, data in rows:
                waiting[name].append(np.frombuffer(data, dtype="<f8").astype(np.float64))
                if all(waiting.values()):
                    columns = {each: np.concatenate(parts) for each, parts in waiting.items()}
                    count = min(column.size for column in columns.values())
                    yield {each: column[:count] for each, column in columns.items()}
                    waiting = {
                        each: [column[count:]] if column.size > count else [] for each, column in columns.items()
                    }

    def last_samples(self, run_id: str, count: int) -> dict[str, FloatArray]:
        """At most the last `count` of every column, as `samples`, without reading the whole of a long run."""
        number = self._number(run_id)
        query = "SELECT name, data FROM samples WHERE id >= ? AND id < ? ORDER BY id DESC"
        chunks: dict[str, list[bytes]] = {}
        lengths: dict[str, int] = {}
        with schema.database_errors(self.path):
            rows = self._connection.execute(query, (schema.first_chunk_id(number), schema.first_chunk_id(number + 1)))
            for name, data in rows:
                if name in chunks and min(lengths.values()) >= count:
                    break
                chunks.setdefault(name, []).append(data)
                lengths[name] = lengths.get(name, 0) + len(data) // 8
            rows.close()
        return {
            name: np.frombuffer(b"".join(reversed(parts)), dtype="<f8")[-count:].astype(np.float64)
            for name, parts in reversed(chunks.items())
        }

    def mark(self, run_id: str, valid: bool, reason: str) -> None:
        """Declare a finished run valid or not; its samples stay.

        `DataError` for an interrupted run and for an unknown one, naming the nearest.
        """
        number = self._number(run_id, finished=True)
        with self._writing(durable=True):
            self._connection.execute(
                "UPDATE runs SET valid = ?, reason = ? WHERE number = ?", (int(valid), reason, number)
            )
            self._insert_event("mark", {"run_id": run_id, "valid": valid, "reason": reason}, None)

    def _number(self, run_id: str, *, finished: bool = False) -> int:
        found = self._read("SELECT number, state FROM runs WHERE run_id = ?", (run_id,))
        if not found:
            raise DataError(f"{self.path}: no run {run_id}; {self._nearest(run_id)}")
        number, state = found[0]
        if finished and state != "finished":
            raise DataError(f"{self.path}: run {run_id} is {state}, it is never used; name a finished run")
        return int(number)

    def _nearest(self, run_id: str) -> str:
        known = [name for (name,) in self._read("SELECT run_id FROM runs ORDER BY number")]
        if not known:
            return "it has no runs yet"
        return f"the nearest are {', '.join(difflib.get_close_matches(run_id, known, n=3, cutoff=0.0))}"

    def _records(self, clause: str, values: Sequence[object] = ()) -> list[RunRecord]:
        return [_record(row) for row in self._read(f"{_RUN} {clause}", values)]

    # Events, requests, status

    def add_event(self, kind: str, data: Mapping[str, Any], rig_time_s: float | None = None) -> int:
        """Keep that something happened, now; returns its number."""
        with self._writing():
            return self._insert_event(kind, data, rig_time_s)

    def events(self, kind: str | None = None, *, after: int = 0) -> list[Event]:
        """All events in order, or those of one kind, or those after event number `after`."""
        wanted = "id > ? AND (? IS NULL OR kind = ?)"
        query = f"SELECT id, time, rig_time_s, kind, data FROM events WHERE {wanted} ORDER BY id"  # noqa: S608
        return [
            Event(number, time, rig_time_s, name, json.loads(data))
            for number, time, rig_time_s, name, data in self._read(query, (after, kind, kind))
        ]

    def _insert_event(self, kind: str, data: Mapping[str, Any], rig_time_s: float | None) -> int:
        return self._insert(
            "INSERT INTO events (time, rig_time_s, kind, data) VALUES (?, ?, ?, ?)",
            (_now(), rig_time_s, kind, dumps(data)),
        )

    def add_request(self, kind: str) -> int:
        """Ask the campaign, from any process, for something: `pause`, `abort`, `resume`."""
        with self._writing():
            return self._insert("INSERT INTO requests (kind) VALUES (?)", (kind,))

    def take_request(self) -> str | None:
        """The oldest request, so that nobody else gets it; None, at the cost of one look-up, without one."""
        open_request = "SELECT id FROM requests WHERE taken = 0 ORDER BY id LIMIT 1"
        if not self._read(open_request):
            return None
        with self._writing():
            found = self._connection.execute(
                f"UPDATE requests SET taken = 1 WHERE id = ({open_request}) RETURNING kind"  # noqa: S608
            ).fetchone()
        return None if found is None else str(found[0])

    def set_status(self, status: Mapping[str, Any]) -> None:
        """Replace what `status` returns."""
        with self._writing():
            self._connection.execute("INSERT OR REPLACE INTO status VALUES (1, ?)", (dumps(status),))

    def status(self) -> dict[str, Any]:
        """What the campaign last said of itself; empty when it has not."""
        found = self._read("SELECT data FROM status")
        return dict(json.loads(found[0][0])) if found else {}

    def set_identity(self, name: str, identity: Identity | Mapping[str, Any]) -> None:
        """Keep who answered as instrument `name`."""
        data = asdict(identity) if isinstance(identity, Identity) else dict(identity)
        with self._writing():
            self._connection.execute("INSERT OR REPLACE INTO identities VALUES (?, ?)", (name, dumps(data)))

    def identities(self) -> dict[str, dict[str, Any]]:
        """Who answered, by instrument name."""
        found = self._read("SELECT name, data FROM identities ORDER BY name")
        return {name: json.loads(data) for name, data in found}

    # Documents

    def add_document(self, kind: str, data: Mapping[str, Any]) -> int:
        """Keep something worked out from the runs; returns its number, durable."""
        with self._writing(durable=True):
            return self._insert(
                "INSERT INTO documents (time, kind, data) VALUES (?, ?, ?)", (_now(), kind, dumps(data))
            )

    def documents(self, kind: str | None = None) -> list[Document]:
        """The documents of one kind, or all, oldest first."""
        query = "SELECT id, time, kind, data FROM documents WHERE ? IS NULL OR kind = ? ORDER BY id"
        return [
            Document(number, time, name, json.loads(data))
            for number, time, name, data in self._read(query, (kind, kind))
        ]

    # Reductions

    def keep_reductions(self, recipe: str, blobs: Mapping[str, bytes]) -> None:
        """Keep what was worked out from samples by `recipe`, by run_id or another name; replaces what was there."""
        with self._writing():
            self._connection.executemany(
                "INSERT OR REPLACE INTO reductions (recipe, name, data) VALUES (?, ?, ?)",
                [(recipe, name, data) for name, data in blobs.items()],
            )

    def reduction(self, recipe: str, name: str) -> bytes | None:
        """What is kept by `recipe` under one name; None for nothing."""
        found = self._read("SELECT data FROM reductions WHERE recipe = ? AND name = ?", (recipe, name))
        return bytes(found[0][0]) if found else None

    def reduced_names(self, recipe: str) -> set[str]:
        """The names of everything kept by `recipe`; none in a file from before there were any."""
        if schema.schema_version(self._connection) < _WITH_REDUCTIONS:
            return set()
        return {name for (name,) in self._read("SELECT name FROM reductions WHERE recipe = ?", (recipe,))}

    @property
    def readonly(self) -> bool:
        """Whether the file was opened for reading only."""
        return bool(self._read("PRAGMA query_only")[0][0])

    def _read(self, query: str, values: Sequence[object] = ()) -> list[Any]:
        with schema.database_errors(self.path):
            return self._connection.execute(query, values).fetchall()

    @contextmanager
    def _writing(self, *, durable: bool = False) -> Iterator[None]:
        with schema.database_errors(self.path), schema.transaction(self._connection, durable=durable):
            yield

    def _insert(self, statement: str, values: Sequence[object]) -> int:
        number = self._connection.execute(statement, values).lastrowid
        assert number is not None
        return number


def _publish(partial: Path, path: Path) -> None:
    """Give a finished file its name; `FileExistsError` rather than over a store that somebody made meanwhile."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError as error:  # a file system without hard links, where the name can only be looked for
        if path.exists():
            raise FileExistsError(path) from error
        partial.rename(path)


def _record(row: tuple[Any, ...]) -> RunRecord:
    run_id, key, step, conditions, valid, reason, state = row
    return RunRecord(run_id, key, step, json.loads(conditions), bool(valid), reason, state)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
