"""Whatever is sent to an endpoint, the answer is what was asked for, or a problem document; never an internal error."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.web.random_requests import Contract

from truepose.jobs import JobQueue
from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER, Guard

BASE = "http://127.0.0.1:8765"
EXAMPLES = 4
STREAM = "/api/v1/jobs/{job}/events"  # goes on while a job waits, and here all do


@pytest.fixture(scope="module")
def workspace(virtual_cell: Path, tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("any") / "work"
    shutil.copytree(virtual_cell, folder / "drilling")
    return Workspace(folder)


@pytest.fixture(scope="module")
def client(workspace: Workspace) -> Iterator[TestClient]:
    guard = Guard(port=8765)
    app = create_app(workspace, guard)
    with TestClient(app, base_url=BASE, headers={CSRF_HEADER: guard.csrf}, raise_server_exceptions=False) as opened:
        opened.cookies.set(guard.cookie, guard.session)
        yield opened


@pytest.fixture(scope="module")
def known(client: TestClient, workspace: Workspace) -> Iterator[dict[str, list[str]]]:
    """The ids of a cell with everything in it; from then on jobs wait for ever: what they run is tested elsewhere."""
    (cell,) = workspace.cells()
    address = f"/api/v1/cells/{cell.id}"
    program = client.post(f"{address}/programs", files=[("files", ("a.src", b"DEF a( )\nEND\n"))]).json()["id"]
    check = client.post(f"{address}/programs/{program}/check", json={}).json()["id"]
    of_kind: dict[str, list[str]] = {}
    for file in cell.files():
        of_kind.setdefault(file.kind, []).append(file.id)
    files = [one for ids in of_kind.values() for one in ids]
    assert client.app.state.jobs.wait(check, timeout=120).state == "done"  # type: ignore[attr-defined]
    corrections = [one["id"] for one in client.get(f"{address}/corrections").json()]
    ids = {
        "cell": [cell.id],
        "file": files,
        "sha": [workspace.hash_of(file) for _, file in workspace.maps()],
        "map": [*(workspace.hash_of(file) for _, file in workspace.maps()), *of_kind["map"]],
        "previews": [check],
        "corrections": corrections,
        "programs": [program],
        "plans": of_kind.get("plan", files),
        "id": [program],
        "program": [program],
        "record": of_kind.get("record", files),
        "records": of_kind.get("record", files),
        "samples": of_kind["samples"],
        "test": of_kind["samples"],
        "job": [check],
        "robot": ["kuka-kr150-2"],
        "verification": of_kind.get("verification", files),
        "report": of_kind.get("report", files),
        "plan": of_kind.get("plan", files),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(JobQueue, "_dispatch", lambda _: None)
        yield ids


def operations() -> list[tuple[str, str]]:
    from truepose.web.openapi import contract

    return [one for one in Contract(json.loads(contract()), {"": ["a"]}).operations() if one[1] != STREAM]


def check(answer: Any) -> None:
    """Require an answer to what was asked, or a problem document that blames the request."""
    assert answer.status_code < 500, answer.text
    if answer.status_code >= 400:
        assert answer.headers["content-type"] == "application/problem+json", answer.text
        assert {"type", "title", "status", "detail"} <= answer.json().keys()
        assert answer.json()["status"] == answer.status_code


@pytest.mark.parametrize(("method", "path"), operations())
def test_any_request_has_an_answer(client: TestClient, known: dict[str, list[str]], method: str, path: str) -> None:
    contract = Contract(client.app.openapi(), known)  # type: ignore[attr-defined]

    @settings(
        max_examples=EXAMPLES,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def asked(data: st.DataObject) -> None:
        check(client.request(**contract.request(data.draw, method, path)))

    asked()
