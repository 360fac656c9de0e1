"""The tables of a campaign file, how an older file becomes a newer one, and SQLite's errors in our words."""

from __future__ import annotations

import resource
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path

from rigctl.campaign.store import ledger, place
from rigctl.core.errors import DamagedStore, DataError, StorageError

# "rigc" in ASCII: SQLite keeps this number in the file's header for programs to know their own.
APPLICATION_ID = 0x72696763
BUSY_TIMEOUT_S = 10.0

Migration = Sequence[str]

MIGRATIONS: tuple[Migration, ...] = (
    (
        "CREATE TABLE header (id INTEGER PRIMARY KEY CHECK (id = 1), data TEXT NOT NULL)",
        """CREATE TABLE runs (
            number INTEGER PRIMARY KEY,
            run_id TEXT NOT NULL UNIQUE,
            key TEXT NOT NULL,
            step TEXT NOT NULL,
            conditions TEXT NOT NULL,
            state TEXT NOT NULL DEFAULT 'acquiring' CHECK (state IN ('acquiring', 'interrupted', 'finished')),
            valid INTEGER NOT NULL DEFAULT 1,
            reason TEXT NOT NULL DEFAULT ''
        )""",
        "CREATE UNIQUE INDEX finished_runs ON runs (key) WHERE state = 'finished'",
        "CREATE INDEX acquiring_runs ON runs (key) WHERE state = 'acquiring'",
        # The id is `first_chunk_id(number)` + the chunk's place in the run: in order, and no index to keep up.
        "CREATE TABLE samples (id INTEGER PRIMARY KEY, name TEXT NOT NULL, data BLOB NOT NULL)",
        """CREATE TABLE events (
            id INTEGER PRIMARY KEY,
            time TEXT NOT NULL,
            rig_time_s REAL,
            kind TEXT NOT NULL,
            data TEXT NOT NULL
        )""",
        """CREATE TABLE requests (
            id INTEGER PRIMARY KEY,
            kind TEXT NOT NULL,
            taken INTEGER NOT NULL DEFAULT 0
        )""",
        "CREATE INDEX open_requests ON requests (id) WHERE taken = 0",
        "CREATE TABLE status (id INTEGER PRIMARY KEY CHECK (id = 1), data TEXT NOT NULL)",
        "CREATE TABLE identities (name TEXT PRIMARY KEY, data TEXT NOT NULL)",
        """CREATE TABLE documents (
            id INTEGER PRIMARY KEY,
            time TEXT NOT NULL,
            kind TEXT NOT NULL,
            data TEXT NOT NULL
        )""",
        "CREATE INDEX documents_by_kind ON documents (kind)",
    ),
    (
        # Worked out from samples, by `recipe`; may be deleted and worked out again.
        """CREATE TABLE reductions (
            id INTEGER PRIMARY KEY,
            recipe TEXT NOT NULL,
            name TEXT NOT NULL,
            data BLOB NOT NULL,
            UNIQUE (recipe, name)
        )""",
    ),
    (
        # A checksum in every row that is read again, and the ledger of all of them.
        *(
            f"ALTER TABLE {table} ADD COLUMN sum INTEGER"
            for table in ("header", "events", "status", "identities", "documents", "reductions")
        ),
        "ALTER TABLE runs ADD COLUMN samples_sum TEXT",
        "ALTER TABLE runs ADD COLUMN sum INTEGER",
        ledger.TABLE,
        # A run's end changes no index: beside its row the ledger is all that is written.
        "DROP INDEX finished_runs",
        "DROP INDEX acquiring_runs",
        "CREATE INDEX runs_by_key ON runs (key)",
    ),
)
"""Step i takes a file of schema i to schema i + 1; schema 0 is an empty file."""

_WITH_CHECKSUMS = 3

READABLE_FROM = 1
"""Of this schema on, a file can be read without being brought up: later steps only add tables for what can be
worked out again, and checksums."""


def first_chunk_id(number: int) -> int:
    """Where the chunks of run `number` begin in `samples`; those of the next run begin 2**32 later."""
    return number << 32


_SIGNS_OF_DAMAGE = ("no such column", "no such table", "already exists", "duplicate column", "UTF-8", "file format")
"""What SQLite says of statements that are right when the file they are about is not."""


class database_errors:  # noqa: N801 - used as a function
    """Turn what SQLite raises about the file into a `DataError` that names it and the mend.

    No generator, which would take three times as long: every row that is appended comes through here.
    """

    __slots__ = ("_path",)

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, sqlite3.DatabaseError):
            raise _as_data_error(self._path, error) from error


def _as_data_error(path: Path, error: sqlite3.DatabaseError) -> DataError | DamagedStore:
    if isinstance(error, sqlite3.OperationalError):
        if any(sign in str(error) for sign in _SIGNS_OF_DAMAGE):
            return _damaged(path, str(error))
        return StorageError(f"{path}: {_operational(path, error)}")
    if isinstance(error, sqlite3.IntegrityError):
        return DataError(f"{path}: two programs write the same run ({error}); stop one of them")
    if error.sqlite_errorcode == sqlite3.SQLITE_NOTADB:
        return DataError(_no_store(path))
    return _damaged(path, str(error))


def _damaged(path: Path, what: str) -> DamagedStore:
    return DamagedStore(
        f"{path}: the store is damaged ({what}); save all that verifies with `rigctl export --salvage`"
    )


def _no_store(path: Path) -> str:
    return (
        f"{path}: not a campaign store; name a file made by `rigctl run` or `rigctl import`; if this is one whose "
        "beginning is damaged, save all that verifies with `rigctl export --salvage`"
    )


def _operational(path: Path, error: sqlite3.OperationalError) -> str:
    text, code = str(error), error.sqlite_errorcode & 0xFF
    if "locked" in text or "busy" in text:
        return f"another program has been writing for {BUSY_TIMEOUT_S:g} s; try again when it is done"
    if code == sqlite3.SQLITE_READONLY or (code == sqlite3.SQLITE_CANTOPEN and not place.can_be_written(path)):
        return place.READ_ONLY
    if code == sqlite3.SQLITE_FULL:
        return "the disk is full; free some space, then `rigctl resume`, or give the command again"
    # SQLite keeps the system's own word for it to itself; its own name says at least at what.
    if code == sqlite3.SQLITE_IOERR:
        return f"the store cannot be used ({text}, {error.sqlite_errorname}); check the disk{_limit()}"
    return f"the store cannot be used ({text}); check the disk and the file's permissions"


def _limit() -> str:
    """What to check as well where this process may not write files of any size."""
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return "" if limit == resource.RLIM_INFINITY else f", and the limit of {limit} bytes for a file (`ulimit -f`)"


def connect(path: Path, *, readonly: bool, archived: bool = False) -> sqlite3.Connection:
    """Open the SQLite file at `path`, which exists; no implicit transactions. `archived`: it does not change."""
    # `rw`, without `c`: a file that is not there is not made.
    uri = f"{path.resolve().as_uri()}?mode={'ro' if readonly else 'rw'}{'&immutable=1' if archived else ''}"
    with database_errors(path):
        # Python's own transactions begin deferred and at moments of its choosing.
        return sqlite3.connect(uri, uri=True, timeout=BUSY_TIMEOUT_S, isolation_level=None)


def prepare_for_writing(connection: sqlite3.Connection) -> None:
    """Write-ahead log, so that readers and the writer never wait for each other; sync only what is `durable`."""
    connection.execute("PRAGMA journal_mode = WAL").fetchone()
    connection.execute("PRAGMA synchronous = NORMAL")


@contextmanager
def without_log(connection: sqlite3.Connection) -> Iterator[None]:
    """For a file that nobody knows yet: one transaction, which goes into it at once, and not first into a log."""
    # A half-filled file is deleted: nothing has to be undone in one that a power cut leaves.
    connection.execute("PRAGMA journal_mode = MEMORY").fetchone()
    with transaction(connection, durable=True):
        yield
    prepare_for_writing(connection)


def require_store(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `DataError` unless the file is a campaign store."""
    if connection.execute("PRAGMA application_id").fetchone() != (APPLICATION_ID,):
        raise DataError(_no_store(path))


def schema_version(connection: sqlite3.Connection) -> int:
    """The file's own schema version."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def require_readable(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `DataError` for a file of a newer program."""
    version, newest = schema_version(connection), len(MIGRATIONS)
    if version > newest:
        raise DataError(f"{path}: store schema {version} is newer than this program reads ({newest}); update rigctl")


def has_checksums(connection: sqlite3.Connection) -> bool:
    """Whether rows have checksums: a file made before, and not yet opened for writing, has none."""
    return schema_version(connection) >= _WITH_CHECKSUMS


def require_tables(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `DamagedStore` unless tables and indexes are declared as this program declares them."""
    present = set(connection.execute("SELECT name, sql FROM sqlite_schema"))
    if has_checksums(connection):
        # Declarations of others beside ours do no harm.
        if missing := {name for name, _ in _declared() - present}:
            raise _damaged(path, f"the declaration of {', '.join(sorted(missing))}")
    # A ledger in a file that says it is older: the version itself is damaged.
    elif "ledger" in {name for name, _ in present}:
        raise _damaged(path, "its schema version")


@cache
def _declared() -> frozenset[tuple[str, str]]:
    # The declarations as SQLite itself words them after all migrations, to compare text with text.
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        migrate(connection, MIGRATIONS)
        return frozenset(connection.execute("SELECT name, sql FROM sqlite_schema"))


def require_index(connection: sqlite3.Connection, path: Path) -> None:
    """Raise `DamagedStore` unless every run is found by its key: what is not found is measured again."""
    # Of this table alone: of the whole file it would read all samples.
    (verdict,) = connection.execute("PRAGMA integrity_check(runs)").fetchone()
    if verdict != "ok":
        raise _damaged(path, verdict)


def bring_up(
    connection: sqlite3.Connection, path: Path, *, readonly: bool, seal: Callable[[sqlite3.Connection], None]
) -> None:
    """Migrate an older file and `seal` it in one transaction; `DataError` when it is too old to be read."""
    if not readonly:
        prepare_for_writing(connection)
    version, newest = schema_version(connection), len(MIGRATIONS)
    if version == newest:
        return
    if readonly:
        if version >= READABLE_FROM:
            return
        raise DataError(
            f"{path}: store schema {version} is older than {newest}; open it once for writing to bring it up"
        )
    with transaction(connection, durable=True):
        migrate(connection, MIGRATIONS)
        require_index(connection, path)
        # After the migration and in its transaction: a file is never without the sums its version promises.
        seal(connection)


def migrate(connection: sqlite3.Connection, migrations: Sequence[Migration]) -> None:
    """Bring an older file up, all steps in the transaction the caller has begun."""
    for version in range(schema_version(connection), len(migrations)):
        for statement in migrations[version]:
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {version + 1}")


@contextmanager
def snapshot(connection: sqlite3.Connection) -> Iterator[None]:
    """Everything read inside is of one instant."""
    # Inside a transaction everything is of one instant already.
    if connection.in_transaction:
        yield
        return
    connection.execute("BEGIN")
    try:
        yield
    finally:
        # Nothing was written; this only lets go of the instant.
        connection.execute("ROLLBACK")


@contextmanager
def transaction(connection: sqlite3.Connection, *, durable: bool = False) -> Iterator[None]:
    """One write transaction, rolled back on an error; `durable`: on stable storage when it has ended.

    Inside another it is a part of that.
    """
    if connection.in_transaction:
        yield
        return
    if durable:
        # Before the transaction, since SQLite refuses the change inside one.
        connection.execute("PRAGMA synchronous = FULL")
    # The write lock at once: a transaction that turns from reading to writing is refused without waiting.
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        # SQLite rolls back by itself on some errors, such as a full disk.
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
    finally:
        if durable:
            connection.execute("PRAGMA synchronous = NORMAL")
