"""Maps of the store in the browser: jobs that act as users, four eyes, withdrawal, recall, audit trail and drift."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.needs import needed

needed("alembic", "'truepose[store]'")

from tests.web.conftest import ended
from tests.web.people import PASSWORD, browsers

from truepose.store.access import log_in
from truepose.store.importing import import_folder
from truepose.store.store import Store
from truepose.store.users import set_disabled
from truepose.web import Workspace
from truepose.web.team.team import Team

WRONG = "another long password"


@pytest.fixture
def opened(workspace: Workspace, store: Store, tmp_path: Path) -> Iterator[Callable[..., TestClient]]:
    """Return a function that returns a browser of a user; jobs run."""
    browser = browsers(workspace, Team(store, str(tmp_path / "store")))
    with browser():
        yield browser


@pytest.fixture
def taken_in(workspace: Workspace, store: Store) -> str:
    """The SHA-256 of the map of the cell, which the user ``both`` has taken in with the files of the cell."""
    import_folder(store, log_in(store, "both", PASSWORD), workspace.cells()[0].folder)
    with store.reading() as connection:
        from truepose.store.rows import page
        from truepose.store.schema import map as table

        return str(page(connection, table).rows[-1]["sha256"])


def signed(client: TestClient, sha: str, what: str = "", *, reason: str = "", password: str = PASSWORD) -> Any:
    return client.post(f"/api/v1/releases/{sha}{what}", json={"password": password, "reason": reason})


def state_of(client: TestClient, cell: str, sha: str) -> dict[str, Any]:
    maps = client.get(f"{cell}/releases").json()["maps"]
    return next(one for one in maps if one["sha256"] == sha)


def test_a_map_is_released_by_somebody_else_with_the_password(
    opened: Callable[..., TestClient], cell: str, taken_in: str, workspace: Workspace
) -> None:
    both, quality = opened("both"), opened("quality")
    states = quality.get(f"{cell}/states").json()
    assert states["maps"] == {taken_in: "draft"}
    assert set(states["files"].values()) == {"draft"}
    assert state_of(quality, cell, taken_in)["state"] == "draft"
    own = signed(both, taken_in)
    assert own.status_code == 409
    assert "somebody else must release it" in own.json()["detail"]
    assert signed(quality, taken_in, password=WRONG).status_code == 403
    assert signed(opened("reader"), taken_in).status_code == 403
    assert signed(quality, "0" * 64).status_code == 422
    assert state_of(quality, cell, taken_in)["state"] == "draft"
    assert signed(quality, taken_in, reason="checked").status_code == 204
    found = state_of(opened("reader"), cell, taken_in)
    assert found["state"] == "released"
    states = quality.get(f"{cell}/states").json()
    assert states["maps"] == {taken_in: "released"}
    (record,) = workspace.cells()[0].files("record")
    head = record.path.read_text("utf-8").replace('"on_guard"', '"map_state": "draft",\n"on_guard"', 1)
    record.path.write_text(head, "utf-8")
    files = quality.get(f"{cell}/states").json()["files"]
    assert files.pop(record.id) == "draft"  # the correction stays what it was
    assert set(files.values()) == {"released"}
    assert [(one["user"], one["reason"]) for one in found["signatures"]] == [("quality", "checked")]


def test_a_withdrawn_map_lists_the_programs_that_it_corrected(
    opened: Callable[..., TestClient], cell: str, taken_in: str
) -> None:
    quality = opened("quality")
    assert signed(quality, taken_in, "/withdrawal").status_code == 422
    listed = signed(quality, taken_in, "/withdrawal", reason="the tool was bent").json()
    assert {one["program"].rpartition("/")[2] for one in listed} == {"panel.dat"}
    assert all(one["draft"] for one in listed)
    assert quality.get(f"/api/v1/releases/{taken_in}/recall").json() == listed
    table = quality.get(f"/api/v1/releases/{taken_in}/recall.csv")
    assert table.headers["content-disposition"].startswith("attachment")
    assert len(table.text.splitlines()) == 1 + len(listed)
    assert "panel.dat" in table.text
    assert state_of(quality, cell, taken_in)["state"] == "withdrawn"
    assert signed(quality, taken_in).status_code == 409


def test_the_audit_trail_of_a_cell_and_its_head_are_shown(
    opened: Callable[..., TestClient],
    cell: str,
    taken_in: str,
    store: Store,
) -> None:
    quality = opened("quality")
    signed(quality, taken_in)
    part = quality.get(f"{cell}/audit").json()
    entries = part["rows"]
    assert part["total"] == len(entries)
    actions = [(one["action"], one["user"]) for one in entries]
    assert ("map.release", "quality") in actions
    assert ("map.add", "both") in actions
    assert not any(action.startswith(("user.", "role.", "login")) for action, _ in actions)
    sequences = [one["sequence"] for one in entries]
    assert sequences == sorted(sequences, reverse=True)
    older = quality.get(f"{cell}/audit", params={"offset": 3, "limit": 1}).json()
    assert ([one["sequence"] for one in older["rows"]], older["total"]) == ([sequences[3]], part["total"])
    found = quality.get(f"{cell}/releases").json()
    assert (found["sequence"], found["head"]) == (store.head().sequence, store.head().hash)


FILTERS: list[tuple[dict[str, str], Callable[[dict[str, Any]], bool]]] = [
    ({"kind": "map"}, lambda one: one["object"] == "map" and one["name"] == "map"),
    ({"kind": "correction"}, lambda one: one["name"].rpartition("/")[2] == "panel.dat"),
    ({"kind": "release"}, lambda one: one["name"] == "map" and one["user"] == "quality"),
    ({"text": "QUALITY"}, lambda one: one["user"] == "quality"),
    ({"text": "map.release"}, lambda one: one["action"] == "map.release"),
    ({"text": "reading_set.add", "kind": "reading_set"}, lambda one: one["action"] == "reading_set.add"),
]


def test_the_audit_trail_is_filtered_by_the_server(opened: Callable[..., TestClient], cell: str, taken_in: str) -> None:
    quality = opened("quality")
    signed(quality, taken_in)
    every = quality.get(f"{cell}/audit").json()["total"]
    for wanted, matches in FILTERS:
        part = quality.get(f"{cell}/audit", params=wanted).json()
        assert 0 < part["total"] == len(part["rows"]) < every, wanted
        assert all(map(matches, part["rows"])), wanted
    for text in ("%", "_no_such_", "' OR 1=1 --", "<b>"):
        part = quality.get(f"{cell}/audit", params={"text": text})
        assert (part.status_code, part.json()["total"]) == (200, 0), text


def test_the_drift_of_a_cell_is_in_the_order_of_time(
    opened: Callable[..., TestClient], cell: str, taken_in: str
) -> None:
    points = opened("reader").get(f"{cell}/drift").json()
    assert [one["time"] for one in points] == sorted(one["time"] for one in points)
    (first, *_) = [one for one in points if one["kind"] == "map"]
    assert first["of"] == "cross-validation"
    assert 0 < first["mean_mm"] < 1


@pytest.mark.exhaustive
def test_a_job_acts_as_its_user_and_its_token_ends_with_it(
    opened: Callable[..., TestClient],
    cell: str,
    workspace: Workspace,
    store: Store,
) -> None:
    client = opened("Jürgen")
    samples = client.get(f"{cell}/files", params={"kind": "samples"}).json()
    chosen = next(one["id"] for one in samples if one["kind"] == "samples")
    order = {"samples": chosen, "predictor": "ordinary-kriging", "name": "night"}
    job = ended(client, client.post(f"{cell}/maps", json=order))
    assert job["state"] == "done", job
    assert job["user"] == "Jürgen"
    made = client.get(f"{cell}/releases").json()["maps"][0]
    assert (made["name"], made["state"], made["made_by"]) == ("night", "draft", "Jürgen")
    (token,) = client.get("/api/v1/tokens").json()
    assert token["revoked"]
    assert "store" not in " ".join(job["command"])
    for path in (workspace.root / ".truepose").rglob("*"):
        assert not path.is_file() or b"tp_" not in path.read_bytes()


@pytest.mark.exhaustive
def test_a_job_of_a_user_who_was_disabled_meanwhile_fails(
    opened: Callable[..., TestClient],
    cell: str,
    store: Store,
) -> None:
    client, jobs = opened("Jürgen"), opened().app.state.jobs  # type: ignore[attr-defined]
    job = ended(client, client.post(f"{cell}/plans", json={"n": 20}))
    assert job["state"] == "done", job
    set_disabled(store, log_in(store, "root", PASSWORD), "Jürgen", True)
    from truepose.jobs.job import acting_user

    acting_user.set("Jürgen")
    failed = jobs.wait(jobs.run_again(job["id"]).id, timeout=60)
    acting_user.set("")
    assert failed.state == "failed"
    assert "disabled" in failed.problem["detail"]
