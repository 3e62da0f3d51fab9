"""The index of a correction: columns of its targets and differences of its files, made once by a process of its own.

It lies in the cache of the workspace, in a folder that is named after the record's content, and appears there when it
is whole. Short records are indexed at once, in the server.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from fastapi import FastAPI

from truepose.errors import TrueposeError
from truepose.programs.record import FORMAT, head_of
from truepose.web.corrections.columns import Progress, write_columns
from truepose.web.corrections.differences import Difference, find_pairs, write_differences
from truepose.web.corrections.table import SUMMARY, TargetTable
from truepose.web.problems import WebError, missing

SMALL: Final = 8 << 20
"""The largest size in bytes of a record that the server indexes itself."""
_FORMAT: Final = "2"
_HEAD: Final = 1 << 16
_KEPT_OPEN, _KEPT = 4, 40
_PERIOD_S: Final = 0.3
_TIMEOUT_S: Final = 600.0


def write_index(record: Path, cell: Path, folder: Path, progress: Progress = lambda _done, _all: None) -> None:
    """Write the index of a record to a folder, which appears when it is whole.

    Raises
    ------
    FileError
        If the file is no record of corrections.
    """
    draft = folder.with_name(f".{folder.name}-{secrets.token_hex(4)}")
    draft.mkdir(parents=True)
    try:
        summary = write_columns(record, draft, progress)
        head = head_of(record)
        summary["corrected"] = head.get("corrected", True)
        pairs = find_pairs(record, head["files"], cell) if head.get("format") == FORMAT else []
        summary["files"] = write_differences(pairs, draft)
        (draft / SUMMARY).write_text(json.dumps(summary), encoding="ascii")
        if not folder.exists():
            draft.rename(folder)
    except OSError:
        if not folder.exists():  # otherwise another process was faster
            raise
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@dataclass
class _Building:
    """An index that a process makes."""

    process: subprocess.Popen[str]
    done: int = 0
    total: int = 0
    problem: str = ""
    begun: float = field(default_factory=time.monotonic)


@dataclass(frozen=True)
class Progressed:
    """How far an index is: the number of targets that are read, and of all."""

    ready: bool
    done: int = 0
    total: int = 0


class CorrectionIndexes:
    """The indexes of a workspace.

    Parameters
    ----------
    folder : Path
        Their folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._building: dict[str, _Building] = {}
        self._open: OrderedDict[str, TargetTable] = OrderedDict()
        self._lock = threading.Lock()

    @classmethod
    def of(cls, app: FastAPI) -> CorrectionIndexes:
        """Return the indexes of an application's workspace."""
        state = app.state
        if not hasattr(state, "correction_indexes"):
            state.correction_indexes = cls(state.workspace.own / "cache" / "corrections")
        found: CorrectionIndexes = state.correction_indexes
        return found

    def state(self, record: Path, cell: Path) -> Progressed:
        """Return how far the index of a record is; begin it where there is none.

        Raises
        ------
        FileError
            If the file is no record of corrections.
        WebError
            If it could not be made.
        """
        folder = self._place(record)
        if (folder / SUMMARY).is_file():
            return Progressed(True)
        if record.stat().st_size <= SMALL:
            write_index(record, cell, folder)
            self._forget_old()
            return Progressed(True)
        with self._lock:
            now = self._building.get(folder.name)
            if now is None:
                self._forget_old()
                now = self._building[folder.name] = self._begin(record, cell, folder)
            elif now.process.poll() is not None and not (folder / SUMMARY).is_file():
                del self._building[folder.name]
                raise WebError(500, "Not indexed", now.problem or "the record could not be read; see the terminal")
        return Progressed((folder / SUMMARY).is_file(), now.done, now.total)

    def table(self, record: Path, cell: Path) -> TargetTable:
        """Return the table of the targets of a record.

        Raises
        ------
        WebError
            If the index is still being made.
        """
        name = self._ready(record, cell)
        with self._lock:
            if name in self._open:
                self._open.move_to_end(name)
                return self._open[name]
        table = TargetTable(self._folder / name)
        with self._lock:
            self._open[name] = table
            while len(self._open) > _KEPT_OPEN:
                self._open.popitem(last=False)
        return table

    def difference(self, record: Path, cell: Path, number: int) -> Difference:
        """Return the difference of one file of a record.

        Raises
        ------
        WebError
            If the index is still being made, or there is no such file.
        """
        files = self.table(record, cell).summary["files"]
        if not 0 <= number < len(files):
            raise missing("this file")
        entry: Mapping[str, Any] = files[number]
        if not (entry["before"] and entry["after"]):
            which = "original" if not entry["before"] else "corrected file"
            detail = f"{entry['file']}: the {which} is not in this cell's folder any more, or was changed since"
            raise WebError(404, "Not found", detail)
        return Difference(self._place(record), number, entry)

    def _ready(self, record: Path, cell: Path) -> str:
        if not self.state(record, cell).ready:
            raise WebError(503, "Not ready", "the targets of this record are being indexed; ask again in a moment")
        return self._place(record).name

    def _place(self, record: Path) -> Path:
        """Return the folder of a record's index: by its size, its time, and its head, which holds the files' hashes."""
        try:
            status = record.stat()
            with record.open("rb") as file:
                head = file.read(_HEAD)
        except OSError:
            raise missing("this record") from None
        stamp = f"{_FORMAT} {record} {status.st_size} {status.st_mtime_ns}".encode("utf-8", "surrogateescape")
        return self._folder / hashlib.sha256(stamp + head).hexdigest()[:24]

    def _begin(self, record: Path, cell: Path, folder: Path) -> _Building:
        command = [sys.executable, "-c", f"from {__name__} import main; main()", *map(str, (record, cell, folder))]
        nothing, pipe = subprocess.DEVNULL, subprocess.PIPE
        process = subprocess.Popen(command, stdin=nothing, stdout=pipe, text=True, encoding="ascii")
        building = _Building(process)
        threading.Thread(target=_follow, args=(building,), daemon=True).start()
        return building

    def _forget_old(self) -> None:
        """Remove the oldest indexes, and drafts of processes that were killed."""
        if not self._folder.is_dir():
            return
        known = []
        for path in self._folder.iterdir():
            age = time.time() - path.stat().st_mtime
            if not path.name.startswith("."):
                known.append((age, path))
            elif age > _TIMEOUT_S:
                shutil.rmtree(path, ignore_errors=True)
        for _, path in sorted(known)[_KEPT:]:
            shutil.rmtree(path, ignore_errors=True)


def _follow(building: _Building) -> None:
    """Take the progress of a process as it comes."""
    for line in building.process.stdout or ():
        told = json.loads(line)
        building.done, building.total = told.get("done", building.done), told.get("total", building.total)
        building.problem = told.get("problem", building.problem)
    building.process.wait()


def main() -> None:
    """Index one record: the record, the folder of its cell, the folder of the index."""
    record, cell, folder = map(Path, sys.argv[1:])
    last, parent = 0.0, os.getppid()

    def progress(done: int, total: int) -> None:
        nonlocal last
        if time.monotonic() - last > _PERIOD_S:
            last = time.monotonic()
            _tell(done=done, total=total)
            if os.getppid() != parent:  # the server is gone
                sys.exit(1)

    try:
        write_index(record, cell, folder, progress)
    except TrueposeError as error:
        _tell(problem=str(error))
        sys.exit(1)


def _tell(**members: Any) -> None:
    sys.stdout.write(json.dumps(members) + "\n")
    sys.stdout.flush()
