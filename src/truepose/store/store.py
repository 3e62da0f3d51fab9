"""The store: opened by its address, read and changed in transactions."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

import sqlalchemy as sa

from truepose._io.blobs import BlobFolder
from truepose._version import version
from truepose.errors import DataError, StoreError
from truepose.store import anchor, audit, schema
from truepose.store.address import backend_of
from truepose.store.audit import Head
from truepose.store.change import Change
from truepose.store.corrected import list_positions
from truepose.store.engines.base import Backend
from truepose.store.migrate import check_version, upgrade, version_of


class Store:
    """A team's store; make it with `open`.

    Parameters
    ----------
    backend : Backend
        The database.

    Attributes
    ----------
    backend : Backend
        The database.
    blobs : BlobFolder or None
        The folder of the blobs; None if the database keeps them.
    """

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.blobs = None if backend.blobs is None else BlobFolder(backend.blobs)

    def __repr__(self) -> str:
        return f"<Store {self.backend.shown}>"

    @classmethod
    def open(cls, address: str | Path, *, create: bool = False) -> Self:
        """Open a store.

        Parameters
        ----------
        address : str or Path
            A folder, ``sqlite:///FILE`` or ``postgresql://USER@HOST/DATABASE``; ``?blobs=FOLDER`` names the folder of
            the blobs.
        create : bool
            Whether to make the store; a store that exists is then refused.

        Raises
        ------
        StoreError
            If there is no store, or there is one and `create` is set; if it has another version than the program; if
            it cannot be reached; if SQLite's file is on a network share.
        DataError
            If the address cannot be read, or the driver is not installed.
        """
        if create:
            with cls.making(address) as (store, connection):
                upgrade(connection)
                identity = {"store": str(uuid.uuid4()), "schema": schema.VERSION, "program": version()}
                Change(connection, "truepose", store.blobs).note("store.init", identity)
            return store
        store = cls.unchecked(address)
        try:
            with store.reading() as connection:
                check_version(connection, store.backend.shown)
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def unchecked(cls, address: str | Path) -> Self:
        """Open a store of any version, to migrate it; see `open`."""
        store = cls(backend_of(address))
        store.backend.check_exists()
        return store

    @classmethod
    @contextmanager
    def making(cls, address: str | Path) -> Iterator[tuple[Self, sa.Connection]]:
        """Make a store in the transaction that the block fills; see `open`."""
        store = cls(backend_of(address))
        try:
            store.backend.prepare()
            with store._explained():
                with store.backend.writer() as connection:
                    if sa.inspect(connection).get_table_names():
                        raise StoreError(f"{store.backend.shown}: exists already; open it, or choose another place")
                    yield store, connection
                    head = audit.head(connection)
                anchor.write(store.backend.anchor, head)
        except BaseException:
            store.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self.backend.engine.dispose()

    @contextmanager
    def transaction(self, user: str) -> Iterator[Change]:
        """Change the store; rows, blobs and entries of the audit trail are stored together at the end, or not at all.

        Parameters
        ----------
        user : str
            The name for the audit trail.

        Raises
        ------
        StoreError
            If the store is busy, full, or was lost; nothing is stored then.
        """
        if not user.strip():
            raise DataError("a change of the store needs the name of a user")
        with self._explained():
            with self.backend.writer() as connection:
                change = Change(connection, user, self.blobs)
                yield change
            anchor.write(self.backend.anchor, change.head)

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Read the store; all queries see the same state."""
        with self._explained(), self.backend.reader() as connection:
            yield connection

    def head(self) -> Head:
        """Return the last entry of the audit trail."""
        with self.reading() as connection:
            return audit.head(connection)

    def read_blob(self, sha: str) -> bytes:
        """Return a blob after a check of its hash.

        Raises
        ------
        FileError, StoreError
            If the blob is missing, or was changed.
        """
        if self.blobs is not None:
            return self.blobs.read(sha)
        with self.reading() as connection:
            return blob_content(self, connection, sha)

    def serve_lock(self) -> AbstractContextManager[None]:
        """Hold the right to serve the store; SQLite allows one server, PostgreSQL any number."""
        return self.backend.serve_lock()

    def migrate(self, user: str) -> tuple[int, int]:
        """Bring the schema to the version of the program; return the versions before and after."""
        with self._explained(), self.backend.writer() as connection:
            before = version_of(connection)
            check_version(connection, self.backend.shown, older=True)
            if before == schema.VERSION:
                return before, before
            upgrade(connection)
            list_positions(connection, partial(blob_content, self, connection))
            change = Change(connection, user, self.blobs)
            change.note("store.migrate", {"from": before, "to": schema.VERSION, "program": version()})
        anchor.write(self.backend.anchor, change.head)
        return before, schema.VERSION

    def grant(self, role: str) -> None:
        """Give a role of the database server the rights that the application needs; see `Backend.grant`."""
        with self._explained(), self.backend.writer() as connection:
            self.backend.grant(connection, role)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn errors of the driver into errors with a remedy."""
        try:
            yield
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(f"{self.backend.shown}: {self.backend.explain(error)}") from error


def blob_content(store: Store, connection: sa.Connection, sha: str) -> bytes:
    """Return a blob within a transaction; see `Store.read_blob`."""
    if store.blobs is not None:
        return store.blobs.read(sha)
    shown = store.backend.shown
    content = connection.execute(sa.select(schema.blob.c.content).where(schema.blob.c.sha256 == sha)).scalar()
    if content is None:
        raise StoreError(f"{shown}: blob {sha} is missing; restore it from a backup")
    if hashlib.sha256(content).hexdigest() != sha:
        raise StoreError(f"{shown}: the content of blob {sha} does not match its name; restore it from a backup")
    return bytes(content)


__all__ = ["Change", "Head", "Store"]
