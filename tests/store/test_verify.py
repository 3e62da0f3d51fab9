"""What was done to a store behind its back is found, with the entry and the object."""

from __future__ import annotations

import contextlib
import re
import sqlite3
from pathlib import Path

import pytest
import sqlalchemy as sa

from truepose.store import records, schema
from truepose.store.engines.sqlite import SqliteBackend
from truepose.store.store import Store
from truepose.store.verify import verify


@pytest.fixture
def filled(store: Store) -> Store:
    with store.transaction("a") as change:
        cell = records.put_cell(change, "Cell 4", b"[cell]")
        records.put_map(change, records.NewMap(cell, "m", b"the map", "idw", {"mean_mm": 0.1}))
    return store


def tamper(store: Store, *statements: str) -> None:
    """Do what an administrator of the database can do who removes the triggers first, and puts them back."""
    if isinstance(store.backend, SqliteBackend):
        with contextlib.closing(sqlite3.connect(store.backend.path)) as connection, connection:
            triggers = connection.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
            dropped = [f"DROP TRIGGER {name}" for name, _ in triggers]
            for statement in (*dropped, *statements, *(sql for _, sql in triggers)):
                connection.execute(statement)
        return
    with store.backend.engine.begin() as server:
        server.exec_driver_sql("SET LOCAL session_replication_role = replica")  # no triggers, no foreign keys
        for statement in statements:
            server.exec_driver_sql(statement)


def test_a_store_that_nobody_touched_is_whole(filled: Store) -> None:
    found = verify(filled, head=filled.head().hash)
    assert found.faults == []
    assert (found.rows, found.blobs) == (4, 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("statement", "fault"),
    [
        ("UPDATE audit SET payload = '{}' WHERE sequence = 3", r"entry 3 \(robot\.add robot 1 by a.*was changed"),
        ("UPDATE audit SET \"user\" = 'b' WHERE sequence = 5", r"entry 5 \(map\.add map 1 by b.*was changed"),
        ("DELETE FROM audit WHERE sequence = 3", r"entries 3 to 3 .*missing before entry 4"),
        ("DELETE FROM audit WHERE sequence = 5", r"map 1 has no entry"),
        ("UPDATE map SET state = 'released'", r"map 1 was changed after entry 5, without an entry"),
        ("DELETE FROM map", r"map 1 of entry 5 was removed without an entry"),
        ("UPDATE map SET cell_id = 9", r"map 1 names cell 9, which does not exist"),
        ("DELETE FROM cell", r"map 1 names cell 1, which does not exist"),
        ("UPDATE blob SET size = 1", r"has 7 bytes, expected 1; it belongs to map 1 \(entry 5\)"),
    ],
)
def test_rows_and_entries_that_were_tampered_with_are_found(filled: Store, statement: str, fault: str) -> None:
    tamper(filled, statement)
    found = verify(filled)
    assert any(re.search(fault, one) for one in found.faults), found.faults


def test_an_entry_with_a_new_hash_breaks_the_chain_after_it(filled: Store) -> None:
    tamper(filled, f"UPDATE audit SET hash = '{'1' * 64}' WHERE sequence = 3")
    faults = verify(filled).faults
    assert [fault for fault in faults if fault.startswith("entry 4") and "does not continue the chain" in fault]


def test_removing_the_last_entries_and_their_rows_is_found_by_a_head_from_outside(filled: Store) -> None:
    head = filled.head().hash
    tamper(filled, "DELETE FROM map", "DELETE FROM audit WHERE sequence = 5")
    found = verify(filled, head=head)
    assert f"no entry has the head {head}: entries were removed or replaced after it was noted" in found.faults
    if (anchor := filled.backend.anchor) is not None:
        assert [fault for fault in found.faults if "entries 5 to 5 are missing at the end" in fault]
        anchor.unlink()
        assert verify(filled).faults == []  # the limit of a chain: nothing inside shows it


def test_an_older_head_is_part_of_the_chain(filled: Store) -> None:
    head = filled.head()
    with filled.transaction("b") as change:
        change.note("report", {})
    found = verify(filled, head=head.hash)
    assert found.faults == []
    assert f"the head given is that of entry {head.sequence}" in found.notes[0]


@pytest.mark.parametrize("contents", [True, False])
def test_a_missing_blob_is_found(filled: Store, contents: bool) -> None:
    sha = _sha(filled)
    if filled.blobs is None:
        tamper(filled, f"UPDATE blob SET content = NULL WHERE sha256 = '{sha}'")
    else:
        filled.blobs.path(sha).unlink()
    assert verify(filled, contents=contents).faults == [f"blob {sha} is missing; it belongs to map 1 (entry 5)"]


def test_a_swapped_blob_is_found(filled: Store) -> None:
    """The other content has the same length, so only its hash tells."""
    sha = _sha(filled)
    if filled.blobs is None:
        text = "decode('" + b"the pam".hex() + "', 'hex')"
        tamper(filled, f"UPDATE blob SET content = {text} WHERE sha256 = '{sha}'")
    else:
        filled.blobs.path(sha).write_bytes(b"the pam")
    (fault,) = verify(filled).faults
    assert fault.startswith(f"blob {sha} was changed")
    assert verify(filled, contents=False).faults == []


def test_blobs_of_changes_that_were_not_completed_are_no_fault(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as store:
        assert store.blobs is not None
        store.blobs.put(b"left behind")
        found = verify(store)
    assert found.faults == []
    assert found.notes[-1].startswith("1 blobs belong to no row")


def test_removed_triggers_are_found(filled: Store) -> None:
    on = " ON audit" if filled.backend.engine.dialect.name == "postgresql" else ""
    name = "audit_no_change" if on else "audit_no_delete"
    with filled.backend.engine.begin() as connection:
        connection.exec_driver_sql(f"DROP TRIGGER {name}{on}")
    (fault,) = verify(filled).faults
    assert fault.startswith(f"the trigger {name} was removed")


def _sha(store: Store) -> str:
    with store.reading() as connection:
        return connection.execute(sa.select(schema.map.c.sha256)).scalar_one()
