"""Rows of a store with their checksums: written with them, read against them."""

from __future__ import annotations

import sqlite3
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rigctl.campaign.store import ledger, synced
from rigctl.campaign.store.checksums import ColumnSums, row_sum
from rigctl.campaign.store.header_json import dumps
from rigctl.campaign.store.ledger import Change
from rigctl.campaign.store.schema import database_errors, first_chunk_id, has_checksums, snapshot, transaction
from rigctl.core.clock import utc_now
from rigctl.core.errors import DamagedStore, DataError

COLUMNS = {
    "header": ("id", "data"),
    "runs": ("number", "run_id", "key", "step", "conditions", "valid", "reason", "state", "samples_sum"),
    "events": ("id", "time", "rig_time_s", "kind", "data"),
    "status": ("id", "data"),
    "identities": ("name", "data"),
    "documents": ("id", "time", "kind", "data"),
    "reductions": ("recipe", "name", "data"),
}
"""What a row's checksum is over, its key first."""

# Places in a run's row; the checksum is last.
_KEY, _CONDITIONS, _VALID, _STATE, _SUM = 2, 4, 5, 7, -1
_CHUNKS = "SELECT name, data FROM samples WHERE id >= ? AND id < ? ORDER BY id"
_PUT = {
    table: f"INSERT OR REPLACE INTO {table} ({', '.join(names)}, sum) VALUES ({'?, ' * len(names)}?)"  # noqa: S608
    for table, names in COLUMNS.items()
}
_BEGIN_RUN = _PUT["runs"].replace(" OR REPLACE", "")
_WRITE_RUN = f"UPDATE runs SET {' = ?, '.join(COLUMNS['runs'][_CONDITIONS:])} = ?, sum = ? WHERE number = ?"  # noqa: S608
_FINISHED_KEY = "SELECT 1 FROM runs WHERE key = ? AND state = 'finished'"

Row = tuple[Any, ...]


class CheckedRows:
    """The tables of an open store; `summed` unless it was made before there were checksums and is only read."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.connection = connection
        self.path = path
        self.summed = has_checksums(connection)
        self._note = synced.Note(path)
        self._changes: list[Change] = []

    def read(self, query: str, values: Sequence[object] = ()) -> list[Any]:
        """The rows of any query, nothing verified."""
        with database_errors(self.path):
            return self.connection.execute(query, values).fetchall()

    def rows(self, table: str, clause: str = "", values: Sequence[object] = ()) -> list[Row]:
        """Rows as `COLUMNS` has them and their sum, each verified; `DamagedStore`."""
        rows = self.read(self._query(table, clause), values)
        for row in rows:
            if not self._verifies(table, row):
                raise self.damaged(f"{_name(table, row)} is not as it was written")
        return rows

    def undamaged(self, table: str, clause: str = "", values: Sequence[object] = ()) -> Iterator[Row]:
        """As `rows`, one by one, leaving out those that are not as they were written."""
        with database_errors(self.path):
            for row in self.connection.execute(self._query(table, clause), values):
                if self._verifies(table, row):
                    yield row

    def _verifies(self, table: str, row: Row) -> bool:
        return not self.summed or row_sum(table, *row[:_SUM]) == row[_SUM]

    def _query(self, table: str, clause: str) -> str:
        return f"SELECT {self._columns(table)} FROM {table} {clause}"  # noqa: S608

    def whole(self, table: str, clause: str = "") -> list[Row]:
        """As `rows`, of a whole table, none of them missing."""
        # Rows and ledger of one instant, or a commit in between would look like damage.
        with database_errors(self.path), snapshot(self.connection):
            rows = self.rows(table, clause)
            kept = ledger.parts(self.connection) if self.summed else {}
        for part, sums in _sums(table, rows).items():
            if part in kept and kept[part] != (len(sums), ledger.joined(sums)):
                raise self.damaged(
                    f"rows of the table {table} are missing, there twice, or not entered in the ledger"
                )
        return rows

    def chunks(self, run: Row, order: str = "ASC") -> Generator[tuple[str, bytes], None, None]:
        """The chunks of a run with the names of their columns, as they are, nothing verified but their form."""
        query = f"SELECT name, data FROM samples WHERE id >= ? AND id < ? ORDER BY id {order}"  # noqa: S608
        with database_errors(self.path):
            for name, data in self.connection.execute(query, chunk_ids(run[0])):
                # SQLite keeps any type in any column, and damage can change the type.
                if type(name) is not str or type(data) is not bytes or len(data) % 8:
                    raise self._damaged_run(run, "a chunk")
                yield name, data

    def column_names(self, run: Row) -> tuple[str, ...]:
        """The names of a run's columns in the order they first came, nothing verified."""
        query = "SELECT name FROM samples WHERE id >= ? AND id < ? GROUP BY name ORDER BY MIN(id)"
        return tuple(str(name) for (name,) in self.read(query, chunk_ids(run[0])))

    def samples(self, run: Row) -> Iterator[tuple[str, bytes]]:
        """As `chunks`; at their end `DamagedStore` unless those of a finished run are as they were written."""
        # Taken up as the chunks pass: samples of days are not held in memory to be verified.
        sums = ColumnSums()
        yield from sums.taking(self.chunks(run))
        if self.summed and run[_STATE] == "finished" and (columns := sums.differing(run[_SUM - 1])):
            raise self._damaged_run(run, ", ".join(columns))

    def _damaged_run(self, run: Row, what: str) -> DamagedStore:
        return DamagedStore(
            f"{self.path}: the samples of run {run[1]} are not as they were written ({what}); "
            f"leave the run out with `rigctl mark {self.path} {run[1]} REASON --invalid`"
        )

    def damaged(self, what: str) -> DamagedStore:
        """The error for part of the store."""
        return DamagedStore(f"{self.path}: {what}; save all that verifies with `rigctl export --salvage`")

    @contextmanager
    def writing(self, *, durable: bool = False) -> Iterator[None]:
        """One transaction; `durable`: on stable storage when it has ended, and noted beside the store."""
        self._changes = []
        with database_errors(self.path):
            with transaction(self.connection, durable=durable):
                yield
                # A transaction that adds no counted row leaves the ledger's page alone.
                if self._changes or durable:
                    # Inside the transaction: rows and ledger change together or not at all.
                    mark = ledger.enter(self.connection, self._changes, commits=int(durable))
            # Only after the commit has been synced, so that the note is never ahead of the store: a part of a larger
            # transaction is not.
            if durable and not self.connection.in_transaction:
                self._note.write(mark)

    def put(self, table: str, *values: Any) -> int:
        """Insert a row, or replace the one with its key; returns its checksum, which is entered nowhere."""
        total = row_sum(table, *values)
        self.connection.execute(_PUT[table], (*values, total))
        return total

    def begin_run(self, *run: Any) -> None:
        """Insert a run that is acquiring: it is entered in the ledger when it has finished."""
        self.connection.execute(_BEGIN_RUN, (*run, row_sum("runs", *run)))

    def append(self, table: str, *values: Any) -> int:
        """Insert a row under the next number, which is returned, for the ledger too; inside `writing`."""
        # The number is part of what the checksum is over, so it has to be known before the row is inserted.
        (number,) = self.connection.execute(f"SELECT COALESCE(MAX(id), 0) + 1 FROM {table}").fetchone()  # noqa: S608
        self._changes.append(Change(table, [self.put(table, number, *values)]))
        return int(number)

    def append_event(self, kind: str, data: Mapping[str, Any], rig_time_s: float | None) -> int:
        """Insert an event of now under the next number, which is returned."""
        return self.append("events", utc_now(), rig_time_s, kind, dumps(data))

    def replace(self, table: str, *values: Any) -> None:
        """Insert a row in place of the one with its key, if there is one, for the ledger too; inside `writing`."""
        # Also verifies it: a damaged row must not be replaced by one that looks right.
        before = self.rows(table, f"WHERE {COLUMNS[table][0]} = ?", (values[0],))
        after = (*values, self.put(table, *values))
        self._changes += _changes(table, [after], before)

    def end_run(self, *run: Any) -> None:
        """Write how a run ended that was acquiring; `DataError` when its key has finished meanwhile."""
        # The index of keys is not unique, so that a run's end need not change it; hence the question.
        if self.connection.execute(_FINISHED_KEY, (run[_KEY],)).fetchone() is not None:
            raise DataError(f"{self.path}: two programs write the same run ({run[_KEY]}); stop one of them")
        self._write_run(run, [])

    def mark_run(self, *run: Any) -> None:
        """Write what the row of a finished run says from now on."""
        self._write_run(run, self.rows("runs", "WHERE number = ?", (run[0],)))

    def _write_run(self, run: Row, before: Sequence[Row]) -> None:
        after = (*run, row_sum("runs", *run))
        self.connection.execute(_WRITE_RUN, (*after[_CONDITIONS:], run[0]))
        self._changes += _changes("runs", [after], before)

    def close(self) -> None:
        """Close the file, and remove the note when nothing is left that it could be needed for."""
        self._note.close()
        self.connection.close()
        synced.clear(self.path)

    def _columns(self, table: str) -> str:
        names = (*COLUMNS[table], "sum")
        if self.summed:
            return ", ".join(names)
        # A file from before checksums is read as if it had empty columns for them.
        return ", ".join("NULL" if name in {"samples_sum", "sum"} else name for name in names)


def seal(connection: sqlite3.Connection) -> None:
    """Give everything in a file that has no checksums yet those of what is there; inside a transaction."""
    ledger.open_ledger(connection)
    # Checksums of a run that is still written are made when it ends.
    for run in connection.execute("SELECT number FROM runs WHERE state <> 'acquiring'").fetchall():
        sums = ColumnSums()
        for name, data in connection.execute(_CHUNKS, chunk_ids(*run)):
            sums.add(name, data)
        connection.execute("UPDATE runs SET samples_sum = ? WHERE number = ?", (sums.to_text(), *run))
    for table, columns in COLUMNS.items():
        query = f"SELECT rowid, {', '.join(columns)} FROM {table}"  # noqa: S608
        for rowid, *values in connection.execute(query).fetchall():
            total = row_sum(table, *values)
            connection.execute(f"UPDATE {table} SET sum = ? WHERE rowid = ?", (total, rowid))  # noqa: S608
            ledger.enter(connection, _changes(table, [(*values, total)]))


def chunk_ids(number: int) -> tuple[int, int]:
    """The ids of a run's chunks in `samples`: from the first of these to before the second."""
    return first_chunk_id(number), first_chunk_id(number + 1)


def _sums(table: str, rows: Sequence[Row]) -> dict[str, list[int]]:
    """The checksums of rows by the part of the ledger in which they are entered."""
    if table != "runs":
        return {table: [row[_SUM] for row in rows]} if table in ledger.PARTS else {}
    finished = [row for row in rows if row[_STATE] == "finished"]
    return {
        ledger.FINISHED: [row[_SUM] for row in finished],
        ledger.INVALID: [row[_SUM] for row in finished if not row[_VALID]],
    }


def _changes(table: str, added: Sequence[Row], removed: Sequence[Row] = ()) -> list[Change]:
    """What to enter when these rows come and those go."""
    comes, goes = _sums(table, added), _sums(table, removed)
    return [Change(part, sums, goes[part]) for part, sums in comes.items() if sums or goes[part]]


def _name(table: str, row: Row) -> str:
    if table == "runs":
        return f"run {row[1]}"
    return f"the {table}" if table in {"header", "status"} else f"row {row[0]} of the table {table}"
