"""Names of files that jobs will write: none is given out twice before the first is written."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

from truepose.jobs import Job

_LONGEST_S: Final = 60.0
"""The longest time between giving a name out and adding the job that writes it."""


class Promises:
    """The names of a workspace that were given out and do not exist yet.

    A name is taken from the moment that it is given out until the job that writes it has ended.

    Parameters
    ----------
    root : Path
        The workspace.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._given: dict[str, float] = {}
        self._lock = threading.Lock()
        self.jobs: Callable[[], Sequence[Job]] = tuple
        """Returns all jobs of the workspace."""

    def first_free(self, candidates: Iterable[Path]) -> Path | None:
        """Return the first path that no job is to write, and keep it; None if there is none."""
        with self._lock:
            outputs = {(job.active, self._key(self._root / job.folder / job.out)) for job in self.jobs() if job.out}
            added, now = {key for _, key in outputs}, time.monotonic()
            self._given = {
                key: when for key, when in self._given.items() if key not in added and now - when < _LONGEST_S
            }
            taken = {key for active, key in outputs if active} | set(self._given)
            for path in candidates:
                if (key := self._key(path)) not in taken:
                    self._given[key] = now
                    return path
        return None

    @staticmethod
    def _key(path: Path) -> str:
        return os.path.normpath(path).lower()  # some systems do not tell cases apart
