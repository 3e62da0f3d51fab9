"""Versions of the schema: each is a migration of Alembic, and a store is brought to the newest one step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext

from truepose.errors import StoreError
from truepose.store import schema

SCRIPTS: Final = Path(__file__).parent / "migrations"


def version_of(connection: sa.Connection) -> int:
    """Return the version of a store's schema; 0 of a database without tables of a store."""
    found = MigrationContext.configure(connection).get_current_revision()
    return int(found) if found is not None and found.isdecimal() else 0


def check_version(connection: sa.Connection, shown: str, *, older: bool = False) -> None:
    """Refuse a store of another version than the program; with `older`, one of an older version is accepted.

    Raises
    ------
    StoreError
        If it is refused.
    """
    if (version := version_of(connection)) == 0:
        raise StoreError(f"{shown}: there is no store in this database; make one with 'truepose store init'")
    if version > schema.VERSION:
        raise StoreError(
            f"{shown}: has schema version {version}, this program knows none after {schema.VERSION}; update truepose"
        )
    if version < schema.VERSION and not older:
        raise StoreError(
            f"{shown}: has schema version {version}, this program needs version {schema.VERSION}; "
            "make a backup with the program that wrote it, then run 'truepose store migrate'"
        )


def upgrade(connection: sa.Connection, version: int = schema.VERSION) -> None:
    """Bring the schema of an open transaction to a version."""
    config = Config()
    config.set_main_option("script_location", str(SCRIPTS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    command.upgrade(config, str(version))
