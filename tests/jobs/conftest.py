"""Queues of jobs in workspaces of their own, and one cluster for all tests of a process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.forked import forked_processes
from tests.tiers import EXHAUSTIVE

import truepose as tp
from truepose.jobs import Job, JobQueue

if TYPE_CHECKING:
    from tests.jobs.clusters import LocalCluster

SLOW = ("study", "--seeds", "1000", "--per-axis", "4")
"""A command that takes minutes."""
QUICK = ("robots", "kuka-kr150-2")
LONG = 120.0
"""Seconds after which a test fails, on any machine."""


@pytest.fixture(autouse=True, scope="module")
def _forked_processes() -> Iterator[None]:
    """Leave the start of new processes to the second tier."""
    with nullcontext() if EXHAUSTIVE else forked_processes():
        yield


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


@pytest.fixture(scope="session")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalCluster]:
    """A cluster of two workers."""
    from tests.jobs.clusters import local_cluster, need_distributed

    need_distributed()
    with local_cluster(tmp_path_factory.mktemp("cluster"), 2) as running:
        yield running


@pytest.fixture(scope="session")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=3)


@pytest.fixture(scope="session")
def map_path(virtual: tp.VirtualCell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "cell.truepose"
    tp.fit_cell(virtual.cell, virtual.measure(virtual.design(60, seed=1)), "ordinary-kriging").save(path)
    return path


def until(reached: Callable[[], object], seconds: float = LONG) -> None:
    """Wait until something is true."""
    ends = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < ends, "waited in vain"
        time.sleep(0.01)


def with_step(queue: JobQueue, job: Job) -> Job:
    """Return a job that has announced a step."""
    until(lambda: queue.get(job.id).step is not None or not queue.get(job.id).active)
    job = queue.get(job.id)
    assert job.state == "running", job
    return job
