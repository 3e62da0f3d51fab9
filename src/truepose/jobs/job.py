"""A job: a command of truepose, its state, its progress and its outcome."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import PurePosixPath
from typing import Any, Final, Literal

from truepose.errors import DataError

State = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
"""State of a job; an interrupted one was stopped with the application."""
ACTIVE: Final[frozenset[State]] = frozenset({"queued", "running"})
COMMANDS: Final = frozenset(
    {
        *("demo", "warm-up", "robots", "init", "check-point"),
        *("plan", "import", "mask", "similarity", "iso9283"),
        *("fit", "validate", "explain", "predict", "update", "study"),
        *("check", "frames", "correct", "verify", "report"),
    }
)
"""The commands that can be jobs: those that end on their own and have --json."""
acting_user: Final[ContextVar[str]] = ContextVar("acting_user", default="")
"""The name of the user whose request is being answered; empty without users."""
_ID: Final = re.compile(r"\d{8}-[0-9a-f]{8}")


@dataclass(frozen=True)
class Job:
    """A job.

    Attributes
    ----------
    id : str
        A sequence number and a random part; later jobs have larger numbers, whatever the clock says.
    command : tuple of str
        The command line without ``truepose`` and ``--json``.
    folder : str
        The folder that the command runs in: its path in the workspace, with slashes.
    cell : str
        The id of the cell that the job belongs to.
    title : str
        The work in some words, for people.
    state : str
        The state.
    created, started, ended : str, optional
        Times of the machine's clock, in UTC (ISO 8601).
    seconds : float, optional
        Time since the start, or of the whole run, from a clock that is never set.
    step : str, optional
        The current or last step.
    done, total : int, optional
        How much of the step is done.
    result : object
        The JSON that the command wrote; None for a very large one.
    result_bytes : int, optional
        The size of that JSON.
    problem : dict, optional
        The error as a problem document (`truepose.problem`).
    warnings : tuple of str
        The warnings of the command.
    revision : int
        A number that grows with every change of the job.
    user : str
        The name of the user who started it; empty without users.
    """

    id: str
    command: tuple[str, ...]
    folder: str
    cell: str
    title: str
    state: State
    created: str
    started: str | None = None
    ended: str | None = None
    seconds: float | None = None
    step: str | None = None
    done: int | None = None
    total: int | None = None
    result: Any = None
    result_bytes: int | None = None
    problem: dict[str, Any] | None = None
    warnings: tuple[str, ...] = ()
    revision: int = 0
    user: str = ""

    @property
    def active(self) -> bool:
        """Whether the job waits or runs."""
        return self.state in ACTIVE

    @property
    def number(self) -> int:
        """The sequence number."""
        return int(self.id.partition("-")[0])

    @property
    def out(self) -> str | None:
        """The file or folder that the command writes (``--out``), as seen from its folder; None if it states none."""
        for word, following in zip(self.command, (*self.command[1:], None), strict=True):
            if word == "--out":
                return following
            if word.startswith("--out="):
                return word.removeprefix("--out=")
        return None

    def to_dict(self) -> dict[str, Any]:
        """Return the job as JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Job:
        """Return the job of `to_dict`.

        Raises
        ------
        ValueError
            If the values are not those of a job.
        """
        job = _adapter().validate_python(dict(data))
        made: Job = job
        if not _ID.fullmatch(made.id):
            raise DataError(f"{made.id!r} is not the id of a job")
        check_command(made.command)
        check_folder(made.folder)
        return made


class UnknownJobError(DataError):
    """A job that the queue does not know."""

    status, title = 404, "Not found"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"job {job_id!r} is unknown; list the jobs again")


def check_command(command: Sequence[str]) -> None:
    """Refuse a command line that cannot be a job.

    Raises
    ------
    DataError
        If it does not begin with the name of a command that can be a job, or a word holds a zero byte.
    """
    name = command[0] if command else ""
    if name not in COMMANDS:
        raise DataError(f"{name!r} cannot be run as a job; expected one of {', '.join(sorted(COMMANDS))}")
    if any("\0" in word for word in command):
        raise DataError(f"a word of the command {name} holds a zero byte; remove it")


def check_folder(folder: str) -> None:
    """Refuse a folder that is not written as a path inside the workspace."""
    path = PurePosixPath(folder)
    if path.is_absolute() or ".." in path.parts or "\0" in folder:
        raise DataError(f"the folder {folder!r} is not in the workspace")


@cache
def _adapter() -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(Job)
