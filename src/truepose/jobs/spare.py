"""Processes for jobs, one of them started ahead."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

from truepose.jobs.process import CommandProcess


class Processes:
    """Processes for jobs.

    Parameters
    ----------
    workers : int
        The number of jobs that may run at once. If it is above 1, they share the processors.
    ready : bool
        Whether a process waits for the next job with its modules imported, which saves about a second.
    """

    def __init__(self, workers: int, ready: bool) -> None:
        self._workers, self._ready = workers, ready
        self._lock = threading.Lock()
        self._spare: CommandProcess | None = None

    def begin(self, command: Sequence[str], folder: Path, output: Path, variables: Mapping[str, str]) -> CommandProcess:
        """Return a process that runs a command in a folder with variables; its JSON goes to the file `output`.

        Raises
        ------
        OSError
            If the system cannot start it.
        """
        if (spare := self._take()) is not None and _began(spare, command, folder, output, variables):
            return spare
        process = CommandProcess(threads=self._threads())
        if not _began(process, command, folder, output, variables):
            raise OSError("the process for the command ended at its start")
        return process

    def prepare(self) -> None:
        """Start the process that waits for the next job."""
        with self._lock:
            if self._ready and self._spare is None:
                try:
                    self._spare = CommandProcess(threads=self._threads(), ready=True)
                except OSError:  # the next job tries again and reports the error
                    self._spare = None

    def close(self) -> None:
        """End the process that waits."""
        if (spare := self._take()) is not None:
            spare.kill()
            spare.wait()

    def _take(self) -> CommandProcess | None:
        with self._lock:
            spare, self._spare = self._spare, None
        return spare

    def _threads(self) -> int | None:
        """Return the number of threads of each process; None if a job has the machine for itself."""
        from truepose.numerics.threads import cores

        return None if self._workers == 1 else max(1, cores() // self._workers)


def _began(
    process: CommandProcess, command: Sequence[str], folder: Path, output: Path, variables: Mapping[str, str]
) -> bool:
    """Let a process begin; return False if it has ended."""
    try:
        process.begin(command, folder, output, variables)
    except OSError:
        process.kill()
        process.wait()
        return False
    return True
