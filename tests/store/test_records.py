"""What a plant keeps is added once, found again and listed by pages."""

from __future__ import annotations

import pytest

from truepose.errors import DataError
from truepose.store import records, rows, schema
from truepose.store.change import Change
from truepose.store.store import Store


def fitted(change: Change, data: bytes = b"map", **more: object) -> int:
    cell = records.put_cell(change, "Cell 4", b"[cell]")
    campaign = records.put_campaign(change, cell, "spring", {"drift_mm": 0.01})
    readings = records.put_reading_set(change, campaign, "samples.csv", b"x,y", poses=2, source=b"raw")
    new = records.NewMap(cell, "map", data, "kinematic-kriging", {"after_mean_mm": 0.08}, (readings, readings))
    return records.put_map(change, new)


def corrected(change: Change, map_id: int, n: int) -> list[int]:
    robot = records.put_robot(change, "Cell 4")
    made = []
    for i in range(n):
        program = records.put_program(change, robot, f"P{i}.src", b"DEF P()", "krl")
        new = records.NewCorrection(program, map_id, {"limit": 1.0}, b"out %d" % i, b"record %d" % i, 10, 9, 1)
        made.append(records.put_correction(change, new))
    return made


def test_one_file_given_twice_is_one_row(store: Store) -> None:
    with store.transaction("a") as change:
        first = fitted(change)
        assert len(corrected(change, first, 2)) == 2
    head = store.head()
    with store.transaction("a") as change:
        assert fitted(change) == first
        corrected(change, first, 2)
    assert store.head() == head


def test_a_changed_cell_file_is_a_version(store: Store) -> None:
    with store.transaction("a") as change:
        ids = [records.put_cell(change, "cell 4", data) for data in (b"1", b"1", b"2", b"1")]
    assert ids[0] == ids[1]
    assert len(set(ids)) == 3
    with store.reading() as connection:
        newest = rows.newest_cells(connection)
        assert [(row["version"], row["robot"], row["site"]) for row in newest] == [(3, "cell 4", "main")]


@pytest.mark.parametrize("other", ["ZELLE ö", "zelle o\u0308", " Zelle Ö"])
def test_names_that_differ_in_case_or_unicode_form_are_one(store: Store, other: str) -> None:
    with store.transaction("a") as change:
        first = records.put_cell(change, "Zelle ö", b"1")
        assert records.put_cell(change, other, b"1") == first


@pytest.mark.parametrize("bad", ["", "  ", "a\nb", "a\0b", "\u202eabc", "x" * 201])
def test_names_that_cannot_be_shown_are_refused(store: Store, bad: str) -> None:
    with pytest.raises(DataError, match="name"), store.transaction("a") as change:
        records.put_site(change, bad)


def test_a_list_is_read_page_by_page(store: Store) -> None:
    with store.transaction("a") as change:
        map_id = fitted(change)
        made = corrected(change, map_id, 7)
        corrected(change, fitted(change, b"another map"), 1)
    with store.reading() as connection:
        found, after = [], None
        while True:
            page = rows.recall(connection, map_id, after=after, limit=3)
            found += page.rows
            if (after := page.following) is None:
                break
        assert [row["id"] for row in found] == made[::-1]
        assert {(row["robot"], row["draft"]) for row in found} == {("Cell 4", True)}
        assert found[0]["options"] == {"limit": 1.0}
        assert rows.page(connection, schema.correction, map_id=map_id, limit=7).following is None
        with pytest.raises(DataError, match="1 to 1000 rows"):
            rows.page(connection, schema.correction, limit=1001)


def test_a_correction_with_a_released_map_is_no_draft(store: Store) -> None:
    with store.transaction("a") as change:
        map_id = fitted(change)
        change.update(schema.map, map_id, {"state": "released"}, "map.release")
        (made,) = corrected(change, map_id, 1)
        assert change.row(schema.correction, made)["draft"] is False


def test_a_map_knows_its_reading_sets_and_figures(store: Store) -> None:
    with store.transaction("a") as change:
        map_id = fitted(change)
    with store.reading() as connection:
        assert rows.get(connection, schema.map, id=map_id)["figures"] == {"after_mean_mm": 0.08}
        (readings,) = rows.reading_sets_of(connection, map_id)
        assert readings["poses"] == 2
    assert store.read_blob(readings["source_sha256"]) == b"raw"


def test_a_verification_needs_its_object(store: Store) -> None:
    with store.transaction("a") as change:
        map_id = fitted(change)
        first = records.put_verification(change, "validation", {"mean_mm": 0.1}, map_id=map_id)
        assert records.put_verification(change, "validation", {"mean_mm": 0.1}, map_id=map_id) == first
    with pytest.raises(DataError, match="of a map or of a correction"), store.transaction("a") as change:
        records.put_verification(change, "validation", {})


def test_a_job_ends_once(store: Store) -> None:
    with store.transaction("a") as change:
        job = records.put_job(change, "correct", {"folder": "programs"})
        records.move_job(change, job, "running")
        records.move_job(change, job, "done", {"n": 3})
        assert change.row(schema.job, job)["ended"]
    with pytest.raises(DataError, match="job 1 is done"), store.transaction("a") as change:
        records.move_job(change, job, "running")


def test_what_is_not_there_is_named(store: Store) -> None:
    with store.reading() as connection, pytest.raises(DataError, match="no map with sha256 abc"):
        rows.get(connection, schema.map, sha256="abc")
