"""The folder of jobs: one JSON file for each job, the JSON that its command wrote beside it, and a lock."""

from __future__ import annotations

import json
import os
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from truepose._io.files import read_text, write_atomic
from truepose._io.locks import lock
from truepose.errors import FileError, RecoveryWarning
from truepose.jobs.job import Job

LARGEST_RESULT: Final = 1_000_000
"""The largest result, in bytes, that is part of a job; a larger one stays in its file."""
_FORMAT: Final = "truepose job 1"
_FILE: Final = re.compile(r"(\d{8})-[0-9a-f]{8}\.json")


class JobFolder:
    """The folder of jobs.

    Parameters
    ----------
    folder : Path
        The folder; made when it is locked.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock: int | None = None

    def lock(self) -> None:
        """Take the folder for this process.

        Raises
        ------
        FileError
            If another process has it, or it cannot be written.
        """
        path = self._folder / "lock"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror}; choose another workspace") from None
        if not lock(descriptor):
            os.lseek(descriptor, 0, os.SEEK_SET)
            holder = os.read(descriptor, 32).decode("ascii", "replace").strip() or "unknown"
            os.close(descriptor)
            raise FileError(
                self._folder,
                f"is in use by another truepose app (process {holder}); use its page, stop it, or open another folder",
            )
        self._lock = descriptor
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()}\n".encode())

    def unlock(self) -> None:
        """Give the folder free."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def load(self) -> list[Job]:
        """Return the jobs by number; files that hold no job are left out with a warning."""
        found = []
        for path in self._files():
            try:
                found.append(self._read(path))
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                why = str(error).splitlines()[0] if str(error) else type(error).__name__
                warnings.warn(
                    f"{path.name}: left out, because this version cannot read it as a job ({why})", RecoveryWarning, 2
                )
        return found

    def last_number(self) -> int:
        """Return the largest number of a job file, whether it can be read or not."""
        return max((int(path.name.partition("-")[0]) for path in self._files()), default=0)

    def save(self, job: Job) -> None:
        """Write a job, without its result.

        Raises
        ------
        FileError
            If the file cannot be written; the earlier content stays.
        """
        data = {"format": _FORMAT, **job.to_dict()}
        del data["result"]
        path = self._folder / f"{job.id}.json"
        try:
            write_atomic(path, json.dumps(data, indent=1, ensure_ascii=False) + "\n")
        except FileError as error:
            reason = getattr(error.__cause__, "strerror", None) or error
            raise FileError(
                path, f"cannot be written: {reason}; free some space, or allow truepose to write there"
            ) from error.__cause__

    def output(self, job: Job) -> Path:
        """Return the file for the JSON that a job's command writes."""
        return self._folder / f"{job.id}.result"

    def result(self, job: Job) -> Any:
        """Return the JSON that a job's command wrote; None if there is none, or if it is too large for a job.

        Raises
        ------
        FileError
            If it is not JSON.
        """
        path = self.output(job)
        if not job.result_bytes or job.result_bytes > LARGEST_RESULT:
            return None
        try:
            return json.loads(read_text(path))
        except FileError:
            raise
        except (ValueError, RecursionError):
            raise FileError(path, "is not JSON") from None

    def has_result(self, job: Job, size: int) -> bool:
        """Return whether a job's command wrote JSON; this is checked if it is small enough to be part of the job."""
        try:
            return size > LARGEST_RESULT or self.result(replace(job, result_bytes=size)) is not None
        except FileError:
            return False

    def _files(self) -> list[Path]:
        if not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.iterdir() if _FILE.fullmatch(path.name))

    def _read(self, path: Path) -> Job:
        data = json.loads(read_text(path))
        if data["format"] != _FORMAT or data["id"] != path.stem:
            raise ValueError(f"expected {_FORMAT!r} of {path.stem}")
        return Job.from_dict(data)
