"""What the store asks of a database engine."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

import sqlalchemy as sa


class Backend(Protocol):
    """A database of one engine.

    Attributes
    ----------
    shown : str
        The address for messages, without a password.
    engine : Engine
        The connections.
    blobs : Path or None
        The folder of the blobs; None if the database keeps them itself.
    anchor : Path or None
        The file that keeps the head of the audit trail outside of the database.
    """

    @property
    def shown(self) -> str: ...  # noqa: D102
    @property
    def engine(self) -> sa.Engine: ...  # noqa: D102
    @property
    def blobs(self) -> Path | None: ...  # noqa: D102
    @property
    def anchor(self) -> Path | None: ...  # noqa: D102

    def check_exists(self) -> None:
        """Refuse a database that does not exist, before a connection would make one."""

    def prepare(self) -> None:
        """Make what a new database needs before its first connection."""

    def writer(self) -> AbstractContextManager[sa.Connection]:
        """Open a transaction that writes: one at a time, committed at the end, rolled back by an exception."""

    def reader(self) -> AbstractContextManager[sa.Connection]:
        """Open a transaction that reads: it sees one state, whatever is written meanwhile."""

    def serve_lock(self) -> AbstractContextManager[None]:
        """Hold the lock of the one server that may use the database; other engines allow several servers."""

    def insert_rows(
        self, connection: sa.Connection, table: str, columns: Sequence[str], rows: Sequence[tuple[Any, ...]]
    ) -> None:
        """Insert many rows as they are, in the fastest way that the engine has."""

    def grant(self, connection: sa.Connection, role: str) -> None:
        """Give a role of the server all tables, but the audit trail for appending only."""

    def damage(self, connection: sa.Connection) -> list[str]:
        """Return what the engine's own check finds."""

    def explain(self, error: sa.exc.SQLAlchemyError) -> str:
        """Return the problem and its remedy."""


def first_line(error: BaseException) -> str:
    """Return the first line of an error of a driver."""
    text = str(getattr(error, "orig", None) or error).strip()
    return text.splitlines()[0] if text else type(error).__name__


def missing_guards(statements: Iterable[str], present: Container[str]) -> list[str]:
    """Return the names of the triggers that statements create and that are not present."""
    names = [words[2] for text in statements if (words := text.split())[:2] == ["CREATE", "TRIGGER"]]
    return [name for name in names if name not in present]
