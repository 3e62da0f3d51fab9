"""Corrections of a workspace: the records that the application and the command line wrote."""

from __future__ import annotations

import csv
import io
import os
import threading
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from truepose._io.workbook import to_workbook
from truepose._io.zips import is_zip, on_disk
from truepose.errors import FileError
from truepose.programs.record import CHANGED, FORMAT, SUFFIX, head_of
from truepose.web.corrections.differences import folders_above
from truepose.web.problems import WebError, missing
from truepose.web.workspace import CellFolder, StoredFile, Workspace, identity

_PIECE: Final = 1 << 20
_MOST_ROWS: Final = 100_000
_HEADS: Final = 2000


@dataclass(frozen=True)
class StoredCorrection:
    """A correction: the record of one program.

    Attributes
    ----------
    id : str
        The first digits of the hash of the record's path in the workspace.
    cell : CellFolder
        Its cell.
    file : StoredFile
        The record.
    head : mapping
        The record without its targets.
    """

    id: str
    cell: CellFolder
    file: StoredFile
    head: Mapping[str, Any]

    @property
    def record(self) -> Path:
        """The record (JSON)."""
        return self.file.path

    @property
    def stem(self) -> str:
        """The name of the record without its ending."""
        return self.record.name[: -len(SUFFIX)]

    def beside(self, ending: str) -> Path:
        """Return another form of the record, such as ``.corrections.csv``."""
        return self.record.with_name(self.stem + ending)


@lru_cache(maxsize=_HEADS)
def _head(path: Path, _changed: int, _size: int) -> Mapping[str, Any]:
    return head_of(path)


def _correction(workspace: Workspace, cell: CellFolder, file: StoredFile) -> StoredCorrection | None:
    """Return the correction of a record; None for a file that is no record of ours."""
    try:
        status = file.path.stat()
        head = _head(file.path, status.st_mtime_ns, status.st_size)
    except (OSError, FileError):
        return None
    if head.get("format") != FORMAT or not isinstance(head.get("files"), list):
        return None
    return StoredCorrection(identity(file.path.relative_to(workspace.root).as_posix()), cell, file, head)


def corrections(workspace: Workspace, cell: CellFolder) -> list[StoredCorrection]:
    """Return the corrections of a cell, newest first."""
    return [one for file in cell.files("record") if (one := _correction(workspace, cell, file)) is not None]


class CorrectionFinder:
    """Finds corrections by their ids without a walk through the workspace each time.

    Parameters
    ----------
    workspace : Workspace
        The workspace.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._known: dict[str, tuple[CellFolder, StoredFile]] = {}
        self._lock = threading.Lock()

    def find(self, id_: str) -> StoredCorrection:
        """Return a correction.

        Raises
        ------
        WebError
            If there is no such correction.
        """
        with self._lock:
            known = self._known.get(id_)
        if known is not None and (found := _correction(self._workspace, *known)) is not None:
            return found
        for cell in self._workspace.cells():
            for one in corrections(self._workspace, cell):
                with self._lock:
                    self._known[one.id] = (one.cell, one.file)
                if one.id == id_:
                    return one
        raise missing("this correction")


def files_to_send(correction: StoredCorrection, files: list[Mapping[str, Any]]) -> dict[str, Path]:
    """Return the files of a download by their names in it: the corrected files, and the record in its forms.

    `files` are those of the index. Of a whole backup that is a .zip, that .zip is sent.
    """
    folders = folders_above(correction.record, correction.cell.folder)[:-1]
    wanted = [on_disk(Path(one["after"])) for one in files if one["after"]]
    wanted += [correction.beside(ending) for ending in (SUFFIX, ".corrections.csv", ".corrections.xlsx")]
    wanted += [folder / CHANGED for folder in folders]
    found = list(dict.fromkeys(path for path in wanted if path.is_file()))
    root = os.path.commonpath([path.parent for path in found])
    return {path.relative_to(root).as_posix(): path for path in found}


def zipped(files: Mapping[str, Path]) -> Iterator[bytes]:
    """Yield a .zip of files piece by piece; nothing is written to the disk."""
    out = _Pieces()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=5) as archive:
        for name, path in files.items():
            info = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
            info.compress_type = zipfile.ZIP_STORED if is_zip(path) else zipfile.ZIP_DEFLATED
            with path.open("rb") as source, archive.open(info, "w", force_zip64=info.file_size > 1 << 30) as goal:
                while piece := source.read(_PIECE):
                    goal.write(piece)
                    yield out.taken()
            yield out.taken()
    yield out.taken()


class _Pieces(io.RawIOBase):
    """A file that cannot be read again: what is written is taken away."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._waiting += data
        return len(data)

    def taken(self) -> bytes:
        found = bytes(self._waiting)
        self._waiting.clear()
        return found


def workbook(correction: StoredCorrection) -> bytes:
    """Return the record as a workbook.

    Raises
    ------
    WebError
        If it has too many targets.
    """
    made = correction.beside(".corrections.xlsx")
    if made.is_file():
        return made.read_bytes()
    if int(correction.head.get("summary", {}).get("targets", 0)) > _MOST_ROWS:
        raise WebError(422, "Too large", f"more than {_MOST_ROWS:,} targets; take the CSV, which every table reads")
    path = correction.beside(".corrections.csv")
    if not path.is_file():
        raise missing("the CSV of this record")
    with path.open(encoding="utf-8", newline="") as rows:
        return to_workbook(csv.reader(rows))
