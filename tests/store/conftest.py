"""Stores on SQLite and on a real PostgreSQL server.

``TRUEPOSE_POSTGRES_URL`` names a server to use, whose user may create databases; otherwise the ``pgserver`` wheel runs
one. ``TRUEPOSE_STORE_TESTS=require`` makes it a failure that there is neither.
"""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.needs import needed

needed("alembic", "'truepose[store]'")

import sqlalchemy as sa
from tests.store.servers import OwnServer

from truepose.store.store import Store

ENGINES = ("sqlite", "postgresql")
_NUMBERS = itertools.count()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that reach a PostgreSQL server, whether by a fixture or by a parameter: the second tier."""
    for item in items:
        if isinstance(item, pytest.Function) and _reaches_postgresql(item):
            item.add_marker("postgresql")
            item.add_marker("exhaustive")


def _reaches_postgresql(item: pytest.Function) -> bool:
    values = item.callspec.params.values() if hasattr(item, "callspec") else ()
    return "postgres" in item.fixturenames or any(str(value).startswith("postgresql") for value in values)


@pytest.fixture(scope="session")
def postgres() -> Iterator[sa.URL]:
    """The address of a PostgreSQL server."""
    if given := os.environ.get("TRUEPOSE_POSTGRES_URL"):
        yield sa.make_url(given).set(drivername="postgresql+psycopg")
        return
    with OwnServer() as server:
        yield server.url


class Databases:
    """Databases of a server that tests make and that are dropped at the end."""

    def __init__(self, server: sa.URL) -> None:
        self.server, self.ready = server, ""
        self._admin = sa.create_engine(server, isolation_level="AUTOCOMMIT")
        self._made: list[str] = []

    def __call__(self, template: str = "template1") -> str:
        """Make a database and return its address."""
        self._made.append(f"truepose_{os.getpid()}_{next(_NUMBERS)}")
        with self._admin.connect() as connection:
            connection.exec_driver_sql(f"CREATE DATABASE {self._made[-1]} TEMPLATE {template}")
        return self.server.set(database=self._made[-1]).render_as_string(hide_password=False)

    def with_store(self) -> str:
        """Make a database with a new, empty store and return its address."""
        if not self.ready:
            Store.open(self(), create=True).close()
            self.ready = self._made[-1]
        return self(self.ready)

    def drop(self) -> None:
        """Drop all."""
        with self._admin.connect() as connection:
            for name in self._made:
                connection.exec_driver_sql(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
        self._admin.dispose()


@pytest.fixture(scope="session")
def database(postgres: sa.URL) -> Iterator[Databases]:
    """Return a function that makes an empty database of the server and returns its address."""
    made = Databases(postgres)
    yield made
    made.drop()


@pytest.fixture(params=ENGINES)
def new_address(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Return a function that returns the address of a place for a new store, on each engine in turn."""
    if request.param == "postgresql":
        return request.getfixturevalue("database")
    return lambda: f"sqlite:///{tmp_path / f'store{next(_NUMBERS)}' / 'store.sqlite3'}"


@pytest.fixture
def address(new_address: Callable[[], str]) -> str:
    """The address of a new, empty store on each engine in turn."""
    if isinstance(new_address, Databases):
        return new_address.with_store()
    made = new_address()
    Store.open(made, create=True).close()
    return made


@pytest.fixture
def store(address: str) -> Iterator[Store]:
    """A new, empty store on each engine in turn."""
    with Store.open(address) as opened:
        yield opened
