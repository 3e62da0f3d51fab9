"""The history of a cell: its jobs and its files in one order, with commands, problems and hashes."""

from __future__ import annotations

import csv
import hashlib
import io
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from truepose._io.delimited import escaped
from truepose.errors import one_line
from truepose.jobs import Job, State
from truepose.web.uploads import LARGEST_FILE
from truepose.web.workspace import InCell, InJobs, Kind, StoredFile

router = APIRouter(tags=["history"])
_COLUMNS: Final = ("time", "what", "name", "state", "seconds", "bytes", "sha256", "command", "problem")


class WrittenFile(BaseModel):
    """A file that a job wrote."""

    id: str
    name: str
    sha256: str | None


class Event(BaseModel):
    """A job, or a file of the cell."""

    id: str
    what: Literal["job"] | Kind
    time: float = Field(description="seconds since 1970: a job's order, the last change of a file")
    name: str
    state: State | None = Field(None, description="of a job")
    seconds: float | None = Field(None, description="run time of a job")
    size: int | None = Field(None, description="bytes of a file")
    sha256: str | None = Field(None, description="of a file; null beyond 64 MB")
    command: list[str] | None = None
    folder: str | None = None
    problem: dict[str, Any] | None = None
    warnings: list[str] = []
    results: list[WrittenFile] = []


@router.get("/cells/{cell}/history")
def history(cell: InCell, jobs: InJobs) -> list[Event]:
    """Return the jobs and files of the cell, newest first."""
    files = cell.files()
    events = [_of_job(job, files) for job in jobs.list(cell=cell.id)]
    return sorted([*events, *map(_of_file, files)], key=lambda event: -event.time)


@router.get("/cells/{cell}/history.csv", response_class=Response)
def history_table(cell: InCell, jobs: InJobs) -> Response:
    """Return the history as a table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for event in history(cell, jobs):
        when = datetime.fromtimestamp(event.time, UTC).isoformat(timespec="seconds")
        seconds = "" if event.seconds is None else f"{event.seconds:.3f}"
        command = "" if event.command is None else shlex.join(["truepose", *event.command])
        problem = "" if event.problem is None else str(event.problem.get("detail", ""))
        words = [escaped(one_line(word)) for word in (event.name, command, problem)]
        size = "" if event.size is None else str(event.size)
        writer.writerow([when, event.what, words[0], event.state or "", seconds, size, event.sha256 or "", *words[1:]])
    headers = {"Content-Disposition": 'attachment; filename="history.csv"'}
    return Response("\ufeff" + text.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)


def _of_job(job: Job, files: Sequence[StoredFile]) -> Event:
    return Event(
        id=job.id,
        what="job",
        time=datetime.fromisoformat(job.created).timestamp(),
        name=one_line(job.title),
        state=job.state,
        seconds=job.seconds,
        command=list(job.command),
        folder=job.folder,
        problem=job.problem,
        warnings=list(job.warnings),
        results=_written(job, files) if job.state == "done" else [],
    )


def _of_file(file: StoredFile) -> Event:
    return Event(
        id=file.id, what=file.kind, time=file.modified, name=one_line(file.name), size=file.size, sha256=_hash(file)
    )


def _written(job: Job, files: Sequence[StoredFile]) -> list[WrittenFile]:
    """Return the files at the place that the command's ``--out`` names, and below it."""
    if "--out" not in job.command[:-1]:
        return []
    out = PurePosixPath(job.command[job.command.index("--out") + 1])
    return [
        WrittenFile(id=file.id, name=one_line(file.name), sha256=_hash(file))
        for file in files
        if PurePosixPath(file.name) == out or out in PurePosixPath(file.name).parents
    ]


def _hash(file: StoredFile) -> str | None:
    if file.size > LARGEST_FILE:
        return None
    try:
        return _hash_at(file.path, file.modified, file.size)
    except OSError:  # removed meanwhile
        return None


@lru_cache(maxsize=4096)
def _hash_at(path: Path, _modified: float, _size: int) -> str:
    """Return the SHA-256 of a file; the hash of a file that has not changed is kept."""
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
