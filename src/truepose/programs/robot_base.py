"""The place of a robot in its controller's world: $ROBROOT of KUKA's $machine.dat, base frames of ABB's MOC.cfg.

Bases and workobjects are given in that world, error maps in the robot's own base. Usually both are the same, and
nothing changes. Otherwise every frame that is given in the world is turned into the robot's base.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.folders import files_within
from truepose._io.zips import is_zip, on_disk
from truepose._typing import FloatArray
from truepose.errors import DataError, FileError
from truepose.programs.frame_table import FrameTable
from truepose.programs.krl.controller import robot_root
from truepose.programs.rapid.controller import AbbRobot, backup_information, configured_tasks, robots

_LEVELS: Final = 5
"""Number of folders above a program that may belong to its controller's backup."""
_BESIDE: Final[dict[str, tuple[tuple[str, ...], ...]]] = {"krl": ((), ("mada",)), "rapid": ((), ("syspar",))}
_NAMES: Final = {"krl": "$machine.dat", "rapid": "moc.cfg"}
_TASK: Final = re.compile(r"TASK\d+", re.I)


def standing(frames: FrameTable, path: Path, language: str) -> FrameTable:
    """Return the frames relative to the base of the robot that a program belongs to.

    Parameters
    ----------
    frames : FrameTable
        The controller's tools and bases.
    path : Path
        The program, or the folder of a project.
    language : str
        The name of the language.

    Raises
    ------
    FileError
        If a file about the robot's base cannot be understood.
    DataError
        If files disagree with each other or with the user's statement, or if several robots have different places.
    """
    for file in _files(path, language):
        tf_world_base = robot_root(file) if language == "krl" else _of_moc(file, path)
        if tf_world_base is not None:
            frames = frames.standing_at(tf_world_base, str(file))
    return frames


def _files(path: Path, language: str) -> list[Path]:
    """Return the files about the robot's base that belong to a program or a folder of them."""
    if (name := _NAMES.get(language)) is None:
        return []
    found = _within(path, name) if path.is_dir() or on_disk(path) != path else []
    here = path.resolve() if path.is_dir() else path.resolve().parent
    above = iter([here, *here.parents][: _LEVELS + 1])
    while not found and (folder := next(above, None)) is not None:
        found = [file for beside in _BESIDE[language] for file in _at(folder, *beside, name)]
    return found


def _within(folder: Path, wanted: str) -> list[Path]:
    return [file for file in files_within(folder, unpack=False).files if file.name.lower() == wanted]


def _at(folder: Path, *names: str) -> list[Path]:
    """Return the files of a path below a folder, which may lie in a .zip; `names` are its parts in lower case."""
    if is_zip(outer := on_disk(folder)) and outer.is_file():
        wanted = "/".join(names)
        inside = files_within(folder, unpack=False).files
        return [file for file in inside if file.relative_to(folder).as_posix().lower() == wanted]
    places = [folder]
    for name in names:
        places = [entry for place in places for entry in _entries(place, name)]
    return [place for place in places if place.is_file()]


def _entries(folder: Path, name: str) -> list[Path]:
    """Return the entries of a folder with a name in lower case; folders may have many others."""
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry) for entry in entries if entry.name.lower() == name)
    except OSError:
        return []


def _of_moc(moc: Path, path: Path) -> FloatArray | None:
    """Return the base frame of a program's robot, (4, 4) [mm]; None where MOC.cfg has no robot."""
    found = robots(moc)
    own = own_robot(found, moc, path)
    for robot in found if own is None else [own]:
        if robot.carrier:
            raise FileError(moc, f"the base of {robot.name} is carried by {robot.carrier}, which has no model")
    if own is not None or not found:
        return None if own is None else own.tf_world_base
    first = found[0].tf_world_base
    if not all(np.allclose(robot.tf_world_base, first, rtol=0.0, atol=1e-6) for robot in found):
        names = ", ".join(robot.name for robot in found)
        raise DataError(
            f"{moc}: the robots {names} stand in different places, and which of them this task moves is not known "
            "(BACKINFO/backinfo.txt and SYSPAR/SYS.cfg state it); give the backup as it is, or state where the world "
            "lies as seen from the robot of this map, in [frames.bases.0] of the cell file, and move MOC.cfg away"
        )
    return first


def own_robot(found: Sequence[AbbRobot], moc: Path, path: Path) -> AbbRobot | None:
    """Return the robot that the task of a program moves; None where the backup does not state it."""
    here = path.resolve()
    folder = next(
        (f for f in [here, *here.parents] if _TASK.fullmatch(f.name) and f.parent.name.upper() == "RAPID"), None
    )
    if folder is None:
        return None
    listed = _at(folder.parent.parent, "backinfo", "backinfo.txt")
    configured = _at(moc.parent, "sys.cfg")
    if len(listed) != 1 or len(configured) != 1:
        return None
    task = backup_information(listed[0]).tasks.get(folder.name.upper())
    unit = configured_tasks(configured[0]).units.get(task.name, "") if task else ""
    return next((robot for robot in found if unit.lower() in robot.units), None)
