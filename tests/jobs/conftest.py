"""Queues of jobs in workspaces of their own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from truepose.jobs import Job, JobQueue

SLOW = ("study", "--seeds", "1000", "--per-axis", "4")
"""A command that takes minutes."""
QUICK = ("robots", "kuka-kr150-2")
LONG = 120.0
"""Seconds after which a test fails, on any machine."""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    (tmp_path / "work").mkdir()
    return tmp_path / "work"


@pytest.fixture
def queue(workspace: Path) -> Iterator[JobQueue]:
    with JobQueue(workspace, ready=False) as queue:
        yield queue


@pytest.fixture
def submit(queue: JobQueue, workspace: Path) -> Callable[..., Job]:
    def add(*command: str, cell: str = "a", title: str = "A title") -> Job:
        return queue.submit(command, folder=workspace, cell=cell, title=title)

    return add


def until(reached: Callable[[], object], seconds: float = LONG) -> None:
    """Wait until something is true."""
    ends = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < ends, "waited in vain"
        time.sleep(0.01)


def with_step(queue: JobQueue, job: Job) -> Job:
    """Return a job that has told a step."""
    until(lambda: queue.get(job.id).step is not None or not queue.get(job.id).active)
    job = queue.get(job.id)
    assert job.state == "running", job
    return job
