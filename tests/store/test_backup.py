"""A backup is of one moment, restores on every engine, and is refused when it is damaged."""

from __future__ import annotations

import hashlib
import json
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import sqlalchemy as sa

from truepose.errors import FileError, StoreError
from truepose.store import records, schema
from truepose.store.backup import backup, restore
from truepose.store.store import Store
from truepose.store.verify import verify


def fill(store: Store) -> None:
    with store.transaction("Zoë") as change:
        cell = records.put_cell(change, "Zelle ö", b"[cell]")
        first = records.put_map(change, records.NewMap(cell, "m", b"map", "idw", {"mean_mm": 0.1}))
        records.put_map(change, records.NewMap(cell, "m", b"map 2", "idw", {}, parent_id=first))
        program = records.put_program(change, records.put_robot(change, "Zelle ö"), "P.src", bytes(range(256)))
        records.put_correction(change, records.NewCorrection(program, first, {}, b"out", b"record", 3, 2, 1))
        change.insert(schema.user, {"name": "b", "key": "b", "password": "hash", "disabled": False, "failures": 2})


def all_rows(store: Store) -> dict[str, list[object]]:
    with store.reading() as connection:
        return {
            table.name: [tuple(row) for row in connection.execute(sa.select(table).order_by(table.c.id))]
            for table in schema.AUDITED
        }


@pytest.mark.parametrize("target", ["sqlite", "postgresql", "postgresql with a folder"])
def test_a_backup_restores_on_every_engine(
    store: Store, target: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    fill(store)
    made = backup(store, tmp_path / "backup.zip")
    assert (made.head, made.blobs) == (store.head(), 6)
    address = str(tmp_path / "restored")
    if target.startswith("postgresql"):
        address = request.getfixturevalue("database")()
        if "folder" in target:
            address += f"{'&' if '?' in address else '?'}blobs={tmp_path / 'restored blobs'}"
    assert restore(tmp_path / "backup.zip", address) == made
    with Store.open(address) as restored:
        assert all_rows(restored) == all_rows(store)
        assert verify(restored, head=made.head.hash).faults == []
        assert restored.head().sequence == made.head.sequence + 1  # the restore itself
        with restored.reading() as connection:
            sha = connection.execute(sa.select(schema.program.c.sha256)).scalar_one()
        assert restored.read_blob(sha) == bytes(range(256))


@pytest.mark.exhaustive
@pytest.mark.parametrize("part", [1, 7, 2**20])
def test_lines_of_a_backup_may_end_anywhere_in_a_part(
    tmp_path: Path, part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("truepose.store.backup._PART", part)
    with Store.open(tmp_path / "store", create=True) as store:
        fill(store)
        backup(store, tmp_path / "backup.zip")
        restore(tmp_path / "backup.zip", tmp_path / "restored")
        with Store.open(tmp_path / "restored") as restored:
            assert all_rows(restored) == all_rows(store)


def test_a_backup_during_writes_is_of_one_moment(store: Store, tmp_path: Path) -> None:
    stop, written = threading.Event(), threading.Event()

    def write() -> None:
        n = 0
        while not stop.is_set():
            with store.transaction("writer") as change:
                records.put_cell(change, "cell", b"%d" % n)
            n += 1
            written.set()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        assert written.wait(60)
        made = [backup(store, tmp_path / f"{i}.zip") for i in range(3)]
    finally:
        stop.set()
        writer.join()
    for i, one in enumerate(made):
        assert restore(tmp_path / f"{i}.zip", tmp_path / f"{i}") == one
    assert verify(store).faults == []


def test_a_store_that_exists_is_not_restored_into(store: Store, address: str, tmp_path: Path) -> None:
    backup(store, tmp_path / "backup.zip")
    with pytest.raises(StoreError, match="exists already"):
        restore(tmp_path / "backup.zip", address)


def test_a_backup_of_an_older_version_is_migrated(tmp_path: Path, new_address: Callable[[], str]) -> None:
    """The columns are those of today; the backup is rewritten as the older program would have written it."""
    with Store.open(tmp_path / "new", create=True) as store:
        fill(store)
        backup(store, tmp_path / "backup.zip")
    rewrite(tmp_path / "backup.zip", lambda manifest: manifest.update(schema=1))
    address = new_address()
    restore(tmp_path / "backup.zip", address)
    with Store.open(address) as restored:
        assert verify(restored).faults == []


def rewrite(path: Path, change: Callable[[dict[str, object]], object], **members: bytes) -> None:
    """Write a backup again with a changed manifest and other members."""
    with zipfile.ZipFile(path) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    manifest = json.loads(found["manifest.json"])
    change(manifest)
    found |= {**members, "manifest.json": json.dumps(manifest).encode()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in found.items():
            archive.writestr(name, data)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    with Store.open(tmp_path / "store", create=True) as store:
        fill(store)
        backup(store, tmp_path / "backup.zip")
    return tmp_path / "backup.zip"


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_backup_is_refused(saved: Path, tmp_path: Path, part: float) -> None:
    data = saved.read_bytes()
    saved.write_bytes(data[: int(part * len(data))])
    with pytest.raises(FileError, match="not a complete backup"):
        restore(saved, tmp_path / "restored")
    assert not (tmp_path / "restored").exists()


@pytest.mark.parametrize(
    ("member", "data", "message"),
    [
        ("tables/map.jsonl", b"{}\n", "the rows of map were changed"),
        ("tables/audit.jsonl", b"", "the rows of audit were changed"),
        ("manifest.json", b"[]", "not a backup of a store"),
        ("manifest.json", b'{"format": "truepose store backup"}', "not a backup of a store"),
    ],
)
def test_a_changed_backup_is_refused(saved: Path, tmp_path: Path, member: str, data: bytes, message: str) -> None:
    with zipfile.ZipFile(saved) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(saved, "w") as archive:
        for name, content in {**found, member: data}.items():
            archive.writestr(name, content)
    with pytest.raises(FileError, match=message):
        restore(saved, tmp_path / "restored")


def test_a_swapped_blob_in_a_backup_is_refused(saved: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(saved) as archive:
        name = next(name for name in archive.namelist() if name.startswith("blobs/"))
    rewrite(saved, lambda _: None, **{name: b"swapped"})
    with pytest.raises(FileError, match=r"blob \w+ was changed after"):
        restore(saved, tmp_path / "restored")


def test_rows_that_were_forged_with_their_hash_do_not_match_the_audit_trail(saved: Path, tmp_path: Path) -> None:

    with zipfile.ZipFile(saved) as archive:
        rows = archive.read("tables/map.jsonl").replace(b'"draft"', b'"released"')
    forged = hashlib.sha256(rows).hexdigest()
    rewrite(saved, lambda manifest: manifest["sha256"].update(map=forged), **{"tables/map.jsonl": rows})
    with pytest.raises(FileError, match=r"2 faults, first: map 1 was changed"):
        restore(saved, tmp_path / "restored")
    with pytest.raises(StoreError, match="no store"):
        Store.open(tmp_path / "restored")


def test_rows_with_different_columns_are_refused(saved: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(saved) as archive:
        first, second = map(json.loads, archive.read("tables/map.jsonl").splitlines())
    del second["made_by"]
    rows = b"".join(json.dumps(row).encode() + b"\n" for row in (first, second))
    forged = hashlib.sha256(rows).hexdigest()
    rewrite(saved, lambda manifest: manifest["sha256"].update(map=forged), **{"tables/map.jsonl": rows})
    with pytest.raises(FileError, match="rows of map with different columns"):
        restore(saved, tmp_path / "restored")


def test_a_backup_of_a_newer_program_is_refused(saved: Path, tmp_path: Path) -> None:
    rewrite(saved, lambda manifest: manifest.update(schema=schema.VERSION + 1))
    with pytest.raises(FileError, match="update truepose"):
        restore(saved, tmp_path / "restored")


def test_a_backup_with_a_missing_blob_is_not_written(tmp_path: Path) -> None:
    with Store.open(tmp_path / "store", create=True) as store:
        fill(store)
        assert store.blobs is not None
        store.blobs.path(next(store.blobs.list())).unlink()
        with pytest.raises(FileError, match="blob is missing"):
            backup(store, tmp_path / "backups" / "backup.zip")
    assert list((tmp_path / "backups").iterdir()) == []
