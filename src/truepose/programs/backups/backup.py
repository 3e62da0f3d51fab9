"""Recognise the controllers in a folder or .zip by what their makers' backups contain."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from truepose._io.folders import files_within
from truepose._io.zips import check_names, is_zip
from truepose.errors import FileError
from truepose.programs.backups.controller import FORMATS, BackupFormat, Contents, StoredFrames
from truepose.programs.languages import language_of, without_blank


@dataclass(frozen=True, eq=False, repr=False)
class Controller:
    """A controller in a backup.

    Attributes
    ----------
    maker : str
        The maker.
    root : Path
        Its folder.
    name : str
        Its folder as seen from the backup; "." where it is the backup itself.
    contents : Contents
        Its files, sorted.
    frames : StoredFrames
        The tools and bases that it stores outside of programs.
    files : tuple of Path
        All files that belong to it, or to the backup around it.
    """

    maker: str
    root: Path
    name: str
    contents: Contents
    frames: StoredFrames
    files: tuple[Path, ...] = ()

    def __repr__(self) -> str:
        return f"<Controller {self.name}: {self}>"

    def __str__(self) -> str:
        what = [self.maker, self.contents.robot, self.contents.version, f"{self.n_files} files with programs"]
        return ", ".join(filter(None, what))

    @property
    def n_files(self) -> int:
        """The number of files with programs."""
        return sum(map(len, self.contents.programs))

    @property
    def left(self) -> dict[str, int]:
        """The number of files that hold no program, by kind."""
        return dict(Counter(self.contents.others.values()).most_common())

    def to_dict(self) -> dict[str, Any]:
        """Return what is known of it, for JSON."""
        return {
            "name": self.name,
            "maker": self.maker,
            "robot": self.contents.robot,
            "version": self.contents.version,
            "files": self.n_files,
            "left": self.left,
            "warnings": list(self.contents.warnings),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Backup:
    """A folder or .zip with one or more controllers.

    Attributes
    ----------
    path : Path
        The folder or .zip.
    controllers : tuple of Controller
        The controllers.
    files : tuple of Path
        All files. Those in a .zip have paths that lead into it.
    unreadable : tuple of FileError
        The errors of controllers that cannot be understood.
    warnings : tuple of str
        What is left out.
    outside : tuple of Path
        The programs that belong to no controller.
    """

    path: Path
    controllers: tuple[Controller, ...]
    files: tuple[Path, ...] = ()
    unreadable: tuple[FileError, ...] = ()
    warnings: tuple[str, ...] = ()
    outside: tuple[Path, ...] = ()

    def __repr__(self) -> str:
        return f"<Backup {self.path}: {'; '.join(f'{one.name}: {one}' for one in self.controllers)}>"

    @property
    def is_zip(self) -> bool:
        """Whether it is a .zip."""
        return is_zip(self.path)

    @cached_property
    def makers(self) -> tuple[str, ...]:
        """The makers of its controllers."""
        return tuple(dict.fromkeys(one.maker for one in self.controllers))

    def to_dict(self) -> dict[str, Any]:
        """Return its controllers, for JSON."""
        return {
            "file": str(self.path),
            "controllers": [one.to_dict() for one in self.controllers],
            "unreadable": [str(error) for error in self.unreadable],
            "warnings": list(self.warnings),
        }


def format_of(maker: str) -> BackupFormat:
    """Return the module of a maker."""
    return cast(BackupFormat, importlib.import_module(FORMATS[maker]))


def find_backup(path: Path) -> Backup | None:
    """Return the controllers in a folder or .zip; None where a folder is no backup.

    Raises
    ------
    FileError
        If the folder cannot be read, the .zip is refused, or it holds no controller.
    """
    files, warnings = files_within(path)
    files, blank = without_blank(files)
    formats = {maker: format_of(maker) for maker in FORMATS}
    roots = [(root, maker) for maker, module in formats.items() for root in module.roots(files)]
    if not roots:
        if not is_zip(path):
            return None
        raise FileError(path, "holds no backup that is recognised; unpack it and give the folder of its programs")
    check_names([file.relative_to(path).as_posix() for file in files], path)
    controllers, unreadable = [], []
    for root, maker in sorted(roots):
        own = _without_deeper(root, [one for one, _ in roots], files)
        try:
            controllers.append(_controller(maker, formats[maker], root, path, own))
        except FileError as error:
            unreadable.append(error)
    outside = _outside([root for root, _ in roots], controllers, files)
    told = [*warnings, *blank]
    if outside and is_zip(path):  # those of a folder are read
        shown = ", ".join(file.relative_to(path).as_posix() for file in outside)
        told.append(f"{path}: belongs to no controller and is not read: {shown}")
    return Backup(path, tuple(controllers), tuple(files), tuple(unreadable), tuple(told), tuple(outside))


def _controller(maker: str, module: BackupFormat, root: Path, backup: Path, files: Sequence[Path]) -> Controller:
    name = root.relative_to(backup).as_posix()
    return Controller(maker, root, name, module.contents(root, files), module.stored_frames(root, files), tuple(files))


def _without_deeper(root: Path, roots: Sequence[Path], files: Sequence[Path]) -> list[Path]:
    """Return the files without those of controllers whose folders lie in the folder of this one."""
    deeper = [one for one in roots if one != root and one.is_relative_to(root)]
    return [file for file in files if not any(file.is_relative_to(one) for one in deeper)]


def _outside(roots: Sequence[Path], controllers: Sequence[Controller], files: Sequence[Path]) -> list[Path]:
    """Return the programs that belong to no controller, not even to one that cannot be understood."""
    claimed = {file for one in controllers for some in (one.contents.others, *one.contents.programs) for file in some}
    failed = set(roots) - {one.root for one in controllers}
    return [
        file
        for file in files
        if language_of(file) not in ("", "table")
        and file not in claimed
        and not any(file.is_relative_to(root) for root in failed)
    ]
