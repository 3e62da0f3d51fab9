"""The history: every job and file once, in order, with what is needed to trust and to repeat it."""

from __future__ import annotations

import csv
import hashlib
import io
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.web.conftest import ended

from truepose.web import Workspace


def report(client: TestClient, cell: str, workspace: Workspace) -> dict[str, Any]:
    (used,) = workspace.cells()[0].files("map")
    return ended(client, client.post(f"{cell}/reports", json={"map": used.id}))


@pytest.mark.exhaustive
def test_every_job_and_file_is_there_once_and_in_order(client: TestClient, cell: str, workspace: Workspace) -> None:
    job = report(client, cell, workspace)
    events = client.get(f"{cell}/history").json()
    files = workspace.cells()[0].files()
    assert sorted(event["id"] for event in events) == sorted([job["id"], *(file.id for file in files)])
    times = [event["time"] for event in events]
    assert times == sorted(times, reverse=True)
    by_id = {event["id"]: event for event in events}
    for file in files:
        assert by_id[file.id]["sha256"] == hashlib.sha256(file.path.read_bytes()).hexdigest()
    mine = by_id[job["id"]]
    assert mine["command"] == job["command"]
    (written,) = mine["results"]
    assert written["name"] == job["command"][job["command"].index("--out") + 1]
    assert written["sha256"] == by_id[written["id"]]["sha256"]


def test_a_changed_file_has_its_new_hash(client: TestClient, cell: str, workspace: Workspace) -> None:
    def digest() -> str:
        events = client.get(f"{cell}/history").json()
        return next(str(event["sha256"]) for event in events if event["name"] == "fit_samples.csv")

    before, path = digest(), workspace.cells()[0].folder / "fit_samples.csv"
    path.write_bytes(path.read_bytes() + b"\n")
    assert digest() == hashlib.sha256(path.read_bytes()).hexdigest() != before


def test_the_table_is_safe_in_a_spreadsheet(client: TestClient, cell: str, workspace: Workspace) -> None:
    folder = workspace.cells()[0].folder / "readings"
    folder.mkdir()
    (folder / '=HYPERLINK("http:,evil").txt').write_text("x")
    answer = client.get(f"{cell}/history.csv")
    assert answer.headers["content-disposition"].startswith("attachment")
    rows = list(csv.DictReader(io.StringIO(answer.text.removeprefix("\ufeff"))))
    assert len(rows) == len(client.get(f"{cell}/history").json())
    assert not any(value.startswith(("=", "+", "@", "\t")) for row in rows for value in row.values())
