"""List the files below a folder or in a .zip."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, NamedTuple

from truepose._io import zips
from truepose._io.commits import recover
from truepose._io.files import read_bytes
from truepose.errors import FileError

_LARGEST_BLANK: Final = 16  # [bytes]


class Found(NamedTuple):
    """The files below a folder or in a .zip.

    Attributes
    ----------
    files : list of Path
        The regular files. Those in a .zip have paths that lead into it.
    warnings : list of str
        What was left out: links, and a .zip in the folder that cannot be read.
    """

    files: list[Path]
    warnings: list[str]


def files_within(path: Path, *, unpack: bool = True) -> Found:
    """Return the files below a folder, which may lie in a .zip: by name, those of a folder before those of its folders.

    Links and names that begin with a dot are left out.

    `unpack`: whether those in a .zip below the folder count, too.

    Raises
    ------
    FileError
        If a folder cannot be read, or the .zip is refused.
    """
    if not os.path.isdir(path):  # noqa: PTH112 - where a path cannot be followed, `Path.is_dir` raises
        found, warnings = zips.within(zips.on_disk(path))
        inside = [file for file in found if file.is_relative_to(path)]
        return Found(sorted([file for file in inside if not _hidden(file.relative_to(path))], key=_order), warnings)
    files: list[Path] = []
    told: list[str] = []

    def fail(error: OSError) -> None:
        raise FileError(error.filename or path, f"cannot be read: {error.strerror or error}")

    for place, folders, names in os.walk(path, onerror=fail):
        recover(Path(place))
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for file in (Path(place) / name for name in sorted(names) if not name.startswith(".")):
            if not file.is_file() or file.is_symlink():
                continue
            if unpack and zips.is_zip(file):
                more, warnings = zips.nested_within(file)
                files, told = files + more, told + warnings
            else:
                files.append(file)
    return Found(sorted(files, key=_order), told)


def is_blank(path: Path) -> bool:
    """Return whether a file is empty but for blanks, line ends and a byte-order mark."""
    try:
        size = path.stat().st_size if zips.on_disk(path) == path else zips.member_size(path)
        return size <= _LARGEST_BLANK and not read_bytes(path).removeprefix(b"\xef\xbb\xbf").strip()
    except (OSError, FileError):
        return False  # reading it will give the reason


def _order(file: Path) -> tuple[tuple[bool, str], ...]:
    *folders, name = file.parts
    return *((True, folder) for folder in folders), (False, name)


def _hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)
