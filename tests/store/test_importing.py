"""A folder taken into a store: each file once, each object whole, a reason for each file left out; on both engines."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sa
from tests.programs.test_urp import correct, lay, move, points
from tests.store.people import PASSWORD, join
from tests.store.plant import N, plant

import truepose as tp
from truepose.error_map import update_map
from truepose.errors import RefusedError
from truepose.store import schema, users
from truepose.store.access import Identity
from truepose.store.importing import import_folder
from truepose.store.releases import recall_map
from truepose.store.store import Store


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plant's folder with a corrected program, its record and a verification."""
    folder = tmp_path_factory.mktemp("source") / "robot17"
    shutil.copytree(plant().folder, folder)
    error_map = tp.load_map(folder / "map.truepose")
    corrected = tp.correct_program(folder / "part.csv", error_map, on_guard="skip", accept_weak_map=True)
    corrected.write(folder / "corrected")
    readings = tp.trackers.read_measurement(folder / "readings.txt")
    found = tp.verify_program(
        error_map, folder / "corrected" / "part.csv", readings, tolerance_mm=0.5, uncertainty_mm=0.01
    )
    (folder / "verified.json").write_text(json.dumps(found.to_dict(), indent=1))
    return folder


@pytest.fixture
def folder(source: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(source, tmp_path / "plant" / "robot17"))


@pytest.fixture
def team(store: Store, quick_hashes) -> dict[str, Identity]:
    return join(store, anna=["measure"], eva=["release"])


def rows(store: Store, table: sa.Table) -> list[dict]:
    with store.reading() as connection:
        return [dict(row) for row in connection.execute(sa.select(table).order_by(table.c.id)).mappings()]


def test_a_folder_is_taken_with_all_that_belongs_together(store, team, folder):
    done = import_folder(store, team["anna"], folder.parent)
    assert done.left_out == []
    assert done.counts() == {"cell": 1, "samples": 2, "map": 2, "correction": 1, "verification": 1}
    (cell,), (robot,), maps = (rows(store, table) for table in (schema.cell, schema.robot, schema.map))
    assert (cell["name"], robot["name"]) == ("robot17", "robot17")
    assert {one["name"]: one["state"] for one in maps} == {"map": "draft", "updated": "draft"}
    assert {one["made_by"] for one in maps} == {"anna"}
    assert store.read_blob(maps[0]["sha256"]) == (folder / "map.truepose").read_bytes()
    (link, *_), sets = rows(store, schema.map_reading_set), rows(store, schema.reading_set)
    named = {one["id"]: one["name"] for one in sets}
    assert named[link["reading_set_id"]] == "samples.csv"
    (correction,) = rows(store, schema.correction)
    assert (correction["targets"], correction["refused"], correction["draft"]) == (N, 0, True)
    assert correction["corrected"] >= 1
    assert store.read_blob(correction["output_sha256"]) == (folder / "corrected" / "part.csv").read_bytes()
    (verification,) = rows(store, schema.verification)
    assert verification["correction_id"] == correction["id"]
    assert [one["program"] for one in recall_map(store, team["eva"], "map").corrections] == ["part.csv"]


def test_a_second_import_adds_nothing(store, team, folder):
    first = import_folder(store, team["anna"], folder)
    head = store.head()
    again = import_folder(store, team["anna"], folder)
    assert (again.taken, len(again.known)) == ([], len(first.taken))
    assert store.head() == head


def test_one_file_twice_under_two_names_is_one_row(store, team, folder):
    shutil.copy(folder / "map.truepose", folder / "same.truepose")
    done = import_folder(store, team["anna"], folder)
    assert [one.reason for one in done.left_out] == [f"has the same content as {folder / 'map.truepose'}"]
    shutil.copytree(folder, folder.parent / "copy", ignore=shutil.ignore_patterns("cell.toml"))
    shutil.copy(folder / "cell.toml", folder.parent / "cell.toml")
    assert not {one.kind for one in import_folder(store, team["anna"], folder.parent).taken} & {"map", "correction"}
    assert len(rows(store, schema.map)) == 2


@pytest.mark.exhaustive
def test_a_changed_cell_file_is_a_new_version_and_an_old_one_is_found(store, team, folder):
    import_folder(store, team["anna"], folder)
    cell = folder / "cell.toml"
    old = cell.read_text()
    cell.write_text(old + "\n# changed\n")
    done = import_folder(store, team["anna"], folder)
    assert [one.kind for one in done.taken] == ["cell"]
    cell.write_text(old)
    assert import_folder(store, team["anna"], folder).taken == []
    assert [one["version"] for one in rows(store, schema.cell)] == [1, 2]


def test_an_object_is_taken_whole_or_not_at_all(store, team, folder):
    """A record without its original program leaves no program, no correction, and no entry in the trail."""
    (folder / "part.csv").unlink()
    done = import_folder(store, team["anna"], folder)
    reasons = {one.path.name: one.reason for one in done.left_out}
    assert list(reasons) == ["part.corrections.json"]
    assert "the original file of" in reasons["part.corrections.json"]
    assert "is neither beside it nor in the store" in reasons["part.corrections.json"]
    assert rows(store, schema.program) == rows(store, schema.correction) == []
    shutil.copy(plant().program, folder / "part.csv")
    assert [one.kind for one in import_folder(store, team["anna"], folder).taken] == ["correction", "verification"]
    (verification,) = rows(store, schema.verification)  # that of the first import, which now has its correction
    assert verification["correction_id"] == rows(store, schema.correction)[0]["id"]


def test_a_correction_without_its_map_waits_for_it(store, team, folder, tmp_path):
    aside = tmp_path / "map.truepose"
    (folder / "map.truepose").rename(aside)
    reasons = [one.reason for one in import_folder(store, team["anna"], folder).left_out]
    assert len(reasons) == 2  # the record and the verification
    assert all("is not in the store; import the map first" in reason for reason in reasons)
    aside.rename(folder / "map.truepose")
    assert import_folder(store, team["anna"], folder).counts() == {"map": 1, "correction": 1, "verification": 1}


@pytest.mark.parametrize("whole", [True, False])
def test_a_correction_of_a_corrected_program_is_left_out(whole, store, team, folder, tmp_path, monkeypatch):
    """Somebody corrected a copy on a machine that did not know it; its record names the map and the date."""
    import_folder(store, team["anna"], folder)
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "state of another machine"))
    other = folder.parent / "other"
    other.mkdir()
    copied = (folder / "corrected" / "part.csv").read_text()
    (other / "copy.csv").write_text(copied if whole else copied + "\n")
    error_map = tp.load_map(shutil.copy(folder / "map.truepose", tmp_path))
    twice = tp.correct_program(other / "copy.csv", error_map, on_guard="skip", accept_weak_map=True)
    twice.write(other / "twice")
    done = import_folder(store, team["anna"], other)
    (left,) = done.left_out
    assert left.path.name == "copy.corrections.json"
    assert re.search(
        r"(was corrected already|holds 6 positions that were corrected): "
        r"on 20\d\d-\d\d-\d\d with the map map \(\w{12}\), from part\.csv",
        left.reason,
    )
    assert len(rows(store, schema.correction)) == 1
    assert import_folder(store, team["anna"], folder).left_out == []  # the first correction itself stays known


@pytest.mark.exhaustive
def test_an_updated_map_has_its_parent_and_the_samples_of_both(store, team, folder):
    """Also of a map that was imported alone; a map that was fitted anew with all samples has no parent."""
    (folder / "a").mkdir()
    (folder / "updated.truepose").rename(folder / "a" / "april.truepose")  # read before its parent
    error_map = tp.load_map(folder / "map.truepose")
    both = tp.load_map(folder / "a" / "april.truepose").samples
    tp.fit_cell(error_map.cell, both, "ordinary-kriging").save(folder / "anew.truepose")
    assert import_folder(store, team["anna"], folder).counts()["map"] == 3
    update_map(error_map, tp.read_samples(folder / "later.csv"), "station").save(folder / "moved.truepose")
    assert import_folder(store, team["anna"], folder).counts() == {"map": 1}
    maps = {one["name"]: one for one in rows(store, schema.map)}
    parents = {name: one["parent_id"] for name, one in maps.items()}
    march = maps["map"]["id"]
    assert parents == {"map": None, "april": march, "anew": None, "moved": march}
    named = {one["id"]: one["name"] for one in rows(store, schema.reading_set)}
    links = rows(store, schema.map_reading_set)
    of_april = {named[one["reading_set_id"]] for one in links if one["map_id"] == maps["april"]["id"]}
    assert of_april == {"samples.csv", "later.csv"}
    assert [one["name"] for one, _ in recall_map(store, team["eva"], "map").updated] == ["april", "moved"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("packed", [False, True])
def test_a_program_of_a_teach_pendant_is_taken_with_its_record(store, team, folder, packed):
    """A .urp, whose text is packed in the file; its original lies beside it, or in the .zip of a backup."""
    original = lay(folder, [move(points())])
    sha = hashlib.sha256((folder / "map.truepose").read_bytes()).hexdigest()
    replace(correct(original), map_hash=sha).write(folder / "corrected")
    if packed:
        with zipfile.ZipFile(folder / "backup.zip", "w") as archive:
            archive.write(original, "programs/cell.urp")
        original.unlink()
    done = import_folder(store, team["anna"], folder)
    assert done.left_out == []
    assert done.counts()["correction"] == 2
    outputs = [store.read_blob(one["output_sha256"]) for one in rows(store, schema.correction)]
    assert (folder / "corrected" / "cell.urp").read_bytes() in outputs


def test_files_that_are_no_objects_are_left_out_with_the_reason(store, team, folder):
    (folder / "bad.truepose").write_bytes(b"PK\x03\x04")
    (folder / "lonely").mkdir()
    samples = folder.parent / "elsewhere" / "samples.csv"
    samples.parent.mkdir()
    lines = (folder / "samples.csv").read_text().splitlines()
    samples.write_text("\n".join(lines[:40]) + "\n")
    done = import_folder(store, team["anna"], folder.parent)
    reasons = {one.path.name: one.reason for one in done.left_out}
    assert set(reasons) == {"bad.truepose", "samples.csv"}
    assert "no cell file" in reasons["samples.csv"]


def test_a_map_alone_brings_its_cell(store, team, folder):
    assert import_folder(store, team["anna"], folder / "map.truepose").counts() == {"map": 1}
    assert [one["name"] for one in rows(store, schema.cell)] == ["robot17"]


def test_only_those_may_import_who_may_add(store, team, folder):
    with pytest.raises(RefusedError, match="needs the role measure or program"):
        import_folder(store, team["eva"], folder)


def test_a_user_removed_during_an_import_stops_it(store, team, folder):
    """What was taken before is whole; nothing after the removal is taken."""
    counted = []

    def progress(done: int, total: int) -> None:
        counted.append(done)
        if done == total:
            users.set_disabled(store, team["chief"], "anna", True)

    with pytest.raises(RefusedError, match="anna is disabled"):
        import_folder(store, team["anna"], folder, progress)
    assert counted
    assert rows(store, schema.cell) == []
    assert PASSWORD


def test_a_map_is_kept_with_the_number_of_readings_left_out(store, team, tmp_path):
    virtual = tp.VirtualCell("paper", seed=5)
    samples = virtual.measure(virtual.design(30, seed=1), seed=1)
    samples.p_meas[7, 0] += 590.0
    folder = tmp_path / "gross"
    folder.mkdir()
    (folder / "cell.toml").write_text(virtual.cell.to_toml())
    tp.fit_cell(tp.load_cell(folder / "cell.toml"), samples, "calibration").save(folder / "map.truepose")
    import_folder(store, team["anna"], folder)
    (kept,) = rows(store, schema.map)
    figures = json.loads(kept["figures"])
    assert (figures["n"], figures["left_out"]) == (29, 1)
