"""Clusters of separate processes on this machine, for tests of the executor."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.needs import needed

_ROOT = Path(__file__).parents[2]
_WAIT_S = 120.0
_IDLE, _LIFETIME = "--idle-timeout=10m", "--lifetime=10m"  # if the tests are killed


@dataclass
class LocalCluster:
    """A scheduler and workers, each a process."""

    folder: Path
    address: str = ""
    scheduler: subprocess.Popen[bytes] | None = None
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start_scheduler(self, *options: str) -> None:
        """Start a scheduler on a free port and wait for its address."""
        file = self.folder / f"scheduler-{time.monotonic_ns()}.json"
        self.scheduler = _start(
            "scheduler", "--host=127.0.0.1", "--port=0", f"--scheduler-file={file}", _IDLE, *options
        )
        for _ in _polls("the scheduler did not start"):
            if file.exists() and (text := file.read_text("utf-8")):
                self.address = json.loads(text)["address"]
                return

    def start_worker(self, *options: str, before: Sequence[str] = ()) -> subprocess.Popen[bytes]:
        """Start a worker with one thread; `before` is a command that starts it."""
        local = f"--local-directory={self.folder}"
        worker = _start("worker", self.address, "--nthreads=1", "--no-nanny", _LIFETIME, local, *options, before=before)
        self.workers.append(worker)
        return worker

    def end(self) -> None:
        """Kill all processes."""
        for process in [*self.workers, *([self.scheduler] if self.scheduler else [])]:
            process.kill()
            process.wait()


@contextmanager
def local_cluster(folder: Path, workers: int) -> Iterator[LocalCluster]:
    """Run a cluster; its processes have ended when the context is left."""
    cluster = LocalCluster(folder)
    try:
        cluster.start_scheduler()
        for _ in range(workers):
            cluster.start_worker()
        wait_for_workers(cluster.address, workers)
        yield cluster
    finally:
        cluster.end()


def need_distributed() -> Any:
    """Return the package distributed; skip the tests that need it, or fail them, where it is not installed."""
    return needed("distributed", "'truepose[scale]'")


def wait_for_workers(address: str, count: int, security: Any = None) -> None:
    """Wait until a scheduler has a number of workers."""
    from distributed import Client

    with Client(address, security=security, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=_WAIT_S)


def _start(kind: str, *options: str, before: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    path = os.pathsep.join([str(_ROOT), os.environ.get("PYTHONPATH", "")])
    command = [*before, sys.executable, "-m", "dask", kind, "--no-dashboard", *options]
    env = {**os.environ, "PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__WORKER_SATURATION": "1.0"}
    return subprocess.Popen(command, env=env, stderr=subprocess.DEVNULL)


def _polls(reason: str) -> Iterator[None]:
    end = time.monotonic() + _WAIT_S
    while time.monotonic() < end:
        yield
        time.sleep(0.05)
    raise AssertionError(reason)
