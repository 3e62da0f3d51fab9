"""The address of a store: a folder, ``sqlite:///FILE`` or ``postgresql://…``, with ``?blobs=FOLDER``."""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa

from truepose.errors import DataError
from truepose.store.engines.base import Backend
from truepose.store.engines.postgresql import PostgresqlBackend
from truepose.store.engines.sqlite import DATABASE, SqliteBackend

_EXPECTED = "expected a folder, sqlite:///FILE or postgresql://USER@HOST/DATABASE"


def backend_of(address: str | Path) -> Backend:
    """Return the backend of an address; nothing is opened.

    Raises
    ------
    DataError
        If the address is of another form, or the driver is not installed.
    """
    text = str(address)
    if isinstance(address, Path) or "://" not in text:
        return SqliteBackend(Path(text) / DATABASE)
    try:
        url = sa.make_url(text)
    except (sa.exc.ArgumentError, ValueError):
        raise DataError(f"the address of the store cannot be read; {_EXPECTED}") from None
    given = url.query.get("blobs")
    if isinstance(given, tuple):
        raise DataError("the address of the store names blobs= twice; name one folder")
    url, blobs = url.difference_update_query(["blobs"]), Path(given) if given else None
    match url.drivername:
        case "sqlite" | "sqlite+pysqlite" if url.database and url.database != ":memory:":
            return SqliteBackend(Path(url.database), blobs)
        case "postgresql" | "postgres" | "postgresql+psycopg":
            return PostgresqlBackend(url, blobs)
        case name:
            raise DataError(f"{name} is not an engine of stores that keep files; {_EXPECTED}")
