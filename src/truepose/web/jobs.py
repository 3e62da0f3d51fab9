"""Jobs: their list, their progress as it happens, cancelling, and running one again."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, Final

import anyio
from anyio import to_thread
from fastapi import APIRouter, Header, Query, Request, Response
from pydantic import TypeAdapter
from starlette.responses import FileResponse, StreamingResponse

from truepose.jobs import Job, JobQueue, State
from truepose.web.team.visits import check_job, session_check
from truepose.web.workspace import InJobs

router = APIRouter(tags=["jobs"])
_LOOK: Final = 0.1
"""Seconds between two looks for changes."""
_REPEAT: Final = 0.5
"""Seconds after which the state of a running job is sent again."""
_BEAT: Final = 5.0
"""Seconds after which a comment keeps the connection of a waiting job alive."""
_JOB: Final = TypeAdapter(Job)


@router.get("/jobs")
def list_jobs(
    jobs: InJobs,
    cell: Annotated[str | None, Query(description="only jobs of this cell")] = None,
    state: Annotated[list[State], Query(description="only jobs in these states")] = [],  # noqa: B006 - FastAPI copies it
    limit: Annotated[int, Query(ge=1, le=10_000, description="the largest number of jobs")] = 200,
) -> list[Job]:
    """Return the jobs without their results, newest first."""
    return jobs.list(cell=cell, states=state)[:limit]


@router.get("/jobs/{job}")
def get_job(job: str, jobs: InJobs) -> Job:
    """Return a job with its result, unless that is very large."""
    return jobs.get(job)


@router.get("/jobs/{job}/result", response_class=FileResponse)
def job_result(job: str, jobs: InJobs) -> Path:
    """Return the JSON that the command of a job wrote, of any size."""
    return jobs.result_file(job)


@router.get(
    "/jobs/{job}/events",
    response_class=StreamingResponse,
    responses={
        200: {"content": {"text/event-stream": {}}, "description": "The job, as the data of each event"},
        204: {"description": "The job has ended, and the client has seen its end"},
    },
)
async def job_events(
    job: str, jobs: InJobs, request: Request, last_event_id: Annotated[str | None, Header()] = None
) -> Response:
    """Return the states of a job as server-sent events, until it has ended, or the session of the user.

    An event is sent at every change, and at least twice a second while the job runs. Every event holds the whole job,
    so that a client that connects again misses nothing.
    """
    current = await to_thread.run_sync(jobs.get, job)
    if not current.active and last_event_id == _event_id(current):
        return Response(status_code=204)
    return StreamingResponse(
        _events(jobs, current, last_event_id, session_check(request)),
        media_type="text/event-stream",
        headers={"X-Accel-Buffering": "no"},
    )


@router.delete("/jobs/{job}")
def cancel_job(job: str, jobs: InJobs, request: Request) -> Job:
    """Cancel a job, and return it when it has ended; that of another user needs the role that starts one."""
    check_job(request, jobs.get(job), own=True)
    return jobs.cancel(job)


@router.post("/jobs/{job}/run", status_code=202)
def run_job_again(job: str, jobs: InJobs, request: Request) -> Job:
    """Run the command of a job that has ended again, as a new job of the user who asks."""
    check_job(request, jobs.get(job))
    return jobs.run_again(job)


async def _events(
    jobs: JobQueue, job: Job, seen: str | None, goes_on: Callable[[], bool] = lambda: True
) -> AsyncIterator[bytes]:
    """Yield the states of a job as events, until it has ended or the session of the user does not go on."""
    yield b"retry: 1000\n\n"
    sent = 0.0 if seen != _event_id(job) else time.monotonic()
    while True:
        changed = jobs.revision(job.id) != job.revision
        since = time.monotonic() - sent
        due = changed or not sent or (job.state == "running" and since >= _REPEAT)
        if (due or since >= _BEAT) and not await to_thread.run_sync(goes_on):
            return
        if due:
            job = await to_thread.run_sync(jobs.get, job.id)
            yield b"id: %s\ndata: %s\n\n" % (_event_id(job).encode(), _JOB.dump_json(job))
            sent = time.monotonic()
            if not job.active:
                return
        elif since >= _BEAT:
            yield b": still there\n\n"
            sent = time.monotonic()
        await anyio.sleep(_LOOK)


def _event_id(job: Job) -> str:
    """Return what a client has seen: the state tells revisions of two starts of the application apart."""
    return f"{job.revision}-{job.state}"
