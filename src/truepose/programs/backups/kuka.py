"""Backups of KUKA: KRC/R1 … with System/$config.dat and Mada/$machine.dat."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.files import read_bytes
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.programs.backups.controller import Contents, StoredFrame, StoredFrames
from truepose.programs.krl.controller import ConfigDat, Entry, robot_root
from truepose.programs.krl.libraries import is_encoded
from truepose.programs.krl.machine import MachineDat

_ROBOT: Final = re.compile(r"R\d", re.I)
_FOLDERS: Final = ("mada", "program", "system", "tp")
_ENCODED: Final = "encoded"
_SYSTEM: Final = ("system", "tp")
_PROGRAMS: Final = (".src", ".dat", ".sub")
_WORDS: Final = {"mada": "machine data", "steu": "controller data", "c": "controller's settings"}
"""A word for the files of a folder of the controller."""
_ENDINGS: Final = {
    ".log": "log", ".txt": "text", ".xml": "settings", ".ini": "settings", ".config": "settings", ".cfg": "settings",
    ".wvs": "project of the PC tool", ".asz": "safety settings", ".cal": "mastering", ".mam": "mastering",
    ".jpg": "picture", ".png": "picture", ".bmp": "picture", ".bak": "spare copy",
}  # fmt: skip
_POINT: Final = re.compile(rb"^[ \t]*+DECL[ \t]++GLOBAL[ \t]++(?:E6POS|POS)\b", re.I | re.M)
_ARCHIVE: Final = re.compile(r"(?m)^[ \t]*(RobName|IRSerialNr|Version)[ \t]*=[ \t]*(.*?)\s*$")
_ACCURATE: Final = re.compile(
    rb"^[^;\r\n]*\$(ABS_ACCUR[ \t]*=[ \t]*TRUE|DEACTIVATE_ABS_ACCUR[ \t]*=[ \t]*FALSE)", re.I | re.M
)
_OF_HELD_PARTS: Final = {"TCP": True, "BASE": False}
"""Types of tools and bases that say whether the robot holds the part."""
_SAME_MM: Final = 1e-3
_FIRST_OF_POSITIONERS: Final = 17
"""First of the bases that an older controller keeps for its external kinematic systems 1 to 6."""


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the robots among the files of a backup: R1, or R1 and R2 of a controller with two.

    A folder is one if its name is R and a digit and it holds programs of KRL or a ``$config.dat`` in the folders of a
    controller, or if it has any name and both ``System/$config.dat`` and ``Mada/$machine.dat``.
    """
    found: dict[Path, set[str]] = {}
    for file in files:
        for folder, inner in zip(file.parents, [file.name, *(parent.name for parent in file.parents)], strict=False):
            if inner.lower() in _FOLDERS and folder.name.lower() != "steu":
                ending = file.suffix.lower()
                kind = ".src" if inner.lower() != "mada" and ending == ".src" else file.name.lower()
                found.setdefault(folder, set()).add(kind)
    config, machine = "$config.dat", "$machine.dat"
    robots = [
        folder
        for folder, names in found.items()
        if {config, machine} <= names or (_ROBOT.fullmatch(folder.name) and names & {config, machine, ".src"})
    ]
    return sorted(folder for folder in robots if not any(other in folder.parents for other in robots))


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one robot, sorted.

    Programs are those of ``Program``, ``cell.src``, and lists of global points that the operator taught.
    """
    programs, _, others = _sorted(root, files)
    machine = _machine(root, files)
    archive = _archive(root, files)
    warnings = [
        f"{file.relative_to(root)} is encoded and cannot be read; what its routines do is not known"
        for file, word in others.items()
        if word == _ENCODED
    ]
    missing = ""
    if (path := _config(root, files)) is None:
        missing = f"{root.name} has no System/$config.dat"
    else:
        try:
            broken = ConfigDat.read(path).broken
        except FileError as error:
            missing = str(error)
        else:
            warnings += [f"{error}: the frame is not known" for error in broken.values()]
    if missing:
        warnings.append(
            f"{missing}: its tools and bases are not known; copy it from the controller, or give them in [frames] of "
            "the cell file"
        )
    warnings += _accuracy(root, files)
    texts = machine.texts if machine else {}
    return Contents(
        [tuple(programs)] if programs else [],
        others,
        warnings,
        " ".join(filter(None, [texts.get("$TRAFONAME", "").lstrip("#"), archive.get("robname", "")])),
        archive.get("version", "") or texts.get("$V_R1MADA", ""),
        archive.get("irserialnr", "").lstrip("0") if root.name.lower() == "r1" else "",  # it names the first robot
    )


def for_reader(root: Path, files: Sequence[Path]) -> dict[str, list[Path]]:
    """Return the system modules, technology packages and submits, which are read for their effects only."""
    return {"libraries": _sorted(root, files)[1]}


def _sorted(root: Path, files: Sequence[Path]) -> tuple[list[Path], list[Path], dict[Path, str]]:
    """Return the programs of a robot, its libraries, and a word for every file that is no program."""
    programs: list[Path] = []
    libraries: list[Path] = []
    others: dict[Path, str] = {}
    for file in files:
        if root not in file.parents:
            if (word := _outside(file, root)) is not None:
                others[file] = word
            continue
        folder, ending = file.relative_to(root).parts[0].lower(), file.suffix.lower()
        if ending not in _PROGRAMS or folder == "mada":
            others[file] = _WORDS.get(folder) or _ENDINGS.get(ending, "no program")
        elif is_encoded(_bytes(file)):
            others[file] = _ENCODED
            libraries += [] if folder in _SYSTEM else [file]
        elif ending == ".sub":
            others[file] = "submit"
            libraries.append(file)
        elif folder in _SYSTEM and not (folder == "system" and _is_list_of_points(file, files)):
            others[file] = "system module" if folder == "system" else "technology package"
            libraries.append(file)
        elif ending == ".dat" and not _is_data_list(file):
            others[file] = "no program"
        else:
            programs.append(file)
    return programs, libraries, others


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the tools and bases of one robot, and its place in the world.

    Those of zeros without a name are among them, although they are probably not set. None are known where
    ``$config.dat`` is missing or cannot be read; then `contents` has a warning.

    Raises
    ------
    FileError
        If ``$machine.dat`` is broken, or contradicts ``$config.dat``.
    """
    path, machine, config = _config(root, files), _machine(root, files), ConfigDat()
    if path is not None:
        with suppress(FileError):
            config = ConfigDat.read(path)
    if path is None:
        return StoredFrames(in_world=True, tf_world_base=_world(root, files, config))
    frames: dict[str, dict[int | str, StoredFrame]] = {"tool": {}, "base": {}}
    for (which, number), entry in config.entries.items():
        name = config.names.get((which, number), "")
        if entry.tf is None:
            continue
        place = f"{path.relative_to(root.parent)}, line {entry.line}"
        problem = _problem(which, number, entry, config, machine)
        held = _OF_HELD_PARTS.get(config.types.get((which, number), ""))
        frames[which][number] = StoredFrame(entry.tf, name, place, problem, held)
    for (which, number), error in config.broken.items():
        place = f"{path.relative_to(root.parent)}, line {error.line}"
        frames[which][number] = StoredFrame(np.eye(4), "", place, str(error))
    if machine and machine.carriers:
        frames["base"].setdefault(0, StoredFrame(np.eye(4), "$WORLD", "", _carried(machine)))
    return StoredFrames(frames["tool"], frames["base"], in_world=True, tf_world_base=_world(root, files, config))


def _problem(which: str, number: int, entry: Entry, config: ConfigDat, machine: MachineDat | None) -> str:
    """Return why no target can be corrected in a frame; empty where nothing is against it."""
    if which == "base" and machine and machine.carriers:
        return _carried(machine)
    carrier = config.carriers.get((which, number), 0)
    system = config.machines.get(("MACHINE_DEF", carrier))
    if which == "tool" and (system is None or system.mechanism == "ROBOT"):
        return ""
    if carrier:
        named = f"{system.name} ({system.mechanism})" if system else f"kinematic system {carrier}"
        return f"it moves with {named}, which has no model"
    if which == "base" and not config.carriers and machine and machine.positioners and number >= _FIRST_OF_POSITIONERS:
        return f"it may move with the external axis {machine.positioners[0]}, which has no model"
    return ""


def _carried(machine: MachineDat) -> str:
    axes = ", ".join(machine.carriers)
    return f"it moves relative to the robot, which the external axis {axes} carries (#ERSYS) and which has no model"


def _world(root: Path, files: Sequence[Path], config: ConfigDat) -> FloatArray | None:
    """Return the transform from the world to the robot's base."""
    path = _one(root, files, "mada", "$machine.dat")
    found = None if path is None else robot_root(path)
    for (table, number), system in config.machines.items():
        own = table == "MACHINE_DEF" and system.mechanism == "ROBOT" and number == 1
        if not own or system.tf_world_root is None or np.allclose(system.tf_world_root, np.eye(4), atol=_SAME_MM):
            continue
        if found is not None and not np.allclose(found, system.tf_world_root, rtol=0.0, atol=_SAME_MM):
            raise FileError(
                _config(root, files) or root,
                f"MACHINE_DEF[{number}] has another place of the robot than $ROBROOT of {path}; make them agree",
                line=system.line,
            )
    return found


def _config(root: Path, files: Sequence[Path]) -> Path | None:
    return _one(root, files, "system", "$config.dat")


def _machine(root: Path, files: Sequence[Path]) -> MachineDat | None:
    path = _one(root, files, "mada", "$machine.dat")
    return None if path is None else MachineDat.read(path)


def _one(root: Path, files: Sequence[Path], folder: str, name: str) -> Path | None:
    """Return the file of a name in a folder of the robot, in any case of letters; None where there is none."""
    found = [
        file for file in files if file.name.lower() == name and file.parent.name.lower() == folder
        and file.parent.parent == root
    ]  # fmt: skip
    if len(found) > 1:
        raise FileError(found[1], f"{found[0].relative_to(root)} has the same name but for case; keep one")
    return found[0] if found else None


def _outside(file: Path, root: Path) -> str | None:
    """Return a word for a file of the backup beside the robot's folder; None for one that is of another controller."""
    home = root.parent
    if home in file.parents:
        folder = file.relative_to(home).parts[0].lower()
        return _WORDS.get(folder) or (_ENDINGS.get(file.suffix.lower(), "no program") if file.parent == home else None)
    if home.parent in file.parents:
        folder = file.relative_to(home.parent).parts[0].lower()
        if file.parent == home.parent or folder == "c":
            return _ENDINGS.get(file.suffix.lower()) or _WORDS.get(folder, "no program")
    return None


def _bytes(file: Path) -> bytes:
    """Return the bytes of a file; none where it cannot be read, of which the programs' reader gives the reason."""
    try:
        return read_bytes(file)
    except FileError:
        return b""


def _is_data_list(file: Path) -> bool:
    """Return whether a .dat is one of KRL, or cannot be read: reading it again gives the reason."""
    data = _bytes(file)
    return not data or b"DEFDAT" in data[: 1 << 16].upper()


def _is_list_of_points(file: Path, files: Iterable[Path]) -> bool:
    """Return whether a file of the system is a list of global points that a user taught, without a program."""
    if file.suffix.lower() != ".dat" or file.name.startswith("$"):
        return False
    stem = file.stem.lower()
    if any(other.parent == file.parent and other.stem.lower() == stem and other != file for other in files):
        return False
    return _POINT.search(_bytes(file)) is not None


def _archive(root: Path, files: Sequence[Path]) -> dict[str, str]:
    """Return the robot's name, its serial number and the version from the am.ini of an archive."""
    homes = (root.parent, root.parent.parent)
    for file in files:
        if file.name.lower() == "am.ini" and file.parent in homes:
            return {m[1].lower(): m[2] for m in _ARCHIVE.finditer(_bytes(file).decode("cp1252", "replace"))}
    return {}


def _accuracy(root: Path, files: Sequence[Path]) -> list[str]:
    """Return a warning if the controller may compensate the robot's errors itself."""
    folders = (root.parent / "steu", root.parent / "steu" / "mada")
    near = [file for file in files if str(file.parent).lower() in {str(folder).lower() for folder in folders}]
    return [
        f"{file.relative_to(root.parent)}: ${m[1].decode()}: the controller may compensate errors of the robot itself; "
        "correct its programs only with a map that was measured with the same setting"
        for file in near
        if file.suffix.lower() == ".dat" and (m := _ACCURATE.search(_bytes(file)))
    ]
