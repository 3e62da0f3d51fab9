"""The workspace: a folder of cells, with the files that the command line and the pages write."""

from __future__ import annotations

import csv
import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, Literal

from fastapi import Depends, Request

from truepose.cell import Cell, load_cell
from truepose.error_map import ErrorMap, load_map
from truepose.error_map.encoding import hash_of
from truepose.errors import FileError
from truepose.jobs import JobQueue
from truepose.programs.record import SUFFIX as RECORD_SUFFIX
from truepose.web.problems import missing
from truepose.web.promises import Promises
from truepose.web.uploads import safe_name

Kind = Literal["map", "samples", "plan", "record", "verification", "report", "readings", "program"]
"""A kind of file of a cell; readings and programs are known by the folder that the pages put them into."""
OWN: Final = ".truepose"
"""The folder of jobs and caches in a workspace."""
_DEPTH, _MOST_FILES = 3, 20_000
_CELL: Final = "cell.toml"
_FOLDERS: Final[dict[str, Kind]] = {"readings": "readings", "programs": "program"}
_MAPS_KEPT: Final = 4


@dataclass(frozen=True)
class StoredFile:
    """A file of a cell.

    Attributes
    ----------
    id : str
        The first digits of the hash of its path in the cell's folder.
    path : Path
        The file.
    name : str
        Its path in the cell's folder, with slashes.
    kind : str
        Its kind.
    modified : float
        Seconds since 1970.
    size : int
        Bytes.
    """

    id: str
    path: Path
    name: str
    kind: Kind
    modified: float
    size: int


def identity(name: str) -> str:
    """Return the identity of something that has this path inside its folder."""
    return hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True)
class CellFolder:
    """A cell of the workspace: the folder of a cell file.

    Attributes
    ----------
    id : str
        The first digits of the hash of its path in the workspace.
    folder : Path
        Its folder.
    name : str
        Its path in the workspace, with slashes; the name of the workspace if that is a cell itself.
    promises : Promises
        The names of files that jobs are to write.
    """

    id: str
    folder: Path
    name: str
    promises: Promises = field(repr=False, compare=False)

    @property
    def file(self) -> Path:
        """The cell file."""
        return self.folder / _CELL

    def load(self) -> Cell:
        """Return the cell of the cell file."""
        return load_cell(self.file)

    def files(self, kind: Kind | None = None) -> list[StoredFile]:
        """Return the files of the cell, newest first."""
        found = [one for path in _walk(self.folder) if (one := self._stored(path)) is not None]
        return sorted((one for one in found if kind in (None, one.kind)), key=lambda one: (-one.modified, one.name))

    def get(self, id_: str, kind: Kind | None = None) -> StoredFile:
        """Return one file of the cell.

        Raises
        ------
        WebError
            If there is no such file.
        """
        for one in self.files(kind):
            if one.id == id_:
                return one
        raise missing(f"this {kind or 'file'}")

    def new(self, folder: str, name: str) -> Path:
        """Return a path for a new file or folder, such as ``maps/a.truepose``.

        It is never that of an existing one, nor one that a waiting or running job is to write. The folder
        is one of ours; the name may come from anywhere.
        """
        if (self.folder / folder).is_symlink():
            raise FileError(self.folder / folder, "is a link; replace it by a folder")
        name = safe_name(name)
        stem, dot, suffix = name.partition(".")
        taken = _names(self.folder / folder)
        numbered = (name if number == 1 else f"{stem}-{number}{dot}{suffix}" for number in range(1, _MOST_FILES))
        candidates = (self.folder / folder / free for free in numbered if free.lower() not in taken)
        if (found := self.promises.first_free(candidates)) is not None:
            return found
        raise FileError(self.folder / folder, "holds too many files; remove some")

    def relative(self, path: Path) -> str:
        """Return the path of a file as commands that run in the cell's folder name it."""
        return path.relative_to(self.folder).as_posix()

    def word(self, path: Path) -> str:
        """Return the path of any file of the workspace as a word of a command that runs in the cell's folder.

        It is no option, whatever its name.
        """
        word = Path(os.path.relpath(path, self.folder)).as_posix()
        return f"./{word}" if word.startswith("-") else word

    def _stored(self, path: Path) -> StoredFile | None:
        try:
            status = path.stat()
            kind = self._kind(path)
        except OSError:  # removed meanwhile
            return None
        if kind is None:
            return None
        name = self.relative(path)
        return StoredFile(identity(name), path, name, kind, status.st_mtime, status.st_size)

    def _kind(self, path: Path) -> Kind | None:
        suffix = path.suffix.lower()
        if path.name.lower().endswith(RECORD_SUFFIX):
            return "record"
        if (kind := _FOLDERS.get(path.relative_to(self.folder).parts[0])) is not None:
            return kind
        if suffix == ".truepose":
            return "map"
        if suffix == ".csv":
            return _kind_of_table(path)
        if suffix == ".json":
            return "verification" if b'"truepose verification"' in _start(path) else None
        return "report" if suffix in (".html", ".pdf") else None


def _names(folder: Path) -> set[str]:
    """Return the names in a folder in lower case, since some systems do not tell cases apart."""
    return {path.name.lower() for path in folder.iterdir()} if folder.is_dir() else set()


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(4096)


def _kind_of_table(path: Path) -> Kind | None:
    """Return the kind of a table by its header: samples hold readings, plans hold commanded poses only."""
    line = _start(path).decode("utf-8-sig", "replace").split("\n", 1)[0]
    columns = set(next(csv.reader([line.strip()]), []))
    if {"x_meas_mm", "y_meas_mm", "z_meas_mm"} <= columns:
        return "samples"
    return "plan" if {"row", "x_cmd_mm"} <= columns or {"row", "q1_deg"} <= columns else None


def _walk(folder: Path, depth: int = _DEPTH) -> Iterator[Path]:
    """Yield the files below a folder, without those of cells inside of it, of links and of hidden folders."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        if entry.name.startswith(".") or entry.is_symlink():
            continue
        if entry.is_file():
            yield Path(entry.path)
        elif depth and entry.is_dir() and not _is_cell(Path(entry.path)):
            yield from _walk(Path(entry.path), depth - 1)


class Workspace:
    """A folder of cells.

    Parameters
    ----------
    root : Path
        The folder; made if it does not exist.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self.root.mkdir(parents=True, exist_ok=True)
        self.promises = Promises(self.root)
        self._maps: OrderedDict[tuple[Path, int, int], ErrorMap] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def own(self) -> Path:
        """The folder of jobs and caches."""
        return self.root / OWN

    def cells(self) -> list[CellFolder]:
        """Return the cells by name."""
        return [self._cell(folder) for folder in _cell_folders(self.root)]

    def cell(self, id_: str) -> CellFolder:
        """Return one cell.

        Raises
        ------
        WebError
            If there is no such cell.
        """
        for one in self.cells():
            if one.id == id_:
                return one
        raise missing("this cell")

    def new_cell(self, name: str) -> CellFolder:
        """Return the cell of a folder that does not exist yet; a name that is taken gets a number."""
        name = safe_name(name.replace("/", "_").replace("\\", "_"))  # a slash that a person types starts no folder
        taken = _names(self.root)
        numbered = (name if number == 1 else f"{name}-{number}" for number in range(1, _MOST_FILES))
        return self._cell(self.root / next(free for free in numbered if free.lower() not in taken))

    def maps(self) -> Iterator[tuple[CellFolder, StoredFile]]:
        """Yield the map files of all cells."""
        for cell in self.cells():
            for file in cell.files("map"):
                yield cell, file

    def load(self, file: StoredFile) -> ErrorMap:
        """Return the map of a file, from memory if it was read before and has not changed."""
        key = (file.path, file.path.stat().st_mtime_ns, file.size)
        with self._lock:
            if key in self._maps:
                self._maps.move_to_end(key)
                return self._maps[key]
        error_map = load_map(file.path)
        with self._lock:
            self._maps[key] = error_map
            while len(self._maps) > _MAPS_KEPT:
                self._maps.popitem(last=False)
        return error_map

    def map(self, sha: str) -> tuple[CellFolder, StoredFile, ErrorMap]:
        """Return a map by the SHA-256 of its file, with its cell.

        Raises
        ------
        WebError
            If no cell holds it.
        """
        for cell, file in self.maps():
            if self.hash_of(file) == sha:
                return cell, file, self.load(file)
        raise missing("this map")

    def hash_of(self, file: StoredFile) -> str:
        """Return the hash of a map file."""
        key = (file.path, file.path.stat().st_mtime_ns, file.size)
        with self._lock:
            loaded = self._maps.get(key)
        if loaded is not None:
            return loaded.hash
        data = file.path.read_bytes()
        try:
            return hash_of(data, file.path)
        except FileError:
            return hashlib.sha256(data).hexdigest()  # no map; its page says what it is

    def _cell(self, folder: Path) -> CellFolder:
        name = folder.relative_to(self.root).as_posix()
        return CellFolder(identity(name), folder, self.root.name if folder == self.root else name, self.promises)


def _is_cell(folder: Path) -> bool:
    """Return whether a folder holds a cell file of its own; a link may lead anywhere."""
    return (folder / _CELL).is_file() and not (folder / _CELL).is_symlink()


def _cell_folders(folder: Path, depth: int = _DEPTH) -> Iterator[Path]:
    if _is_cell(folder):
        yield folder
    if not depth:
        return
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        if entry.is_dir(follow_symlinks=False) and not entry.name.startswith("."):
            yield from _cell_folders(Path(entry.path), depth - 1)


def _workspace(request: Request) -> Workspace:
    workspace: Workspace = request.app.state.workspace
    return workspace


def _cell_folder(request: Request, cell: str) -> CellFolder:
    return _workspace(request).cell(cell)


def _jobs(request: Request) -> JobQueue:
    jobs: JobQueue = request.app.state.jobs
    return jobs


InWorkspace = Annotated[Workspace, Depends(_workspace)]
"""The workspace, as a parameter of a route."""
InCell = Annotated[CellFolder, Depends(_cell_folder)]
"""The cell of the path parameter ``cell``, as a parameter of a route."""
InJobs = Annotated[JobQueue, Depends(_jobs)]
"""The queue of jobs, as a parameter of a route."""
