"""Stores on SQLite and on a real PostgreSQL server.

``TRUEPOSE_POSTGRES_URL`` names a server to use, whose user may create databases; otherwise the ``pgserver`` wheel runs
one. ``TRUEPOSE_STORE_TESTS=require`` makes it a failure that there is neither.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("alembic", reason="the store needs: pip install 'truepose[store]'")

import sqlalchemy as sa

from truepose.store.store import Store

ENGINES = ("sqlite", "postgresql")
_NUMBERS = itertools.count()


@pytest.fixture(scope="session")
def postgres(tmp_path_factory: pytest.TempPathFactory) -> Iterator[sa.URL]:
    """The address of a PostgreSQL server."""
    if given := os.environ.get("TRUEPOSE_POSTGRES_URL"):
        yield sa.make_url(given).set(drivername="postgresql+psycopg")
        return
    try:
        import pgserver
        import psycopg  # noqa: F401
    except ImportError as error:
        missing(f"no {error.name}: pip install pgserver 'truepose[postgres]', or set TRUEPOSE_POSTGRES_URL")
    server = pgserver.get_server(tmp_path_factory.mktemp("postgres"), cleanup_mode="delete")
    try:
        yield sa.make_url(server.get_uri()).set(drivername="postgresql+psycopg")
    finally:
        server.cleanup()


def missing(why: str) -> None:
    """Skip a test that needs a server, or fail it where it must run."""
    if os.environ.get("TRUEPOSE_STORE_TESTS") == "require":
        pytest.fail(why)
    pytest.skip(why)


@pytest.fixture
def database(postgres: sa.URL) -> Iterator[Callable[[], str]]:
    """Return a function that makes an empty database of the server and returns its address."""
    admin = sa.create_engine(postgres, isolation_level="AUTOCOMMIT")
    made: list[str] = []

    def make() -> str:
        made.append(f"truepose_{os.getpid()}_{next(_NUMBERS)}")
        with admin.connect() as connection:
            connection.exec_driver_sql(f"CREATE DATABASE {made[-1]}")
        return postgres.set(database=made[-1]).render_as_string(hide_password=False)

    yield make
    with admin.connect() as connection:
        for name in made:
            connection.exec_driver_sql(f"DROP DATABASE {name} WITH (FORCE)")
    admin.dispose()


@pytest.fixture(params=ENGINES)
def new_address(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Return a function that returns the address of a place for a new store, on each engine in turn."""
    if request.param == "postgresql":
        return request.getfixturevalue("database")
    return lambda: f"sqlite:///{tmp_path / f'store{next(_NUMBERS)}' / 'store.sqlite3'}"


@pytest.fixture
def address(new_address: Callable[[], str]) -> str:
    """The address of a new, empty store on each engine in turn."""
    made = new_address()
    Store.open(made, create=True).close()
    return made


@pytest.fixture
def store(address: str) -> Iterator[Store]:
    """A new, empty store on each engine in turn."""
    with Store.open(address) as opened:
        yield opened
