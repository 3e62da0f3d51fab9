"""A change of a store: rows and blobs, each with its entry in the audit trail, stored together or not at all."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from truepose._io.blobs import BlobFolder
from truepose.errors import DataError, FileError
from truepose.store import schema
from truepose.store.audit import Entry, Head, append, head, now, row_hash

_MANY: Final = 1000  # rows inserted at once


class Change:
    """What may be done in a transaction of `truepose.store.store.Store.transaction`.

    Parameters
    ----------
    connection : Connection
        A transaction that holds the writer's lock.
    user : str
        The name that the entries get.
    blobs : BlobFolder or None
        The folder of the blobs; None keeps them in the database.

    Attributes
    ----------
    connection : Connection
        The transaction, for reading what is about to be changed.
    head : Head
        The head of the audit trail after the change so far.
    """

    def __init__(self, connection: sa.Connection, user: str, blobs: BlobFolder | None) -> None:
        self.connection, self.user = connection, user
        self.head: Head = head(connection)
        self._blobs = blobs

    def insert(self, table: sa.Table, values: Mapping[str, Any], action: str | None = None) -> int:
        """Insert a row and return its ``id``; ``created`` and ``made_by`` are filled in if the table has them.

        Parameters
        ----------
        table : Table
            A table of `truepose.store.schema.AUDITED`.
        values : mapping
            The values of the columns but ``id``.
        action : str, optional
            The action of the entry; ``TABLE.add`` if not given.
        """
        return self.insert_many(table, [values], action)[0]

    def insert_many(self, table: sa.Table, rows: Iterable[Mapping[str, Any]], action: str | None = None) -> list[int]:
        """Insert rows, each with an entry of its own, and return their ids; see `insert`."""
        first = self._next_id(table)
        filled = {"created": now(), "made_by": self.user}
        defaults = {name: value for name, value in filled.items() if name in table.c}
        complete = [{"id": first + i, **defaults, **row} for i, row in enumerate(rows)]
        for row in complete:
            _check_columns(table, row)
        for at in range(0, len(complete), _MANY):
            some = complete[at : at + _MANY]
            self.connection.execute(sa.insert(table), some)
            self._append(
                Entry(action or f"{table.name}.add", _payload(table, row, row), table.name, row["id"]) for row in some
            )
        return [row["id"] for row in complete]

    def update(self, table: sa.Table, row_id: int, values: Mapping[str, Any], action: str | None = None) -> None:
        """Change columns of a row.

        Raises
        ------
        DataError
            If there is no such row.
        """
        after = {**self.row(table, row_id), **values}
        _check_columns(table, after)
        self.connection.execute(sa.update(table).where(table.c.id == row_id).values(**values))
        self._append([Entry(action or f"{table.name}.change", _payload(table, after, values), table.name, row_id)])

    def delete(self, table: sa.Table, row_id: int, action: str | None = None) -> None:
        """Remove a row; the audit trail keeps what it was.

        Raises
        ------
        DataError
            If there is no such row.
        """
        values = self.row(table, row_id)
        self.connection.execute(sa.delete(table).where(table.c.id == row_id))
        payload = {**_payload(table, values, values), "row": None}
        self._append([Entry(action or f"{table.name}.remove", payload, table.name, row_id)])

    def note(self, action: str, payload: Mapping[str, Any]) -> None:
        """Append an entry about something that is not a row, such as a log-in that failed."""
        self._append([Entry(action, payload)])

    def row(self, table: sa.Table, row_id: int) -> dict[str, Any]:
        """Return a row.

        Raises
        ------
        DataError
            If there is no such row.
        """
        found = self.connection.execute(sa.select(table).where(table.c.id == row_id)).mappings().first()
        if found is None:
            raise DataError(f"the store has no {table.name} {row_id}")
        return dict(found)

    def blob(self, data: bytes) -> str:
        """Store bytes and return their SHA-256, which rows of this change may then name.

        Raises
        ------
        DataError
            If they are too large for a database without a folder of blobs.
        """
        if self._blobs is None:
            return self._blob_row(hashlib.sha256(data).hexdigest(), len(data), _small(data))
        return self._blob_row(self._blobs.put(data), len(data), None)

    def blob_file(self, path: str | Path) -> str:
        """Store the content of a file; see `blob`."""
        path = Path(path)
        if self._blobs is not None:
            sha = self._blobs.put_file(path)
            return self._blob_row(sha, self._blobs.path(sha).stat().st_size, None)
        try:
            if path.stat().st_size > schema.LARGEST_BLOB:
                raise FileError(path, _too_large(path.stat().st_size))
            return self.blob(path.read_bytes())
        except OSError as error:
            raise FileError(path, f"cannot be read: {error.strerror or error}") from None

    def _blob_row(self, sha: str, size: int, content: bytes | None) -> str:
        known = sa.select(schema.blob.c.sha256).where(schema.blob.c.sha256 == sha)
        if self.connection.execute(known).first() is None:
            row = {"sha256": sha, "size": size, "content": content}
            self.connection.execute(sa.insert(schema.blob), row)
        return sha

    def _append(self, entries: Iterable[Entry]) -> None:
        self.head = append(self.connection, self.head, self.user, entries)

    def _next_id(self, table: sa.Table) -> int:
        """Return an id that no row has or had; the writer's lock keeps others from taking it."""
        audit = schema.audit
        rows = self.connection.execute(sa.select(sa.func.max(table.c.id))).scalar()
        entries = sa.select(sa.func.max(audit.c.object_id)).where(audit.c.object == table.name)
        return 1 + max(rows or 0, self.connection.execute(entries).scalar() or 0)


def _payload(table: sa.Table, row: Mapping[str, Any], changed: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an entry says of a row: the changed values that are not secret, and the hash of the complete row."""
    shown = {name: value for name, value in changed.items() if not table.c[name].info.get("secret") and name != "id"}
    return {"values": shown, "row": row_hash(table, row)}


def _check_columns(table: sa.Table, row: Mapping[str, Any]) -> None:
    """Refuse text that not every engine keeps as it is."""
    for name, value in row.items():
        if isinstance(value, str) and ("\0" in value or (not value.isascii() and _has_surrogate(value))):
            raise DataError(f"{name} of a {table.name} has a character that a database cannot keep: {value!r}")
        length = getattr(table.c[name].type, "length", None)
        if isinstance(value, str) and length is not None and len(value) > length:
            raise DataError(f"{name} of a {table.name} has {len(value)} characters, expected at most {length}")


def _has_surrogate(text: str) -> bool:
    return any(0xD800 <= ord(character) <= 0xDFFF for character in text)


def _small(data: bytes) -> bytes:
    if len(data) > schema.LARGEST_BLOB:
        raise DataError(_too_large(len(data)))
    return data


def _too_large(size: int) -> str:
    most = schema.LARGEST_BLOB // 2**20
    return (
        f"has {size / 2**20:.0f} MiB; a database without a folder of blobs keeps at most {most} MiB: "
        "name a folder with ?blobs=FOLDER in the address of the store"
    )
