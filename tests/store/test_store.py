"""Open, change and read a store, on SQLite and on PostgreSQL."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from tests.needs import needed

import truepose
from truepose.errors import DataError, StoreError
from truepose.store import audit, schema
from truepose.store.store import Store


def sites(store: Store) -> list[str]:
    with store.reading() as connection:
        return list(connection.execute(sa.select(schema.site.c.name).order_by(schema.site.c.id)).scalars())


def test_migrations_make_the_schema_that_the_program_uses(store: Store) -> None:
    with store.reading() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []


def test_a_change_is_stored_with_its_entries_or_not_at_all(store: Store) -> None:
    before = store.head()
    with store.transaction("Zoë") as change:
        change.insert(schema.site, {"name": "Graz", "key": "graz"})
    assert sites(store) == ["Graz"]
    assert store.head().sequence == before.sequence + 1

    def fail() -> None:
        with store.transaction("Zoë") as change:
            change.insert(schema.site, {"name": "Ulm", "key": "ulm"})
            change.blob(b"nothing")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert sites(store) == ["Graz"]
    assert store.head().sequence == before.sequence + 1


def test_rows_are_updated_and_removed_with_entries(store: Store) -> None:
    with store.transaction("a") as change:
        made = change.insert(schema.site, {"name": "Graz", "key": "graz"})
        change.update(schema.site, made, {"name": "Graz 2"})
        change.delete(schema.site, made)
        again = change.insert(schema.site, {"name": "Ulm", "key": "ulm"})
    assert again > made  # an id is never used twice
    with store.reading() as connection:
        actions = connection.execute(sa.select(schema.audit.c.action).order_by(schema.audit.c.sequence)).scalars()
        assert list(actions)[1:] == ["site.add", "site.change", "site.remove", "site.add"]
        assert list(audit.broken_links(connection)) == []


def test_the_trail_begins_with_the_software_that_made_the_store(store: Store) -> None:
    with store.reading() as connection:
        first = (
            connection.execute(sa.select(schema.audit.c.payload).order_by(schema.audit.c.sequence)).scalars().first()
        )
    assert json.loads(first or "")["program"] == truepose.__version__


def test_secrets_are_not_in_the_audit_trail(store: Store) -> None:
    with store.transaction("a") as change:
        change.insert(
            schema.user, {"name": "b", "key": "b", "password": "$argon2id$hidden", "disabled": False, "failures": 0}
        )
    with store.reading() as connection:
        texts = connection.execute(sa.select(schema.audit.c.payload)).scalars().all()
    assert not [text for text in texts if "argon2id" in text]


@pytest.mark.parametrize("statement", ["UPDATE audit SET payload = 'x'", "DELETE FROM audit"])
def test_the_audit_trail_is_append_only(store: Store, statement: str) -> None:
    with pytest.raises(sa.exc.DBAPIError, match="append-only"), store.backend.engine.begin() as connection:
        connection.exec_driver_sql(statement)
    assert store.head().sequence == 1


def test_replace_and_truncate_are_no_way_around(store: Store) -> None:
    """`REPLACE` of SQLite and `TRUNCATE` of PostgreSQL remove rows without a DELETE."""
    statement = "TRUNCATE audit"
    if store.backend.engine.dialect.name == "sqlite":
        columns = "sequence, time, 'b', action, object, object_id, payload, previous, hash"
        statement = f"REPLACE INTO audit SELECT {columns} FROM audit"
    with pytest.raises(sa.exc.DBAPIError, match="append-only"), store.backend.engine.begin() as connection:
        connection.exec_driver_sql(statement)


@pytest.mark.exhaustive
def test_eight_writers_make_one_chain(address: str) -> None:
    def write(writer: int) -> None:
        with Store.open(address) as store:  # connections of its own, as in a process of its own
            for i in range(25):
                with store.transaction(f"writer {writer}") as change:
                    change.insert(schema.site, {"name": f"{writer}-{i}", "key": f"{writer}-{i}"})

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(8)))
    with Store.open(address) as store, store.reading() as connection:
        assert list(audit.broken_links(connection)) == []
        assert audit.head(connection).sequence == 1 + 8 * 25
        assert len(sites(store)) == 200


def test_blobs_are_read_back_and_stored_once(store: Store, tmp_path: Path) -> None:
    (tmp_path / "a.src").write_bytes(b"DEF A()")
    with store.transaction("a") as change:
        sha = change.blob(b"DEF A()")
        assert change.blob_file(tmp_path / "a.src") == sha
    assert store.read_blob(sha) == b"DEF A()"
    with store.reading() as connection:
        assert connection.execute(sa.select(sa.func.count()).select_from(schema.blob)).scalar() == 1


def test_postgresql_with_a_folder_of_blobs(database: Callable[[], str], tmp_path: Path) -> None:
    address = database()
    address += f"{'&' if '?' in address else '?'}blobs={tmp_path / 'blobs'}"
    with Store.open(address, create=True) as store, store.transaction("a") as change:
        sha = change.blob(b"x" * 100)
    assert (tmp_path / "blobs" / sha[:2] / sha[2:]).read_bytes() == b"x" * 100
    assert (tmp_path / "blobs.head").read_text().startswith("1 ")


def test_a_blob_that_a_database_does_not_keep(database: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schema, "LARGEST_BLOB", 10)
    with (
        Store.open(database(), create=True) as store,
        pytest.raises(DataError, match=r"\?blobs=FOLDER"),
        store.transaction("a") as change,
    ):
        change.blob(b"x" * 11)


def test_a_store_is_made_once(address: str) -> None:
    with pytest.raises(StoreError, match="exists already"):
        Store.open(address, create=True)


def test_an_empty_database_is_no_store(new_address: Callable[[], str]) -> None:
    with pytest.raises(StoreError, match="truepose store init"):
        Store.open(new_address())


@pytest.mark.parametrize("text", ["a\0b", "a\ud800b", "x" * 201])
def test_text_that_a_database_cannot_keep_is_refused(store: Store, text: str) -> None:
    with pytest.raises(DataError, match="name of a site"), store.transaction("a") as change:
        change.insert(schema.site, {"name": text, "key": "k"})


@pytest.mark.parametrize(
    "bad", ["mysql://h/d", "sqlite://", "sqlite:///:memory:", "postgresql://h/d?blobs=a&blobs=b", "http://["]
)
def test_addresses_of_no_store_are_refused(bad: str) -> None:
    with pytest.raises(DataError, match="store"):
        Store.open(bad)


def test_a_server_that_cannot_be_reached_is_named_without_its_password(tmp_path: Path) -> None:
    needed("psycopg", "'truepose[postgres]'")
    with pytest.raises(StoreError, match="cannot be reached") as caught:
        Store.open(f"postgresql://me:secret@/d?host={tmp_path}")
    assert "secret" not in str(caught.value)


def test_a_foreign_file_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "store.sqlite3").write_text("a text that is longer than the start of a database")
    with pytest.raises(StoreError, match="not an SQLite database"):
        Store.open(tmp_path)


def test_users_are_named(store: Store) -> None:
    with pytest.raises(DataError, match="name of a user"), store.transaction(" "):
        pass
