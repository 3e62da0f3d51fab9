"""A server that is killed while a job replaces files: nothing half-written stays, and the job runs again."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.jobs.conftest import LONG, until
from tests.web.test_jobs import API, Server

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")

_STALL = """
import os, time
from pathlib import Path

at, renames, replace = Path(os.environ["STALL_AT"]), 0, Path.replace

def stalling(self, goal):
    global renames
    renames += self.suffix == ".draft" and ".truepose-" in self.name and "corrected" in self.parts
    if renames == 2 and not at.exists():
        at.with_suffix(".new").write_text(str(os.getpid()))
        os.replace(at.with_suffix(".new"), at)
        time.sleep(600)
    return replace(self, goal)

Path.replace = stalling
"""
"""Makes the first process that corrects wait between two renames, and write its number."""


@pytest.fixture
def stall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file with the number of the process that waits."""
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook" / "sitecustomize.py").write_text(_STALL)
    paths = [str(tmp_path / "hook"), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.setenv("STALL_AT", str(tmp_path / "stalled"))
    return tmp_path / "stalled"


@pytest.fixture
def started(virtual_cell: Path, tmp_path: Path) -> Iterator[Callable[[], Server]]:
    """Start a server of a workspace with the virtual cell; called again, another one of the same."""
    shutil.copytree(virtual_cell, tmp_path / "work" / "cell")
    shutil.rmtree(tmp_path / "work" / "cell" / "corrected")
    made: list[Server] = []

    def start() -> Server:
        made.append(Server(tmp_path / "work"))
        return made[-1]

    yield start
    for server in made:
        server.process.kill()
        server.process.communicate()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def finished(server: Server, job: dict[str, Any]) -> dict[str, Any]:
    """Return a job when it has ended."""
    address, now = f"{API}/jobs/{job['id']}", dict(job)
    ends = time.monotonic() + LONG
    while now["state"] in ("queued", "running"):
        assert time.monotonic() < ends, now
        time.sleep(0.1)
        now = server.client.get(address).json()
    return now


@pytest.mark.exhaustive
def test_a_server_killed_between_two_renames_leaves_all_or_nothing_and_the_job_runs_again(
    started: Callable[[], Server],
    stall: Path,
    virtual_cell: Path,
    tmp_path: Path,
    run: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server = started()
    (cell,) = server.client.get(f"{API}/cells").json()
    given = [("files", (path.name, path.read_bytes())) for path in sorted((virtual_cell / "program").iterdir())]
    program = server.client.post(f"{API}/cells/{cell['id']}/programs", files=given).json()
    (error_map,) = server.client.get(f"{API}/cells/{cell['id']}/maps").json()
    body = {"map": error_map["sha"], "program": program["id"], "name": "", "options": {}}
    job = server.client.post(f"{API}/cells/{cell['id']}/corrections", json=body).json()
    until(stall.exists)
    server.process.kill()
    server.process.communicate()
    until(lambda: _ended(int(stall.read_text())))
    (out,) = (tmp_path / "work" / "cell" / "corrected").iterdir()
    assert list(out.glob(".truepose-*.journal"))  # really in the middle
    assert len([path for path in out.iterdir() if not path.name.startswith(".")]) == 1

    later = started()
    left = later.client.get(f"{API}/jobs/{job['id']}").json()
    assert left["state"] == "interrupted"
    assert list(out.iterdir()) == []  # all or nothing, before anybody runs anything
    assert [str(out) in said for said in left["warnings"]] == [True]
    again = finished(later, later.client.post(f"{API}/jobs/{job['id']}/run").json())
    assert again["state"] == "done", again["problem"]
    assert again["command"] == job["command"]
    shutil.copytree(tmp_path / "work" / "cell", tmp_path / "calm")
    shutil.rmtree(tmp_path / "calm" / "corrected")
    monkeypatch.chdir(tmp_path / "calm")
    assert run(*job["command"]).code == 0
    # nothing temporary, nothing missing, every byte as if nothing had happened
    assert contents(out) == contents(tmp_path / "calm" / "corrected" / out.name)
    (listed,) = later.client.get(f"{API}/cells/{cell['id']}/corrections").json()
    assert listed["name"] == "panel"


def _ended(process: int) -> bool:
    """Whether a process has ended, also where nobody waits for it."""
    try:
        os.kill(process, 0)
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True
