"""Processes of jobs that are forked from one that has imported all modules, instead of importing them again.

The tests of pages run hundreds of commands, and half of their time would be imports. The tests in a browser, and
those of the queue in the second tier, run the processes that users have.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from types import SimpleNamespace
from typing import Any, Final

import pytest

POSSIBLE: Final = sys.platform == "linux"


class Forked:
    """What `truepose.jobs.process` uses of `subprocess.Popen`; the program is always `truepose.cli.waiting`."""

    def __init__(self, _command: object, *, env: dict[str, str], **_options: object) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["tests.forked_modules"])
        stdin, to_child = context.Pipe(duplex=False)
        from_child, stderr = context.Pipe(duplex=False)
        leads, group = context.Pipe(duplex=False)
        self._process: Any = context.Process(target=_wait_for_command, args=(stdin, stderr, group, env))
        self._process.start()
        group.close()
        leads.recv_bytes()  # its group exists, and can be killed
        leads.close()
        stdin.close()
        stderr.close()
        self.pid, self.returncode = self._process.pid, None
        self.stdin = io.FileIO(os.dup(to_child.fileno()), "wb")
        self.stderr = io.FileIO(os.dup(from_child.fileno()), "rb")
        to_child.close()
        from_child.close()

    def kill(self) -> None:
        self._process.kill()

    def wait(self) -> int:
        self._process.join()
        self.returncode = self._process.exitcode
        return int(self._process.exitcode)


def _wait_for_command(stdin: Connection, stderr: Connection, group: Connection, env: dict[str, str]) -> None:
    from truepose.cli import waiting

    os.setsid()
    group.send_bytes(b"1")
    group.close()
    os.dup2(stdin.fileno(), 0)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(stderr.fileno(), 2)
    stdin.close()
    stderr.close()
    os.environ.clear()
    os.environ.update(env)
    sys.stdout, sys.stderr = _as_of_a_new_process(1), _as_of_a_new_process(2)
    sys.argv = ["waiting"]
    waiting.main()


def _as_of_a_new_process(number: int) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.FileIO(number, "w", closefd=False), encoding="utf-8", line_buffering=number == 2)


@contextmanager
def forked_processes() -> Iterator[None]:
    """Let jobs that this process starts be forked, where the system can."""
    popen = SimpleNamespace(Popen=Forked, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL)
    with pytest.MonkeyPatch.context() as patch:
        if POSSIBLE:
            patch.setattr("truepose.jobs.process.subprocess", popen)
        yield
