"""The queue of jobs: at most so many run at once, the others wait in their order; all outlive the application."""

from __future__ import annotations

import os
import secrets
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Literal

from truepose._io.commits import recover_below
from truepose.errors import DataError, FileError, RefusedError
from truepose.jobs.folder import JobFolder
from truepose.jobs.job import Job, State, UnknownJobError, acting_user, check_command
from truepose.jobs.run import Run, interrupted
from truepose.jobs.spare import Processes
from truepose.problem import problem

_GRACE: Final = 0.5
"""Seconds that an interrupted command has before it is killed."""
_END: Final = 10.0
"""Seconds that a killed command may need to be gone, also one whose process is still being made on a busy machine."""
Environment = Callable[[Job], AbstractContextManager[Mapping[str, str]]]
"""A function that gives the variables for the environment of a job."""


class JobQueue:
    """The jobs of a workspace. All methods may be called from any thread.

    Parameters
    ----------
    workspace : Path
        The workspace; the jobs are in its folder ``.truepose/jobs``.
    workers : int
        The largest number of jobs that run at once. If it is above 1, they share the processors.
    ready : bool
        Whether a process waits for the next job with its modules imported, so that the job starts sooner.
    environment : callable, optional
        A function that gives the variables for the environment of a job of a user, from its start to its end.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, JobQueue(Path(folder), ready=False) as queue:
    ...     job = queue.submit(["robots", "kuka-kr150-2"], folder=Path(folder), cell="", title="Show a robot")
    ...     queue.wait(job.id, timeout=60).result["name"]
    'kuka-kr150-2'
    """

    def __init__(
        self, workspace: Path, *, workers: int = 1, ready: bool = True, environment: Environment | None = None
    ) -> None:
        if workers < 1:
            raise DataError(f"workers must be at least 1, got {workers}")
        self._workspace = Path(os.path.realpath(workspace))
        self._store = JobFolder(self._workspace / ".truepose" / "jobs")
        self._workers, self._processes = workers, Processes(workers, ready)
        self._changed = threading.Condition(threading.RLock())
        self._jobs: dict[str, Job] = {}
        self._waiting: deque[str] = deque()
        self._running: dict[str, Run] = {}
        self._unsaved: dict[str, str] = {}  # why, by job
        self._open, self._environment = False, environment

    def __enter__(self) -> JobQueue:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Take the workspace and read its jobs; those that an earlier application left are interrupted now.

        What they had begun to write is undone or completed.

        Raises
        ------
        FileError
            If another application has the workspace.
        """
        with self._changed:
            if self._open:
                return
            self._store.lock()
            try:
                self._jobs = {job.id: job for job in self._store.load()}
            except BaseException:
                self._store.unlock()
                raise
            self._open = True
            for job in [job for job in self._jobs.values() if job.active]:
                self._store.output(job).unlink(missing_ok=True)
                said = recover_below(self._workspace / job.folder)
                self._set(replace(job, state="interrupted", problem=interrupted(), warnings=(*job.warnings, *said)))
            self._processes.prepare()

    def stop(self) -> None:
        """Interrupt all jobs, wait for their end, and give the workspace free."""
        with self._changed:
            if not self._open:
                return
            self._open = False
            for job_id in self._waiting:
                self._set(replace(self._jobs[job_id], state="interrupted", problem=interrupted()))
            self._waiting.clear()
            self._stop_runs(list(self._running), "interrupted")
            self._processes.close()
            self._store.unlock()

    def submit(self, command: Sequence[str], *, folder: Path, cell: str, title: str) -> Job:
        """Add a job.

        Parameters
        ----------
        command : sequence of str
            The command line without ``truepose`` and ``--json``, such as ``["fit", "cell.toml", "samples.csv"]``.
        folder : Path
            The folder to run it in; inside the workspace.
        cell : str
            The id of the cell that it belongs to.
        title : str
            The work in some words, for people.

        Raises
        ------
        DataError
            If this cannot be a job, or the queue has not been started.
        FileError
            If the folder does not exist, or the job cannot be written.
        """
        check_command(command)
        place = Path(os.path.realpath(folder))
        if not place.is_relative_to(self._workspace):
            raise DataError(f"the folder {folder} is not in the workspace")
        if not place.is_dir():
            raise FileError(folder, "no such folder")
        with self._changed:
            if not self._open:
                raise DataError("the application is stopping; no job can be added")
            number = 1 + max(self._store.last_number(), max((job.number for job in self._jobs.values()), default=0))
            job = Job(
                id=f"{number:08d}-{secrets.token_hex(4)}",
                command=tuple(command),
                folder=place.relative_to(self._workspace).as_posix(),
                cell=cell,
                title=title,
                state="queued",
                created=_now(),
                user=acting_user.get(),
            )
            self._store.save(job)
            self._jobs[job.id] = job
            self._waiting.append(job.id)
            self._changed.notify_all()
            self._dispatch()
            return self.get(job.id)

    def run_again(self, job_id: str) -> Job:
        """Add a job with the command of one that has ended.

        Raises
        ------
        UnknownJobError
            If there is no such job.
        RefusedError
            If it has not ended.
        """
        job = self.get(job_id)
        if job.active:
            raise RefusedError(f"{job.title}: has not ended; cancel it first")
        return self.submit(job.command, folder=self._workspace / job.folder, cell=job.cell, title=job.title)

    def cancel(self, job_id: str) -> Job:
        """Cancel a job, and return it when it has ended; one that has ended is left as it is.

        Raises
        ------
        UnknownJobError
            If there is no such job.
        """
        with self._changed:
            job = self.get(job_id)
            if job.state == "queued":
                self._waiting.remove(job_id)
                self._set(replace(job, state="cancelled", ended=_now()))
            elif job.state == "running":
                self._stop_runs([job_id], "cancelled")
            return self.get(job_id)

    def get(self, job_id: str) -> Job:
        """Return a job with its result.

        Raises
        ------
        UnknownJobError
            If there is no such job.
        """
        with self._changed:
            job = self._shown(job_id)
        if job.active or not job.result_bytes:
            return job
        try:
            return replace(job, result=self._store.result(job))
        except FileError as error:  # removed or changed by hand
            return replace(job, warnings=(*job.warnings, f"the result is lost: {error}"))

    def result_file(self, job_id: str) -> Path:
        """Return the file with the JSON that a job's command wrote.

        Raises
        ------
        UnknownJobError
            If there is no such job.
        FileError
            If the job has no result.
        """
        job = self.get(job_id)
        path = self._store.output(job)
        if job.active or not job.result_bytes or not path.is_file():
            raise FileError(path, f"{job.title}: has no result")
        return path

    def list(self, *, cell: str | None = None, states: Collection[State] = ()) -> list[Job]:
        """Return the jobs without their results, newest first: all, or those of a cell or in some states."""
        with self._changed:
            jobs = [self._shown(job_id) for job_id in self._jobs]
        wanted = [job for job in jobs if cell in (None, job.cell) and (not states or job.state in states)]
        return sorted(wanted, key=lambda job: job.id, reverse=True)

    def revision(self, job_id: str) -> int:
        """Return the revision of a job: a number that grows with every change.

        Raises
        ------
        UnknownJobError
            If there is no such job.
        """
        return self._known(job_id).revision  # without the lock, which is held while a job is written

    def wait(self, job_id: str, *, after: int | None = None, timeout: float | None = None) -> Job:
        """Return a job when it has ended, its revision is not `after` any more, or the timeout [s] is over."""

        def reached() -> bool:
            job = self._known(job_id)
            return not job.active or (after is not None and job.revision != after)

        with self._changed:
            self._changed.wait_for(reached, timeout)
        return self.get(job_id)

    def _known(self, job_id: str) -> Job:
        if job_id not in self._jobs:
            raise UnknownJobError(job_id)
        return self._jobs[job_id]

    def _shown(self, job_id: str) -> Job:
        job = self._known(job_id)
        if (run := self._running.get(job_id)) is not None:
            job = replace(job, seconds=run.seconds)
        if why := self._unsaved.get(job_id):
            job = replace(job, warnings=(*job.warnings, f"this state of the job is not kept: {why}"))
        return job

    def _change(self, job: Job) -> None:
        """Take a new version of a job."""
        self._jobs[job.id] = replace(job, revision=job.revision + 1)
        self._changed.notify_all()

    def _set(self, job: Job) -> None:
        """Take a new version of a job, and write it; a version that cannot be written is written later."""
        self._change(job)
        for job_id in dict.fromkeys([job.id, *self._unsaved]):
            try:
                self._store.save(self._jobs[job_id])
                self._unsaved.pop(job_id, None)
            except FileError as error:
                self._unsaved[job_id] = str(error)

    def _dispatch(self) -> None:
        """Start waiting jobs while fewer than `workers` run."""
        while self._open and self._waiting and len(self._running) < self._workers:
            job_id = self._waiting.popleft()
            self._running[job_id] = Run()
            self._change(replace(self._jobs[job_id], state="running", started=_now()))
            threading.Thread(target=self._work, args=(job_id,), name=f"truepose-job-{job_id}", daemon=True).start()

    def _work(self, job_id: str) -> None:
        """Run a job to its end; whatever goes wrong is its problem, and the queue goes on."""
        run = self._running[job_id]
        try:
            outcome = self._outcome(job_id, run)
        except Exception as error:
            run.kill()
            if run.process is not None:
                run.process.wait()
            outcome = {"state": "failed", "problem": problem(error)}
        with self._changed:
            self._set(
                replace(
                    self._jobs[job_id],
                    ended=_now(),
                    seconds=run.seconds,
                    warnings=tuple(run.warnings),
                    **outcome,
                )
            )
            del self._running[job_id]
            self._changed.notify_all()
            self._dispatch()
            if self._open and not self._running:
                self._processes.prepare()

    def _outcome(self, job_id: str, run: Run) -> dict[str, Any]:
        """Run the command of a job, and return what changes by its end."""
        job = self._jobs[job_id]
        self._store.save(job)
        folder = self._workspace / job.folder
        if not folder.is_dir():
            raise FileError(job.folder, "no such folder")
        given = self._environment(job) if self._environment and job.user else nullcontext({})
        with given as variables:
            return self._run(job, run, folder, variables)

    def _run(self, job: Job, run: Run, folder: Path, variables: Mapping[str, str]) -> dict[str, Any]:
        """Run a command with some variables, and return what changes by its end."""
        job_id = job.id
        process = self._processes.begin(job.command, folder, self._store.output(job), variables)
        with self._changed:
            run.process = process
            if run.stopped is not None:
                process.kill()
        for event in process.events():
            with self._changed:
                if changed := run.take(event):
                    self._change(replace(self._jobs[job_id], **changed))
        code = process.wait()
        return run.outcome(job, code, self._store, process.last_words(code))

    def _stop_runs(self, job_ids: Sequence[str], why: Literal["cancelled", "interrupted"]) -> None:
        """Interrupt jobs that run, kill them after a grace time, and wait for their end."""
        runs = [self._running[job_id] for job_id in job_ids]
        for run in runs:
            run.interrupt(why)

        def gone() -> bool:
            return not any(job_id in self._running for job_id in job_ids)

        if not self._changed.wait_for(gone, _GRACE):
            for run in runs:
                run.kill()
            self._changed.wait_for(gone, _END)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
