"""Release with four eyes and the password, supersession, withdrawal, and the recall list, on both engines."""

from __future__ import annotations

import pytest
from tests.store.people import PASSWORD, join

from truepose.errors import DataError, RefusedError
from truepose.store import records, releases, rows, schema, users
from truepose.store.access import Identity, changing, viewing
from truepose.store.releases import check_usable, find_map, recall_map, release_map, withdraw_map
from truepose.store.store import Store

WRONG = "not the password"


@pytest.fixture
def team(store: Store, quick_hashes) -> dict[str, Identity]:
    """An administrator, Anna who makes maps, Ben who corrects, Eva and Otto who release."""
    return join(store, anna=["measure", "program"], ben=["program"], eva=["release"], otto=["release", "measure"])


def new_map(store: Store, by: Identity, name: str, parent: int | None = None, cell: str = "cell 17") -> dict:
    with changing(store, by, "fit") as change:
        cell_id = records.put_cell(change, cell, f"[robot] # {cell}".encode())
        made = records.NewMap(cell_id, name, f"map {cell} {name}".encode(), "kinematic-kriging", {}, (), parent)
        return change.row(schema.map, records.put_map(change, made))


def new_correction(store: Store, by: Identity, map_id: int, name: str) -> int:
    with changing(store, by, "correct") as change:
        robot = records.put_robot(change, "cell 17")
        program = records.put_program(change, robot, name, f"DEF {name}".encode())
        output, record = (f"{kind} {name} {map_id}".encode() for kind in ("output", "record"))
        new = records.NewCorrection(program, map_id, {}, output, record, targets=9, corrected=8, refused=0)
        return records.put_correction(change, new)


def state(store: Store, by: Identity, named: str) -> str:
    with viewing(store, by) as connection:
        return find_map(connection, named)["state"]


def test_a_release_keeps_who_when_and_what_it_means(store, team):
    made = new_map(store, team["anna"], "march")
    found = release_map(store, team["eva"], "march", PASSWORD, comment="checked with 40 poses")
    assert (found.map["state"], found.superseded) == ("released", [])
    with viewing(store, team["ben"]) as connection:
        (signature,) = releases.signatures(connection, made["id"])
    assert signature["user"] == "eva"
    assert signature["second_user_id"] == team["anna"].user_id
    assert signature["meaning"] == releases.MEANINGS["release"]
    assert signature["reason"] == "checked with 40 poses"
    assert signature["created"].endswith("Z")


def test_who_made_a_map_cannot_release_it(store, team):
    new_map(store, team["otto"], "own")
    with pytest.raises(RefusedError, match=r"otto made the map own \([0-9a-f]{12}\), so somebody else must release it"):
        release_map(store, team["otto"], "own", PASSWORD)
    assert state(store, team["otto"], "own") == "draft"
    release_map(store, team["eva"], "own", PASSWORD)


def test_a_wrong_password_releases_and_withdraws_nothing(store, team):
    new_map(store, team["anna"], "march")
    with pytest.raises(RefusedError, match="password is wrong"):
        release_map(store, team["eva"], "march", WRONG)
    with pytest.raises(RefusedError, match="password is wrong"):
        withdraw_map(store, team["eva"], "march", WRONG, "reason")
    assert state(store, team["eva"], "march") == "draft"


def test_only_the_role_release_releases_and_withdraws(store, team):
    new_map(store, team["otto"], "march")
    for attempt in (
        lambda: release_map(store, team["anna"], "march", PASSWORD),
        lambda: withdraw_map(store, team["anna"], "march", PASSWORD, "reason"),
    ):
        with pytest.raises(RefusedError, match="needs the role release"):
            attempt()


def test_a_releaser_removed_in_the_session_cannot_release(store, team):
    new_map(store, team["anna"], "march")
    users.set_roles(store, team["chief"], "eva", ["read"])
    with pytest.raises(RefusedError, match="needs the role release"):
        release_map(store, team["eva"], "march", PASSWORD)
    users.set_disabled(store, team["chief"], "eva", True)
    with pytest.raises(RefusedError, match="disabled"):
        release_map(store, team["eva"], "march", PASSWORD)


def test_a_newer_release_supersedes_the_older_of_the_same_cell_only(store, team):
    for name, cell in (("march", "cell 17"), ("other", "cell 18"), ("april", "cell 17")):
        new_map(store, team["anna"], name, cell=cell)
        found = release_map(store, team["eva"], name, PASSWORD)
    assert [one["name"] for one in found.superseded] == ["march"]
    assert [state(store, team["ben"], name) for name in ("march", "april", "other")] == [
        "superseded",
        "released",
        "released",
    ]
    with pytest.raises(RefusedError, match="is superseded; only a draft can be released"):
        release_map(store, team["eva"], "march", PASSWORD)


def test_a_new_version_of_the_cell_file_is_the_same_cell(store, team):
    new_map(store, team["anna"], "march")
    release_map(store, team["eva"], "march", PASSWORD)
    with changing(store, team["anna"], "fit") as change:
        version = records.put_cell(change, "CELL 17", b"[robot] # changed", robot="cell 17")
        records.put_map(change, records.NewMap(version, "april", b"map april", "kriging", {}))
    assert [one["name"] for one in release_map(store, team["eva"], "april", PASSWORD).superseded] == ["march"]


def test_an_older_draft_cannot_replace_a_newer_release(store, team):
    new_map(store, team["anna"], "old")
    new_map(store, team["anna"], "new")
    release_map(store, team["eva"], "new", PASSWORD)
    with pytest.raises(RefusedError, match=r"the map new .* is newer and released"):
        release_map(store, team["eva"], "old", PASSWORD)
    withdraw_map(store, team["eva"], "new", PASSWORD, "wrong tool")
    assert release_map(store, team["eva"], "old", PASSWORD).map["state"] == "released"


def test_withdrawing_needs_a_reason_and_is_for_good(store, team):
    made = new_map(store, team["anna"], "march")
    with pytest.raises(DataError, match="--reason"):
        withdraw_map(store, team["eva"], "march", PASSWORD, " ")
    release_map(store, team["eva"], "march", PASSWORD)
    withdraw_map(store, team["otto"], "march", PASSWORD, "the reflector\nwas loose")
    with pytest.raises(RefusedError, match="withdrawn already"):
        withdraw_map(store, team["eva"], "march", PASSWORD, "again")
    with pytest.raises(RefusedError, match="only a draft"):
        release_map(store, team["eva"], "march", PASSWORD)
    with viewing(store, team["ben"]) as connection:
        last = releases.signatures(connection, made["id"])[-1]
    assert (last["user"], last["reason"]) == ("otto", "the reflector was loose")


def test_a_withdrawn_map_lists_every_program_and_those_of_its_updates(store, team):
    first = new_map(store, team["anna"], "march")
    other = new_map(store, team["anna"], "other")
    second = new_map(store, team["anna"], "april", first["id"])
    third = new_map(store, team["anna"], "may", second["id"])
    for made, names in ((first, "ab"), (other, "c"), (third, "d")):
        for name in names:
            new_correction(store, team["ben"], made["id"], name)
    found = withdraw_map(store, team["eva"], "march", PASSWORD, "wrong tool")
    assert found.map["state"] == "withdrawn"
    assert [(one["program"], one["made_by"], one["robot"]) for one in found.corrections] == [
        ("b", "ben", "cell 17"),
        ("a", "ben", "cell 17"),
    ]
    assert all(len(one["output_sha256"]) == 64 and one["created"] for one in found.corrections)
    assert [(one["name"], [c["program"] for c in some]) for one, some in found.updated] == [
        ("april", []),
        ("may", ["d"]),
    ]
    assert recall_map(store, team["ben"], "march") == found
    assert [one["name"] for one, _ in recall_map(store, team["ben"], "april").updated] == ["may"]


def test_a_recall_is_complete_and_its_pages_have_the_same_rows(store, team):
    made = new_map(store, team["anna"], "march")
    for k in range(7):
        new_correction(store, team["ben"], made["id"], f"p{k}")
    every = recall_map(store, team["ben"], "march").corrections
    assert [one["program"] for one in every] == [f"p{k}" for k in reversed(range(7))]
    with viewing(store, team["ben"]) as connection:
        first = rows.recall(connection, made["id"], limit=4)
        second = rows.recall(connection, made["id"], after=first.following, limit=4)
    assert [{k: v for k, v in one.items() if k != "options"} for one in [*first.rows, *second.rows]] == every


def test_maps_are_found_by_hash_part_or_name(store, team):
    made = new_map(store, team["anna"], "Märch")
    new_map(store, team["anna"], "twice")
    new_map(store, team["anna"], "twice", cell="cell 18")
    with viewing(store, team["ben"]) as connection:
        for named in (made["sha256"], made["sha256"][:8].upper(), "Märch", "MÄRCH", " Ma\u0308rch"):
            assert find_map(connection, named)["id"] == made["id"]
        with pytest.raises(DataError, match=r"2 maps of the store are named 'twice': .*; name one by its SHA-256"):
            find_map(connection, "twice")
        for named in (made["sha256"][:7], "nothing", "%", ""):
            with pytest.raises(DataError, match="the store has no map"):
                find_map(connection, named)


@pytest.mark.parametrize(
    ("of", "usable", "released_only"),
    [("draft", True, False), ("released", True, True), ("superseded", True, False), ("withdrawn", False, False)],
)
def test_states_that_may_correct(of, usable, released_only):
    row = {"name": "march", "sha256": "a" * 64, "state": of}
    for only, allowed in ((False, usable), (True, released_only)):
        if allowed:
            check_usable(row, released_only=only)
        else:
            with pytest.raises(RefusedError, match=r"the map march \(aaaaaaaaaaaa\) is (a )?" + of):
                check_usable(row, released_only=only)
