"""Write a corrected backup: the list of its changed files, and on demand the whole of it, as a folder or .zip."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from truepose._io.delimited import csv_cell
from truepose._io.files import Commit
from truepose._io.zip_writer import write_changed
from truepose._io.zips import is_zip, on_disk
from truepose.errors import FileError
from truepose.programs.record import CHANGED

_BLOCK: Final = 2**20


class Change(NamedTuple):
    """A file of a backup that changes: its new content, and its SHA-256 before and after."""

    content: Callable[[], bytes]
    before: str
    after: str


@dataclass(frozen=True)
class CorrectedFiles:
    """The corrected files of a backup, and where they are written.

    Attributes
    ----------
    backup : Path
        The folder or .zip.
    list_path : Path
        The list of changed files.
    changes : mapping of Path to Change
        The files that change.
    copies : mapping of Path to Path
        The files of the whole backup that are written, each with the file that it is a copy of; empty if it is not.
    """

    backup: Path
    list_path: Path
    changes: Mapping[Path, Change]
    copies: Mapping[Path, Path]

    @classmethod
    def of(cls, backup: Path, folder: Path, changes: Mapping[Path, Change], whole: bool) -> CorrectedFiles:
        """Return what is written below an output folder.

        Raises
        ------
        FileError
            If the folder lies in the backup, or a whole backup holds links, which a copy would change.
        """
        if folder.resolve().is_relative_to(backup.resolve()):
            raise FileError(folder, f"lies in the backup {backup}; choose a folder outside of it")
        return cls(backup, folder / CHANGED, changes, _copies(backup, folder) if whole else {})

    def write(self, commit: Commit) -> None:
        """Write the list, and the whole backup if it is wanted, as parts of a commit."""
        with commit.open(self.list_path) as file:
            file.write(self._list())
        in_zips: dict[Path, dict[str, Callable[[], bytes]]] = {}
        for path, change in self.changes.items():
            if (outer := on_disk(path)) != path:
                in_zips.setdefault(outer, {})[path.relative_to(outer).as_posix()] = change.content
        for goal, source in self.copies.items():
            with commit.open(goal, like=source) as file:
                if source in self.changes:
                    file.write(self.changes[source].content())
                elif source in in_zips:
                    write_changed(source, in_zips[source], file)
                else:
                    with source.open("rb") as old:
                        shutil.copyfileobj(old, file, _BLOCK)

    def keep_times(self) -> None:
        """Give copies the time stamps of the files that they are copies of, where these did not change."""
        changed = {on_disk(path) for path in self.changes}
        for goal, source in self.copies.items():
            if source not in changed:
                status = source.stat()
                os.utime(goal, ns=(status.st_atime_ns, status.st_mtime_ns))

    def _list(self) -> bytes:
        """Return the list: the path of each file in the backup, and its SHA-256 before and after."""
        lines = ["file,sha256_before,sha256_after"]
        for path, change in self.changes.items():
            lines.append(f"{csv_cell(path.relative_to(self.backup).as_posix())},{change.before},{change.after}")
        return ("\n".join(lines) + "\n").encode("utf-8", "backslashreplace")


def _copies(backup: Path, folder: Path) -> dict[Path, Path]:
    if is_zip(backup):
        return {folder / backup.name: on_disk(backup)}
    found: dict[Path, Path] = {}

    def fail(error: OSError) -> None:
        raise FileError(error.filename or backup, f"cannot be read: {error.strerror or error}")

    here = folder / backup.resolve().name
    for place, folders, names in os.walk(backup, onerror=fail):
        folders.sort()
        for file in (Path(place) / name for name in sorted([*names, *folders])):
            if file.is_symlink() or not (file.is_file() or file.is_dir()):
                raise FileError(file, "is a link or no file, which a copy of the whole backup would change; remove it")
            if not file.is_dir():
                found[here / file.relative_to(backup)] = file
    return found
