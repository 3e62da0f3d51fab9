"""A running job: its process, the events it has sent, and the meaning of its end."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from truepose.jobs.folder import JobFolder
from truepose.jobs.job import Job
from truepose.jobs.process import CommandProcess
from truepose.problem import document

_MOST_WARNINGS: Final = 100


@dataclass
class Run:
    """A job that runs.

    Attributes
    ----------
    process : CommandProcess, optional
        Its process, once it has started.
    stopped : str, optional
        The state that it gets because it was stopped.
    began : float
        The time of the start, of the monotonic clock [s].
    warnings : list of str
        The first warnings of the command.
    problem : dict, optional
        The error that ended the command, as a problem document.
    """

    process: CommandProcess | None = None
    stopped: Literal["cancelled", "interrupted"] | None = None
    began: float = field(default_factory=time.monotonic)
    warnings: list[str] = field(default_factory=list)
    problem: dict[str, Any] | None = None

    @property
    def seconds(self) -> float:
        """The time since the start."""
        return time.monotonic() - self.began

    def take(self, event: dict[str, Any]) -> dict[str, Any]:
        """Take an event of the command, and return what changes in the job by it."""
        kind = event.pop("event")
        if kind == "step":
            return {"step": str(event.get("step")), "done": None, "total": None}
        if kind == "count":
            return {"done": int(event.get("done", 0)), "total": int(event.get("total", 0))}
        if kind == "problem":
            self.problem = event
        if kind == "warning" and len(self.warnings) < _MOST_WARNINGS:
            self.warnings.append(str(event.get("message")))
            return {"warnings": tuple(self.warnings)}
        return {}

    def interrupt(self, why: Literal["cancelled", "interrupted"]) -> None:
        """Interrupt the command; it gets this state when it ends by it."""
        self.stopped = self.stopped or why
        if self.process is not None:
            self.process.interrupt()

    def kill(self) -> None:
        """Kill the process."""
        if self.process is not None:
            self.process.kill()

    def outcome(self, job: Job, code: int, store: JobFolder, last_words: str) -> dict[str, Any]:
        """Return what changes in the job by the end of its process.

        Parameters
        ----------
        job : Job
            The job.
        code : int
            The exit code.
        store : JobFolder
            The folder with the JSON that the command wrote.
        last_words : str
            A sentence about a process that ended without a problem of its own.
        """
        output = store.output(job)
        size = output.stat().st_size if output.exists() else 0
        if not store.has_result(job, size) or (code != 0 and self.stopped):
            output.unlink(missing_ok=True)
            size = 0
        return {"result_bytes": size or None, **self._state(code, size > 0, last_words)}

    def _state(self, code: int, has_result: bool, last_words: str) -> dict[str, Any]:
        """Return the state and the problem."""
        if code == 0 and has_result:
            return {"state": "done", "problem": None}
        if self.stopped is not None:
            if self.problem is not None:  # it names files that were written before
                self.warnings.append(str(self.problem.get("detail")))
            return {"state": self.stopped, "problem": interrupted() if self.stopped == "interrupted" else None}
        if self.problem is not None:
            return {"state": "failed", "problem": self.problem}
        if code == 1 and has_result:  # a negative verdict, such as that of verify
            return {"state": "done", "problem": None}
        return {"state": "failed", "problem": document("ProcessError", last_words)}


def interrupted() -> dict[str, Any]:
    """Return the problem of a job that was stopped with the application."""
    return document("Interrupted", "the application ended before this command had ended; run it again")
