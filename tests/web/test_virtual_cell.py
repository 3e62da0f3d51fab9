"""The virtual cell that a page offers where there is nothing to show."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from truepose.studies.demo import EVERY_VIEW
from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER, Guard

API = "/api/v1"
EVERY = ["--predictor", EVERY_VIEW]


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    guard = Guard(port=8765)
    app = create_app(Workspace(tmp_path), guard)
    with TestClient(app, base_url="http://127.0.0.1:8765", raise_server_exceptions=False) as inside:
        inside.cookies.set(guard.cookie, guard.session)
        inside.headers[CSRF_HEADER] = guard.csrf
        yield inside


def test_each_virtual_cell_gets_a_folder_of_its_own(client: TestClient, tmp_path: Path) -> None:
    (tmp_path / "Virtual-Cell").mkdir()  # of the user; some file systems take it for the same name
    answers = [client.post(f"{API}/cells/virtual") for _ in range(3)]
    made = [answer.json() for answer in answers]
    for job in made:
        client.delete(f"{API}/jobs/{job['id']}")
    assert [answer.status_code for answer in answers] == [202] * 3
    assert [job["command"] for job in made] == [["demo", f"virtual-cell-{n}", *EVERY] for n in (2, 3, 4)]
    assert {job["folder"] for job in made} <= {"", "."}


def test_the_job_names_the_cell_that_it_makes(client: TestClient, tmp_path: Path) -> None:
    job = client.post(f"{API}/cells/virtual").json()
    client.delete(f"{API}/jobs/{job['id']}")
    assert job["command"] == ["demo", "virtual-cell", *EVERY]
    (tmp_path / "virtual-cell" / "cell.toml").write_text("[robot]\nmodel = 'kuka-kr150-2'\n")
    assert [(cell["id"], cell["name"]) for cell in client.get(f"{API}/cells").json()] == [(job["cell"], "virtual-cell")]
