"""The ledger of a store: how many rows each part has, and what their checksums come to, so that none can vanish.

One row, changed in the transaction that adds or changes rows. Checksums are joined by exclusive or, so that a row can
be taken out again.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
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
    # A random name tells an older copy of this store from another store that was put in its place.
    connection.execute("INSERT INTO ledger (id, store, commits) VALUES (1, ?, 0)", (os.urandom(8).hex(),))


def enter(connection: sqlite3.Connection, changes: Iterable[Change], commits: int = 0) -> Mark:
    """Enter changes and `commits` durable transactions, in one statement; inside the transaction."""
    counts: dict[str, int] = {}
    sums: dict[str, int] = {}
    for change in changes:
        counts[change.part] = counts.get(change.part, 0) + len(change.added) - len(change.removed)
        # Exclusive or is its own inverse: a sum that goes is joined once more.
        sums[change.part] = joined((sums.get(change.part, 0), *change.added, *change.removed))
    values = [value for part, total in sums.items() for value in (counts[part], total, total)]
    return Mark(*connection.execute(_enter(tuple(sums)), (*values, commits)).fetchall()[0])


# Few different sets of parts ever change, and every event comes through here.
@cache
def _enter(parts: tuple[str, ...]) -> str:
    """SQLite has no exclusive or."""
    changed = (f"{part} = {part} + ?, {part}_sum = ({part}_sum | ?) - ({part}_sum & ?), " for part in parts)
    return f"UPDATE ledger SET {''.join(changed)}commits = commits + ? RETURNING store, commits"  # noqa: S608


def mark(connection: sqlite3.Connection) -> Mark:
    """How far the store has come."""
    return Mark(*connection.execute("SELECT store, commits FROM ledger").fetchone())


def parts(connection: sqlite3.Connection) -> Mapping[str, tuple[int, int]]:
    """Number of rows and joined checksum of each part."""
    row = connection.execute(_READ).fetchone()
    return {part: (row[2 * place], row[2 * place + 1]) for place, part in enumerate(PARTS)}


def joined(sums: Iterable[int]) -> int:
    """Checksums joined by exclusive or."""
    return reduce(xor, sums, 0)


_READ = f"SELECT {', '.join(f'{part}, {part}_sum' for part in PARTS)} FROM ledger"  # noqa: S608
