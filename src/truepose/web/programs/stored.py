"""Programs of a cell as they were uploaded: files, folders and backups below ``programs/``."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from truepose._io.zips import is_zip
from truepose.programs.languages import language_of
from truepose.web.multipart import Upload
from truepose.web.problems import missing
from truepose.web.uploads import MOST_FILES
from truepose.web.workspace import CellFolder, identity

FOLDER: Final = "programs"
_KEEPING: Final = threading.Lock()


@dataclass(frozen=True)
class StoredProgram:
    """What was uploaded together: one file, one backup, or a folder of files that belong together.

    Attributes
    ----------
    id : str
        The first digits of the hash of its path in the cell's folder.
    path : Path
        The file or folder.
    name : str
        Its name.
    files : tuple of Path
        Its files, in their order.
    modified : float
        Seconds since 1970.
    size : int
        Bytes of all files.
    """

    id: str
    path: Path
    name: str
    files: tuple[Path, ...]
    modified: float
    size: int

    @property
    def languages(self) -> list[str]:
        """The languages of its files by their endings; a .zip counts as ``zip``."""
        found = {"zip" if is_zip(file) else language_of(file) for file in self.files}
        return sorted(found - {"", "table"}) or sorted(found - {""})

    def given(self) -> list[Path]:
        """Return the paths that a command reads, so that files that belong together stay together.

        A module (one file, or the .src and .dat of one name) is itself. Files of one folder are that folder, since its
        modules are one project or task. Each .zip is named by itself.
        """
        zips = [file for file in self.files if is_zip(file)]
        others = [file for file in self.files if not is_zip(file)]
        if len({file.with_suffix("") for file in others}) == 1:
            return [*zips, min(others, key=lambda file: file.suffix.lower() != ".src")]
        return [*zips, *([self.path] if others else [])]


def stored_programs(cell: CellFolder) -> list[StoredProgram]:
    """Return the uploads of a cell, newest first."""
    folder = cell.folder / FOLDER
    try:
        entries = [Path(entry.path) for entry in os.scandir(folder) if not entry.name.startswith(".")]
    except OSError:
        return []
    found = [one for path in entries if (one := _stored(cell, path)) is not None]
    return sorted(found, key=lambda one: (-one.modified, one.name))


def stored_program(cell: CellFolder, id_: str) -> StoredProgram:
    """Return one upload of a cell.

    Raises
    ------
    WebError
        If there is no such upload.
    """
    for one in stored_programs(cell):
        if one.id == id_:
            return one
    raise missing("this program")


def keep(cell: CellFolder, upload: Upload) -> StoredProgram:
    """Give an upload its place below ``programs/``, under a name that is not taken, and return it.

    A dropped folder keeps its name; other files get a folder that is named after the first of them.
    """
    names = list(upload.files)
    tops = {name.parts[0] for name in names}
    if len(tops) == 1 and len(names[0].parts) > 1:
        part, name = PurePosixPath(names[0].parts[0]), names[0].parts[0]
    else:
        part, first = PurePosixPath(), min(names, key=_rank)
        name = Path(first).stem if len(first.parts) == 1 else first.parts[0]
    with _KEEPING:  # so that no other upload takes the name meanwhile
        goal = upload.keep(cell.new(FOLDER, name), part)
    kept = _stored(cell, goal)
    if kept is None:
        raise missing("this upload")
    return kept


def _rank(name: PurePosixPath) -> tuple[bool, int, str]:
    """Return what makes a file stand for an upload: a program before a list of frames, an outer file before others."""
    return name.name.startswith("$") or not language_of(Path(name)), len(name.parts), name.name.lower()


def _stored(cell: CellFolder, path: Path) -> StoredProgram | None:
    """Return what lies at a path; None for links and for what was removed meanwhile."""
    if path.is_symlink():
        return None
    try:
        files = tuple(_files(path))
        size = sum(file.stat().st_size for file in files)
        modified = path.stat().st_mtime
    except OSError:
        return None
    return StoredProgram(identity(cell.relative(path)), path, path.name, files, modified, size) if files else None


def _files(path: Path) -> Iterator[Path]:
    if path.is_file():
        yield path
        return
    count = 0
    for place, folders, names in os.walk(path):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for file in (Path(place) / name for name in sorted(names) if not name.startswith(".")):
            if file.is_file() and not file.is_symlink():
                yield file
                count += 1
                if count == MOST_FILES:
                    return
