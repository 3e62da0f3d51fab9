"""Results of jobs that have not written them yet have names of their own."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from truepose.jobs import JobQueue
from truepose.web import Workspace, create_app
from truepose.web import promises as promises_module
from truepose.web.security import CSRF_HEADER, Guard

BASE = "http://127.0.0.1:8765"


@pytest.fixture
def waiting(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A client whose jobs all wait."""
    monkeypatch.setattr(JobQueue, "_dispatch", lambda _self: None)
    guard = Guard(port=8765)
    with TestClient(create_app(workspace, guard), base_url=BASE, headers={CSRF_HEADER: guard.csrf}) as opened:
        opened.cookies.set(guard.cookie, guard.session)
        yield opened


def out(answer: Any) -> str:
    assert answer.status_code == 202, answer.text
    command = answer.json()["command"]
    return next(
        following if word == "--out" else word.removeprefix("--out=")
        for word, following in zip(command, [*command[1:], ""], strict=True)
        if word.startswith("--out")
    )


def orders(client: TestClient, cell: str) -> dict[str, Callable[[], Any]]:
    """Ways to begin each kind of job twice."""
    samples = client.get(f"{cell}/samples").json()[0]["id"]
    fit = {"samples": samples, "predictor": "ordinary-kriging", "name": "a"}
    return {
        "fit": lambda: client.post(f"{cell}/maps", json=fit),
        "plan": lambda: client.post(f"{cell}/plans", json={"n": 5}),
        "mask": lambda: client.post(f"{cell}/samples/{samples}/mask", json={"reasons": {}}),
    }


@pytest.mark.parametrize("kind", ["fit", "plan", "mask"])
def test_two_jobs_of_one_name_that_wait_write_two_files(waiting: TestClient, cell: str, kind: str) -> None:
    begin = orders(waiting, cell)[kind]
    found = [out(begin()) for _ in range(3)]
    stem, dot, suffix = found[0].partition(".")
    assert found == [found[0], f"{stem}-2{dot}{suffix}", f"{stem}-3{dot}{suffix}"]


def test_a_name_is_free_again_when_its_job_wrote_nothing(waiting: TestClient, cell: str) -> None:
    begin = orders(waiting, cell)["fit"]
    first = begin()
    assert waiting.delete(f"/api/v1/jobs/{first.json()['id']}").json()["state"] == "cancelled"
    assert out(begin()) == out(first)


def test_many_requests_at_once_get_many_names(workspace: Workspace) -> None:
    (folder,) = workspace.cells()
    with ThreadPoolExecutor(16) as pool:
        found = list(pool.map(lambda k: folder.new("maps", "A.truepose" if k % 2 else "a.truepose"), range(64)))
    assert len({str(path).lower() for path in found}) == 64


def test_a_name_that_no_job_came_for_is_given_again_later(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder,) = workspace.cells()
    first = folder.new("maps", "a.truepose")
    assert folder.new("maps", "a.truepose") != first
    monkeypatch.setattr(promises_module, "_LONGEST_S", 0.0)
    assert folder.new("maps", "a.truepose") == first == Path(folder.folder / "maps" / "a.truepose")
