"""PostgreSQL: a server for a team; writers queue for one advisory lock, so that the audit trail stays one chain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from truepose._extras import needed
from truepose.errors import StoreError
from truepose.store.engines.base import first_line, missing_guards

LOCK_SECONDS: Final = 30
"""How long another writer is waited for."""
_WRITER_LOCK: Final = 7_232_063_171  # any number; this one is used by nothing else in the database
_FUNCTION: Final = (
    "CREATE OR REPLACE FUNCTION audit_append_only() RETURNS trigger LANGUAGE plpgsql AS "
    "$$ BEGIN RAISE EXCEPTION 'the audit trail is append-only'; END $$"
)
AUDIT_GUARDS: Final = (
    _FUNCTION,
    *(
        f"CREATE TRIGGER {name} BEFORE {events} ON audit FOR EACH {each} EXECUTE FUNCTION audit_append_only()"
        for name, events, each in (
            ("audit_no_change", "UPDATE OR DELETE", "ROW"),
            ("audit_no_truncate", "TRUNCATE", "STATEMENT"),
        )
    ),
    "REVOKE UPDATE, DELETE, TRUNCATE ON audit FROM PUBLIC",
)
_BUSY: Final = ("55P03", "40001", "40P01")  # lock timeout, serialisation, deadlock
_FULL: Final = ("53100",)
_DENIED: Final = ("42501",)


class PostgresqlBackend:
    """A store in a PostgreSQL database; see `truepose.store.engines.base.Backend`.

    Parameters
    ----------
    url : URL
        The address of the database.
    blobs : Path or None
        The folder of the blobs, on a volume that all machines share; None keeps them in the database.
    """

    def __init__(self, url: sa.URL, blobs: Path | None = None) -> None:
        self.shown = url.render_as_string(hide_password=True)
        self.blobs = blobs
        self.anchor = None if blobs is None else blobs.parent / f"{blobs.name}.head"
        with needed("a PostgreSQL store", "postgres"):  # SQLAlchemy imports the driver
            self.engine = sa.create_engine(url.set(drivername="postgresql+psycopg"), pool_pre_ping=True)

    def check_exists(self) -> None:
        """Leave it to the server to refuse a database that does not exist."""

    def prepare(self) -> None:
        """Leave it to the server's administrator to make the database."""

    @contextmanager
    def writer(self) -> Iterator[sa.Connection]:
        """Write, after the wait for the one who writes now."""
        with self.engine.begin() as connection:
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{LOCK_SECONDS}s'")
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_WRITER_LOCK)))
            yield connection

    @contextmanager
    def reader(self) -> Iterator[sa.Connection]:
        """Read one state."""
        with self.engine.connect() as connection:
            connection.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
            with connection.begin():
                yield connection

    @contextmanager
    def serve_lock(self) -> Iterator[None]:
        """Allow several servers: PostgreSQL is made for it."""
        yield

    def insert_rows(
        self, connection: sa.Connection, table: str, columns: Sequence[str], rows: Sequence[tuple[Any, ...]]
    ) -> None:
        """Insert many rows as they are, by COPY."""
        quote = connection.dialect.identifier_preparer.quote
        names = ", ".join(map(quote, columns))
        driver = connection.connection.cursor()
        with driver.copy(f"COPY {quote(table)} ({names}) FROM STDIN") as copy:
            for row in rows:
                copy.write_row(row)

    def grant(self, connection: sa.Connection, role: str) -> None:
        """Give a role what the application needs: all tables, but the audit trail for appending only.

        Raises
        ------
        StoreError
            If the role does not exist.
        """
        known = sa.text("SELECT 1 FROM pg_roles WHERE rolname = :role")
        if connection.execute(known, {"role": role}).scalar() is None:
            raise StoreError(f"the server has no role {role!r}; make it with CREATE ROLE")
        name = connection.dialect.identifier_preparer.quote(role)
        schema = connection.dialect.identifier_preparer.quote(
            str(connection.execute(sa.text("SELECT current_schema()")).scalar())
        )
        for statement in (
            f"GRANT USAGE ON SCHEMA {schema} TO {name}",
            f"GRANT SELECT, INSERT, UPDATE, DELETE ON ALL TABLES IN SCHEMA {schema} TO {name}",
            f"REVOKE ALL ON audit, blob, alembic_version FROM {name}",
            f"GRANT SELECT, INSERT ON audit, blob TO {name}",
            f"GRANT SELECT ON alembic_version TO {name}",
        ):
            connection.exec_driver_sql(statement)

    def damage(self, connection: sa.Connection) -> list[str]:
        """Return triggers that are missing or disabled; PostgreSQL checks its pages when it reads them."""
        statement = "SELECT tgname FROM pg_trigger WHERE tgrelid = 'audit'::regclass AND tgenabled <> 'D'"
        present = set(connection.exec_driver_sql(statement).scalars())
        return [f"the trigger {name} was removed or disabled" for name in missing_guards(AUDIT_GUARDS, present)]

    def explain(self, error: sa.exc.SQLAlchemyError) -> str:
        """Return the problem and its remedy."""
        code = getattr(getattr(error, "orig", None), "sqlstate", None) or ""
        if code in _BUSY:
            return f"the store was busy for more than {LOCK_SECONDS} s; nothing was stored, try again"
        if code in _FULL:
            return "the disk of the server is full; nothing was stored, make room and try again"
        if code in _DENIED:
            return f"{first_line(error)}; ask for the rights, see 'truepose store migrate --grant'"
        if isinstance(error, sa.exc.DBAPIError) and (error.connection_invalidated or code[:2] in ("57", "08")):
            return "the connection to the store was lost; an unfinished change was not stored, try again"
        if isinstance(error, sa.exc.OperationalError) and not code:
            remedy = "check the address, and that the server runs; then try again"
            return f"cannot be reached ({first_line(error)}); {remedy}"
        return f"{first_line(error)}; nothing was stored"
