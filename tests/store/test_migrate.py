"""Stores of older versions are brought to the newest; those of newer versions are refused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from truepose.errors import StoreError
from truepose.programs.history import hash_rows
from truepose.store import migrate, records, rows, schema
from truepose.store.address import backend_of
from truepose.store.backup import restore
from truepose.store.change import Change
from truepose.store.corrected import earlier_corrections
from truepose.store.store import Store
from truepose.store.verify import verify

OUT = hashlib.sha256(b"out").hexdigest()
RECORD = json.dumps(
    {
        "files": [{"file": "P.src", "sha256_before": hashlib.sha256(b"DEF P()").hexdigest(), "sha256_after": OUT}],
        "targets": [
            {"file": "P.src", "before_mm": [1.0, 2.0, 3.0], "after_mm": [1.1, 2.0, 3.0]},
            {"file": "P.src", "before_mm": [4.0, 2.0, 3.0], "after_mm": [4.0, 2.0, 3.0]},
            {"file": "P.src", "before_mm": [None, None, None], "after_mm": [None, None, None]},
        ],
    }
).encode()


def old_store(address: str, version: int) -> Store:
    """Make a store of an older version with rows, as its program would have."""
    store = Store(backend_of(address))
    store.backend.prepare()
    with store.backend.writer() as connection:
        migrate.upgrade(connection, version)
        change = Change(connection, "a", store.blobs)
        change.note("store.init", {"schema": version})
        cell = records.put_cell(change, "Cell 4", b"[cell]")
        map_id = records.put_map(change, records.NewMap(cell, "m", b"map", "idw", {"mean_mm": 0.1}))
        program = records.put_program(change, records.put_robot(change, "Cell 4"), "P.src", b"DEF P()")
        records.put_correction(change, records.NewCorrection(program, map_id, {}, b"out", RECORD, 3, 2, 1))
        records.put_correction(change, records.NewCorrection(program, map_id, {}, b"out 2", b"no record", 3, 2, 1))
    return store


@pytest.mark.parametrize("version", range(1, schema.VERSION))
def test_older_stores_are_migrated_with_their_rows(new_address: Callable[[], str], version: int) -> None:
    address = new_address()
    with old_store(address, version) as store:
        before = store.head()
    with pytest.raises(StoreError, match=f"schema version {version}.*truepose store migrate"):
        Store.open(address)
    with Store.unchecked(address) as store:
        assert store.migrate("b") == (version, schema.VERSION)
        assert store.migrate("b") == (schema.VERSION, schema.VERSION)
    with Store.open(address) as store, store.reading() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []
        assert [row["targets"] for row in rows.recall(connection, 1).rows] == [3, 3]
        (position,) = connection.execute(sa.select(schema.position)).all()
        assert position.hash == hash_rows(np.array([[1.1, 2.0, 3.0]])).view(np.int64)[0]
        assert position.correction_id == 1
        assert verify(store, head=before.hash).faults == []
        assert store.head().sequence == before.sequence + 1


@pytest.mark.parametrize("version", range(1, schema.VERSION))
def test_a_store_that_an_older_program_wrote_is_taken_over(new_address: Callable[[], str], version: int) -> None:
    """The folder ``versions`` holds stores that the program of each version wrote, as backups."""
    address = new_address()
    moved = restore(Path(__file__).with_name("versions") / f"v{version}.zip", address)
    with Store.open(address) as store, store.reading() as connection:
        found = verify(store, head=moved.head.hash)
        assert (found.faults, found.head.sequence) == ([], moved.head.sequence + 1)
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []
        march = rows.get(connection, schema.map, name="march")
        assert march["state"] == "released"
        assert [row["program"] for row in rows.recall(connection, march["id"]).rows] == ["home.src", "rib01.src"]
        outputs = [row["output_sha256"] for row in rows.recall(connection, march["id"]).rows]
        made = earlier_corrections(connection, outputs)
        assert [one.program for one in made.values()] == ["rib01.src"]  # the other was left as it was


def test_a_store_of_a_newer_program_is_refused(store: Store, address: str) -> None:
    newer = schema.VERSION + 1
    with store.backend.engine.begin() as connection:
        connection.execute(sa.text(f"UPDATE alembic_version SET version_num = '{newer}'"))
    with pytest.raises(StoreError, match=f"version {newer}.*update truepose"):
        Store.open(address)
    with pytest.raises(StoreError, match="update truepose"):
        store.migrate("a")


def test_every_version_has_a_migration() -> None:
    found = sorted(path.name.partition("_")[0] for path in (migrate.SCRIPTS / "versions").glob("v*.py"))
    assert found == [f"v{number}" for number in range(1, schema.VERSION + 1)]
