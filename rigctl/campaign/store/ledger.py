"""The ledger of a store: how many rows each part has, and what their checksums come to, so that none can vanish.

One row, changed in the transaction that adds or changes rows. Checksums are joined by exclusive or, so that a row can
be taken out again.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor

FINISHED, INVALID, EVENTS, IDENTITIES, DOCUMENTS = "finished", "invalid", "events", "identities", "documents"
PARTS = (FINISHED, INVALID, EVENTS, IDENTITIES, DOCUMENTS)

TABLE = (
    "CREATE TABLE ledger (id INTEGER PRIMARY KEY CHECK (id = 1), store TEXT NOT NULL, commits INTEGER NOT NULL, "
    + (", ".join(f"{part} INTEGER NOT NULL DEFAULT 0, {part}_sum INTEGER NOT NULL DEFAULT 0" for part in PARTS) + ")")
)


@dataclass(frozen=True)
class Mark:
    """How far a store has come: its random name, and how many durable transactions it has seen."""

    store: str
    commits: int


@dataclass(frozen=True)
class Change:
    """Rows of a part, by their checksums, that come and go."""

    part: str
    added: Sequence[int]
    removed: Sequence[int] = ()


def open_ledger(connection: sqlite3.Connection) -> None:
    """The ledger of a store that has no rows yet."""
    connection.execute("INSERT INTO ledger (id, store, commits) VALUES (1, ?, 0)", (os.urandom(8).hex(),))


def enter(connection: sqlite3.Connection, changes: Iterable[Change]) -> None:
    """Enter changes; inside a transaction."""
    for change in changes:
        total = joined((*change.added, *change.removed))
        connection.execute(_ENTER[change.part], (len(change.added) - len(change.removed), total, total))


def mark(connection: sqlite3.Connection) -> Mark:
    """How far the store has come."""
    return Mark(*connection.execute("SELECT store, commits FROM ledger").fetchone())


def count(connection: sqlite3.Connection) -> Mark:
    """Count a durable transaction, inside it."""
    return Mark(*connection.execute("UPDATE ledger SET commits = commits + 1 RETURNING store, commits").fetchall()[0])


def parts(connection: sqlite3.Connection) -> Mapping[str, tuple[int, int]]:
    """Number of rows and joined checksum of each part."""
    row = connection.execute(_READ).fetchone()
    return {part: (row[2 * place], row[2 * place + 1]) for place, part in enumerate(PARTS)}


def joined(sums: Iterable[int]) -> int:
    """Checksums joined by exclusive or."""
    return reduce(xor, sums, 0)


_READ = f"SELECT {', '.join(f'{part}, {part}_sum' for part in PARTS)} FROM ledger"  # noqa: S608
_ENTER = {
    # SQLite has no exclusive or.
    part: f"UPDATE ledger SET {part} = {part} + ?, "  # noqa: S608
    f"{part}_sum = ({part}_sum | ?) - ({part}_sum & ?)"
    for part in PARTS
}
