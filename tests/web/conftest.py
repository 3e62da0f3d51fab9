"""A workspace with the virtual cell, and a client that opened its start URL."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from fastapi.testclient import TestClient
from tests.forked import forked_processes
from tests.tiers import EXHAUSTIVE

from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER, Guard

if TYPE_CHECKING:
    from truepose.store.store import Store

BASE = "http://127.0.0.1:8765"
collect_ignore = [] if EXHAUSTIVE else ["test_any_request.py"]  # a fuzzer; to make the contract takes seconds


@pytest.fixture(autouse=True, scope="module")
def _forked_processes() -> Iterator[None]:
    with forked_processes():
        yield


@pytest.fixture
def workspace(virtual_cell: Path, tmp_path: Path) -> Workspace:
    shutil.copytree(virtual_cell, tmp_path / "work" / "drilling")
    return Workspace(tmp_path / "work")


@pytest.fixture
def client(workspace: Workspace) -> Iterator[TestClient]:
    guard = Guard(port=8765)
    with TestClient(create_app(workspace, guard), base_url=BASE, headers={CSRF_HEADER: guard.csrf}) as opened:
        opened.cookies.set(guard.cookie, guard.session)
        yield opened


@pytest.fixture
def cell(workspace: Workspace) -> str:
    """The address of the cell."""
    return f"/api/v1/cells/{workspace.cells()[0].id}"


@pytest.fixture
def store(tmp_path: Path, quick_hashes: None) -> Iterator[Store]:
    """A store with an administrator and the users of `tests.web.people`."""
    from tests.web.people import add_people

    from truepose.store.store import Store

    with Store.open(tmp_path / "store", create=True) as opened:
        add_people(opened)
        yield opened


def ended(client: TestClient, answer: Any) -> dict[str, Any]:
    """Return the job of an answer when it has ended."""
    assert answer.status_code == 202, answer.text
    job = client.app.state.jobs.wait(answer.json()["id"], timeout=120)  # type: ignore[attr-defined]
    return client.get(f"/api/v1/jobs/{job.id}").json()  # type: ignore[no-any-return]
