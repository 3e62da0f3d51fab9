"""SQLite: one file on a local disk, written ahead (WAL), flushed at each commit, one writer at a time."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from truepose._io.locks import lock
from truepose.errors import DataError, StoreError
from truepose.store.engines.base import first_line, missing_guards
from truepose.store.engines.file_systems import refuse_network

DATABASE: Final = "store.sqlite3"
BUSY_SECONDS: Final = 30
"""How long a writer of another process is waited for."""
AUDIT_GUARDS: Final = tuple(
    f"CREATE TRIGGER audit_no_{event.lower()} BEFORE {event} ON audit "
    "BEGIN SELECT RAISE(ABORT, 'the audit trail is append-only'); END"
    for event in ("UPDATE", "DELETE")
)
_MAGIC: Final = b"SQLite format 3\0"
_READS: Final = "truepose_reads"

_CACHE_KIB: Final = 2**16
_LARGE_CACHE_KIB: Final = 2**18


class SqliteBackend:
    """A store in an SQLite file; see `truepose.store.engines.base.Backend`.

    Parameters
    ----------
    path : Path
        The file of the database.
    blobs : Path or None
        The folder of the blobs; ``blobs`` beside the database if None.
    """

    def __init__(self, path: Path, blobs: Path | None = None) -> None:
        self.path = path
        self.shown = str(path)
        self.blobs = blobs or path.parent / "blobs"
        self.anchor = path.with_name(f"{path.stem}.head")
        self._one_writer = threading.Lock()
        url = sa.URL.create("sqlite+pysqlite", database=str(path))
        self.engine = sa.create_engine(url, connect_args={"timeout": BUSY_SECONDS, "isolation_level": None})
        sa.event.listen(self.engine, "connect", _set_up)
        sa.event.listen(self.engine, "begin", _begin)

    def check_exists(self) -> None:
        """Refuse a missing file, a file of another kind, and a network share."""
        refuse_network(self.path)
        try:
            with self.path.open("rb") as file:
                start = file.read(len(_MAGIC))
        except FileNotFoundError:
            raise StoreError(f"{self.shown}: there is no store; make one with 'truepose store init'") from None
        except OSError as error:
            raise StoreError(f"{self.shown}: cannot be read: {error.strerror or error}") from error
        if start != _MAGIC:
            raise StoreError(
                f"{self.shown}: is not an SQLite database; name the folder of a store, or restore a backup"
            )

    def prepare(self) -> None:
        """Make the folder of the database."""
        refuse_network(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self.shown}: the folder cannot be made: {error.strerror or error}") from error

    @contextmanager
    def writer(self) -> Iterator[sa.Connection]:
        """Write; threads of this process queue for it, and other processes are waited for by SQLite."""
        with self._one_writer, self.engine.begin() as connection:
            yield connection

    @contextmanager
    def reader(self) -> Iterator[sa.Connection]:
        """Read one state."""
        with self.engine.connect().execution_options(**{_READS: True}) as connection, connection.begin():
            yield connection

    @contextmanager
    def serve_lock(self) -> Iterator[None]:
        """Hold a lock file beside the database for as long as this process serves it."""
        path = self.path.with_name(f"{self.path.name}.lock")
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from error
        try:
            if not lock(descriptor):
                raise StoreError(
                    f"{self.shown}: another server uses this store; stop it, or use PostgreSQL for several servers"
                )
            yield
        finally:
            os.close(descriptor)

    def insert_rows(
        self, connection: sa.Connection, table: str, columns: Sequence[str], rows: Sequence[tuple[Any, ...]]
    ) -> None:
        """Insert many rows as they are; indexes in no order need the larger cache."""
        connection.exec_driver_sql(f"PRAGMA cache_size=-{_LARGE_CACHE_KIB}")
        names = ", ".join(map(connection.dialect.identifier_preparer.quote, columns))
        places = ", ".join("?" * len(columns))
        quoted = connection.dialect.identifier_preparer.quote(table)
        connection.exec_driver_sql(f"INSERT INTO {quoted} ({names}) VALUES ({places})", list(rows))

    def grant(self, connection: sa.Connection, role: str) -> None:
        """Refuse: a file has no roles."""
        raise DataError("SQLite has no roles; rights are those of the folder (--grant is for PostgreSQL)")

    def damage(self, connection: sa.Connection) -> list[str]:
        """Return the findings of SQLite's integrity check, and triggers that are missing."""
        found = [str(row[0]) for row in connection.exec_driver_sql("PRAGMA integrity_check(20)")]
        damaged = [] if found == ["ok"] else [f"the database file is damaged: {text}" for text in found]
        present = set(connection.exec_driver_sql("SELECT name FROM sqlite_master WHERE type = 'trigger'").scalars())
        return damaged + [f"the trigger {name} was removed" for name in missing_guards(AUDIT_GUARDS, present)]

    def explain(self, error: sa.exc.SQLAlchemyError) -> str:
        """Return the problem and its remedy."""
        code = getattr(getattr(error, "orig", None), "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            return f"the store was busy for more than {BUSY_SECONDS} s; nothing was stored, try again"
        if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            return f"the database file is damaged ({first_line(error)}); restore a backup with 'truepose store restore'"
        if code == sqlite3.SQLITE_FULL:
            return "the disk is full; nothing was stored, make room and try again"
        if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM):
            return f"cannot be opened for writing ({first_line(error)}); check the rights of the folder"
        return f"{first_line(error)}; nothing was stored"


def _set_up(connection: Any, _record: object) -> None:
    """Set what SQLite keeps for each connection."""
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        "foreign_keys=ON",
        f"cache_size=-{_CACHE_KIB}",  # the checks of a large store read indexes in no order
        "recursive_triggers=ON",  # REPLACE must not get round the triggers of the audit trail
    ):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin(connection: sa.Connection) -> None:
    """Begin a transaction; one that writes takes the lock at once, so that it can never fail half-way for it."""
    reads = connection.get_execution_options().get(_READS, False)
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")
