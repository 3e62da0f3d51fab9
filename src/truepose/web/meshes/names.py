"""Which of the uploaded files a URDF file means; the names in it are labels, never paths."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from truepose._io.zips import is_zip, within
from truepose.errors import one_line
from truepose.web.meshes.index import MeshNote

_SCHEME: Final = re.compile(r"(?i)^(package|model|file)://|^\$\(find ([^)]*)\)|^[a-z]:(?=[/\\])")


def files_of(uploaded: Mapping[str, Path]) -> tuple[dict[str, Path], list[MeshNote]]:
    """Return the files of an upload by their names, those of .zip files too, and notes about links in these.

    Raises
    ------
    FileError
        If a .zip is refused.
    """
    found: dict[str, Path] = {}
    notes = []
    for name, path in uploaded.items():
        if not is_zip(path):
            found[name] = path
            continue
        inside, warnings = within(path)
        found |= {f"{name}/{file.relative_to(path).as_posix()}": file for file in inside}
        notes += [MeshNote(kind="link", name=one_line(text.replace(f"{path}/", ""))) for text in warnings]
    return found, notes


def resolve(reference: str, urdf: str, files: Mapping[str, Path]) -> list[str]:
    """Return the names of the files that a reference of a URDF file can mean; none, one, or several.

    ``package://NAME/meshes/a.stl`` is the file in a folder NAME. Where there is no such folder, since only a part of
    the package was uploaded or its folder was renamed, the file with the longest common end is meant; among several
    ones that beside the URDF file. Letter case and the direction of slashes do not matter.
    """
    bare = reference.strip().replace("\\", "/")
    package = _SCHEME.match(bare)
    bare = f"{package[2] or ''}/{bare[package.end() :]}" if package else bare
    parts: list[str] = [] if package else _folded(urdf)[:-1]
    for part in unquote(bare).casefold().split("/"):
        if part == "..":
            parts = parts[:-1]
        elif part not in ("", "."):
            parts.append(part)
    folded = {name: _folded(name) for name in files}
    for start in range(len(parts)):
        tail = parts[start:]
        same = [name for name, one in folded.items() if one[-len(tail) :] == tail]
        if same:
            near = {name: _common(folded[name], _folded(urdf)) for name in same}
            return [name for name in same if near[name] == max(near.values())]
    return []


def _folded(name: str) -> list[str]:
    return name.casefold().replace("\\", "/").split("/")


def _common(one: list[str], other: list[str]) -> int:
    """Return the number of folders that two names share."""
    count = 0
    for a, b in zip(one, other, strict=False):
        if a != b:
            break
        count += 1
    return count
