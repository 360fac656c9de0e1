"""The file of a store: made whole, or opened and seen to be whole."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

from rigctl.campaign.recording import Header
from rigctl.campaign.store import ledger, place, schema, synced
from rigctl.campaign.store.checked_rows import seal
from rigctl.campaign.store.header_json import header_to_json
from rigctl.campaign.store.ledger import Mark
from rigctl.core.errors import DataError, StorageError
from rigctl.core.whole_file import writing


def create_file(path: Path, header: Header) -> None:
    """A new campaign file, whole from the moment it is there; `DataError` if `path` exists or cannot be made."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.new")
    # FileExistsError has words of its own, before those for whatever else the system says.
    with writing(path, "cannot be made"):
        try:
            # SQLite is opened in a mode that makes no files, so that a mistyped name makes none either.
            os.close(os.open(partial, os.O_CREAT | os.O_TRUNC, 0o644))
            with schema.database_errors(path), closing(schema.connect(partial, readonly=False)) as connection:
                schema.prepare_for_writing(connection)
                # On stable storage before the file has its name: whoever sees the name sees a whole store.
                with schema.transaction(connection, durable=True):
                    connection.execute(f"PRAGMA application_id = {schema.APPLICATION_ID}")
                    schema.migrate(connection, schema.MIGRATIONS)
                    connection.execute("INSERT INTO header (data) VALUES (?)", (header_to_json(header),))
                    seal(connection)
            _publish(partial, path)
        except FileExistsError as error:
            raise DataError(f"{path}: exists already; name another store, or `rigctl resume` this one") from error
        finally:
            with suppress(OSError):  # where nothing can be made, nothing can be removed
                partial.unlink()


def open_file(path: Path, *, readonly: bool) -> sqlite3.Connection:
    """An existing campaign file, brought to the current schema unless `readonly`; `DataError`, `DamagedStore`."""
    if not path.is_file():
        raise DataError(f"{path}: no such store; check the name, or make one with `rigctl run` or `import`")
    # SQLite would open it all the same, and refuse the first change.
    if not readonly and not os.access(path, os.W_OK):
        raise StorageError(f"{path}: {place.READ_ONLY}")
    # Before the store: a commit in between then makes the store look ahead of the note, which is no loss.
    noted = synced.read(path)
    if noted is not None and not readonly:
        # Whoever opens it for writing and closes it again takes away a log of which not all was read.
        with closing(schema.connect(path, readonly=True)) as connection:
            _require_whole(connection, path, noted)
    connection = schema.connect(path, readonly=readonly, archived=readonly and place.is_archived(path))
    try:
        with schema.database_errors(path):
            connection.execute(f"PRAGMA query_only = {int(readonly)}")
            # Again: another program may have written between the two openings.
            _require_whole(connection, path, noted)
            schema.bring_up(connection, path, readonly=readonly, seal=seal)
    except BaseException:
        connection.close()
        raise
    return connection


def _require_whole(connection: sqlite3.Connection, path: Path, noted: Mark | None) -> None:
    """Raise unless this is a store, its tables are declared as they should be and its last changes are there."""
    with schema.database_errors(path):
        schema.require_store(connection, path)
        schema.require_readable(connection, path)
        schema.require_tables(connection, path)
        if noted is not None and schema.has_checksums(connection):
            synced.require_all(path, noted, ledger.mark(connection))


def _publish(partial: Path, path: Path) -> None:
    """Give a finished file its name; `FileExistsError` rather than over a store that somebody made meanwhile."""
    try:
        # A rename would replace a store of this name without a word.
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError as error:  # a file system without hard links, where the name can only be looked for
        if path.exists():
            raise FileExistsError(path) from error
        partial.rename(path)
