"""What a folder of files holds for a store: the files that the command line writes, recognised by their content."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

from truepose._io.archive import LARGEST_MAP
from truepose._io.files import check_regular
from truepose._io.folders import files_within
from truepose._io.zips import is_zip
from truepose.cell import load_cell
from truepose.error_map import load_map
from truepose.errors import FileError, TrueposeError
from truepose.programs.record import FORMAT as RECORD_FORMAT
from truepose.programs.record import SUFFIX as RECORD_SUFFIX
from truepose.programs.record import head_of
from truepose.report.verification import read_verification
from truepose.samples import read_samples

Kind = Literal["cell", "samples", "map", "correction", "verification"]
"""A kind of object that a file may hold, in the order in which they depend on each other."""
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
_MEASURED: Final = {"x_meas_mm", "y_meas_mm", "z_meas_mm"}
_START: Final = 4096
_CELL: Final = "cell.toml"


@dataclass(frozen=True)
class FileObject:
    """An object in a file.

    Attributes
    ----------
    kind : str
        Its kind.
    path : Path
        The file.
    sha256 : str
        The SHA-256 of the file.
    content : Any
        What was read: a `Cell`, `Samples`, an `ErrorMap`, the head of a record, or a `ProgramVerification`.
    """

    kind: Kind
    path: Path
    sha256: str
    content: Any


@dataclass(frozen=True)
class LeftOut:
    """A file that is not taken, and the reason."""

    path: Path
    reason: str


@dataclass
class FolderContent:
    """The content of a folder.

    Attributes
    ----------
    objects : list of FileObject
        The objects, those that others depend on first; of equal files the first.
    left_out : list of LeftOut
        The files that look like an object and are none, and second copies of a file.
    others : int
        The number of files that are no objects: programs, reports, readings.
    by_hash : dict of str to Path
        A file of each content.
    archives : list of Path
        The .zip files, such as backups of controllers.
    """

    objects: list[FileObject] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    others: int = 0
    by_hash: dict[str, Path] = field(default_factory=dict)
    archives: list[Path] = field(default_factory=list)


def read_folder(folder: Path, progress: Callable[[int, int], None] = lambda done, total: None) -> FolderContent:
    """Return the objects in a folder and below it, or in one file.

    Parameters
    ----------
    folder : Path
        The folder or the file. Links and hidden files are left out.
    progress : callable
        Called with the number of files that are read, and of all.

    Raises
    ------
    FileError
        If the folder does not exist or cannot be read.
    """
    if not folder.exists():
        raise FileError(folder, "no such folder")
    found = FolderContent()
    paths = files_within(folder, unpack=False).files if folder.is_dir() else [folder]
    kinds: list[tuple[Kind, Path, str]] = []
    for number, path in enumerate(paths, 1):
        progress(number, len(paths))
        _look(path, found, kinds)
    for kind, path, digest in sorted(kinds, key=lambda one: KINDS.index(one[0])):
        try:
            found.objects.append(FileObject(kind, path, digest, _READERS[kind](path)))
        except TrueposeError as error:
            found.left_out.append(LeftOut(path, str(error).removeprefix(f"{path}: ")))
    found.objects.sort(key=_order)
    return found


def _order(one: FileObject) -> tuple[int, int, int]:
    """Return the place of an object: after those that it depends on, updated maps after the ones that they are from."""
    kind = KINDS.index(one.kind)
    return (kind, len(one.content.samples), one.path.stat().st_mtime_ns) if one.kind == "map" else (kind, 0, 0)


def _look(path: Path, found: FolderContent, kinds: list[tuple[Kind, Path, str]]) -> None:
    """Add a file to the hashes, and to the objects or to what is left out."""
    try:
        check_regular(path, LARGEST_MAP)
        with path.open("rb") as file:
            start = file.read(_START)
            file.seek(0)
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, TrueposeError) as error:
        found.left_out.append(LeftOut(path, getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")))
        return
    first = found.by_hash.setdefault(digest, path)
    if (kind := kind_of(path, start)) is None:
        found.others += 1
        if is_zip(path):
            found.archives.append(path)
    elif first != path:
        found.left_out.append(LeftOut(path, f"has the same content as {first}"))
    else:
        kinds.append((kind, path, digest))


def kind_of(path: Path, start: bytes) -> Kind | None:
    """Return the kind of object that a file seems to hold, by its name and its first bytes; None for other files."""
    name, suffix = path.name.lower(), path.suffix.lower()
    if name.endswith(RECORD_SUFFIX):
        return "correction"
    if suffix == ".truepose":
        return "map"
    if name == _CELL or (suffix == ".toml" and b"[robot]" in start and b"[tracker" in start):
        return "cell"
    if suffix == ".csv":
        line = start.decode("utf-8-sig", "replace").split("\n", 1)[0].strip()
        return "samples" if set(next(csv.reader([line]), [])) >= _MEASURED else None
    return "verification" if suffix == ".json" and b'"truepose verification"' in start else None


def _record(path: Path) -> dict[str, Any]:
    """Return the head of a record, whose files and hashes are checked."""
    head = head_of(path)
    files = head.get("files")
    if head.get("format") != RECORD_FORMAT or not isinstance(files, list) or not isinstance(head.get("summary"), dict):
        raise FileError(path, "is not the record of a corrected program")
    keys = ("file", "sha256_before", "sha256_after")
    if not all(isinstance(one, dict) and all(isinstance(one.get(key), str) for key in keys) for one in files):
        raise FileError(path, "is a record whose files have no hashes")
    if not isinstance(head.get("map_sha256"), str):
        raise FileError(path, "is a record that does not name its map; correct the program again")
    return head


_READERS: Final[dict[Kind, Callable[[Path], Any]]] = {
    "cell": load_cell,
    "samples": read_samples,
    "map": load_map,
    "correction": _record,
    "verification": read_verification,
}
