"""Backups of Universal Robots: .urp programs with their .installation, and .script files.

A program names its installation, which states the TCPs and the features. The .script and .txt beside a .urp are written
by the controller when the program is saved, and are not what the pendant loads.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from truepose.errors import FileError
from truepose.programs.backups.controller import Contents, StoredFrame, StoredFrames
from truepose.programs.backups.frames import same_frame
from truepose.programs.core.packed import PackedSource
from truepose.programs.urp.installation import Installation, Placed, read_installation

_SCRIPTS: Final = (".script", ".urscript")
_OTHERS: Final = {".installation": "installation", ".variables": "variables", ".txt": "text of a program"}
_HEAD: Final = 4096
_ATTRIBUTE: Final = re.compile(rb"\b(robotSerialNumber|lastSavedIn|installation)=\"([^\"]*)\"")
_MODELS: Final = {"30": "UR10", "33": "UR3", "35": "UR5", "50": "UR10e", "53": "UR3e", "55": "UR5e"}
"""Models by the fifth and sixth digit of the serial number."""


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup: the outermost ones with programs."""
    found = {file.parent for file in files if file.suffix.lower() in (".urp", ".installation")}
    return sorted(folder for folder in found if not found & set(folder.parents))


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted."""
    own = [file for file in files if file.is_relative_to(root)]
    programs = [file for file in own if file.suffix.lower() == ".urp"]
    saved = {(file.parent, file.stem.lower()): file.name for file in programs}
    others = {file: kind for file in own if (kind := _OTHERS.get(file.suffix.lower()))}
    written = 0
    for file in own:
        if file.suffix.lower() not in _SCRIPTS:
            continue
        if (program := saved.get((file.parent, file.stem.lower()))) is not None:
            others[file] = f"written by the controller from {program}"
            written += 1
        else:
            programs.append(file)
    about = {file: _about(file) for file in programs if file.suffix.lower() == ".urp"}
    models = sorted({_MODELS.get(one.get("robotSerialNumber", "")[4:6], "") for one in about.values()} - {""})
    serials = sorted({one.get("robotSerialNumber", "") for one in about.values()} - {""})
    versions = sorted({one.get("lastSavedIn", "") for one in about.values()} - {""})
    installations = [one for some in _installations(root, files).values() for one in some]
    warnings = [*_missing(root, own, about), *_serials(root, about)]
    warnings += [f"{one.problem}; programs that name it are refused" for one in installations if one.problem]
    if written:
        warnings.append(
            f"{root.name}: {written} .script beside a .urp are left: load the .urp, the controller writes them again"
        )
    return Contents(
        [(file,) for file in sorted(programs)],
        others,
        warnings,
        " and ".join(models),
        versions[-1] if versions else "",
        serials[0] if len(serials) == 1 else "",
    )


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the TCPs and features of the installations of one controller."""
    known = [one for some in _installations(root, files).values() for one in some]
    tools = [(one.path, one.tcps) for one in known]
    features = [(one.path, one.features) for one in known]
    return StoredFrames(_joined(tools), _joined(features))


def for_reader(root: Path, files: Sequence[Path]) -> dict[str, Any]:
    """Return the installations of one controller by their names in lower case, for the programs that name them."""
    return {"installations": _installations(root, files)}


def _installations(root: Path, files: Sequence[Path]) -> dict[str, list[Installation]]:
    """Return the installations by their names; folders may have their own of one name."""
    own = [file for file in files if file.is_relative_to(root) and file.suffix.lower() == ".installation"]
    found: dict[str, list[Installation]] = {}
    for file in own:
        try:
            one = read_installation(file)
        except FileError as error:
            one = Installation(file, problem=str(error))
        found.setdefault(file.stem.lower(), []).append(one)
    return found


def _joined(tables: Sequence[tuple[Path, Mapping[str, Placed]]]) -> dict[int | str, StoredFrame]:
    """Return the frames of several installations; one that they state differently has a problem."""
    found: dict[int | str, StoredFrame] = {}
    for path, table in tables:
        for name, placed in table.items():
            place = f"{path.name}, line {placed.line}"
            before = found.get(name)
            if before is None:
                found[name] = StoredFrame(placed.tf, name, place)
            elif not before.problem and not same_frame(before.tf, placed.tf):
                found[name] = before._replace(problem=f"{place} states another one")
    return found


def _about(file: Path) -> dict[str, str]:
    """Return what the first element of a program states; nothing where it cannot be read."""
    try:
        head = PackedSource.read(file).data[:_HEAD]
    except FileError:
        return {}  # reading it will give the reason
    head = head[: head.find(b">") + 1]
    return {m[1].decode(): m[2].decode("utf-8", "replace") for m in _ATTRIBUTE.finditer(head)}


def _missing(root: Path, own: Sequence[Path], about: Mapping[Path, Mapping[str, str]]) -> list[str]:
    """Return a warning for each installation that programs name and that is not there."""
    there = {file.stem.lower() for file in own if file.suffix.lower() == ".installation"}
    named: dict[str, int] = {}
    for one in about.values():
        name = one.get("installation", "")
        if name and name.lower() not in there:
            named[name] = named.get(name, 0) + 1
    return [
        f"{root.name}: {n} programs name {name}.installation, which is not there: their features are not known"
        for name, n in named.items()
    ]


def _serials(root: Path, about: Mapping[Path, Mapping[str, str]]) -> list[str]:
    serials: dict[str, list[str]] = {}
    for file, one in about.items():
        if serial := one.get("robotSerialNumber", ""):
            serials.setdefault(serial, []).append(file.name)
    if len(serials) < 2:
        return []
    listed = "; ".join(f"{serial}: {', '.join(names[:3])}" for serial, names in serials.items())
    return [f"{root.name}: programs were saved on {len(serials)} robots ({listed})"]
