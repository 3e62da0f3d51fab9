"""The place of a robot in its controller's world: $ROBROOT of KUKA's $machine.dat, base frames of ABB's MOC.cfg.

Bases and workobjects are given in that world, error maps in the robot's own base. Usually both are the same, and
nothing changes. Otherwise every frame that is given in the world is turned into the robot's base.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError, FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source, parse_number
from truepose.programs.frame_table import FrameTable
from truepose.programs.krl.controller import robot_root

_LEVELS: Final = 5
"""Number of folders above a program that may belong to its controller's backup."""
_BESIDE: Final = {"krl": ("", "Mada"), "rapid": ("", "SYSPAR")}
_NAMES: Final = {"krl": "$machine.dat", "rapid": "moc.cfg"}
_M: Final = 1000.0  # MOC.cfg is in metres
_RECORD: Final = re.compile(r"(?m)^\s*$")
_VALUE: Final = re.compile(r"-(\w+)(?:\s+(\"[^\"]*\"|[^\s-][^\s]*|-[\d.][^\s]*))?")


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
        tf_world_base = robot_root(file) if language == "krl" else _of_moc(file)
        if tf_world_base is not None:
            frames = frames.standing_at(tf_world_base, str(file))
    return frames


def _files(path: Path, language: str) -> list[Path]:
    """Return the files about the robot's base that belong to a program or a folder of them."""
    if (name := _NAMES.get(language)) is None:
        return []
    found = list(_within(path, name)) if path.is_dir() else []
    here = path.resolve() if path.is_dir() else path.resolve().parent
    above = iter([here, *here.parents][: _LEVELS + 1])
    while not found and (folder := next(above, None)) is not None:
        found = [file for beside in _BESIDE[language] for file in _named(folder / beside, name)]
    return found


def _within(folder: Path, wanted: str) -> Iterator[Path]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(place) / name for name in sorted(files) if name.lower() == wanted)


def _named(folder: Path, wanted: str) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry) for entry in entries if entry.name.lower() == wanted and entry.is_file())
    except OSError:
        return []


def _of_moc(path: Path) -> FloatArray | None:
    """Return the base frame of the robot of a MOC.cfg, (4, 4) [mm]; None where there is no robot."""
    bases: dict[str, FloatArray] = {}
    for record in _RECORD.split(_section(Source.read(path).data.decode("latin-1"), "ROBOT")):
        values = {m[1].lower(): (m[2] or "").strip('"') for m in _VALUE.finditer(record)}
        if values:
            name = values.get("name", f"robot {len(bases) + 1}")
            if carrier := values.get("base_frame_coordinated"):
                raise FileError(path, f"the base of {name} is carried by {carrier}, which has no model")
            bases[name] = _base_frame(values, path, name)
    first = next(iter(bases.values()), None)
    if first is not None and not all(np.allclose(tf, first, rtol=0.0, atol=1e-6) for tf in bases.values()):
        raise DataError(
            f"{path}: the robots {', '.join(bases)} stand in different places; state where the world lies as seen from "
            "the robot of this map, in [frames.bases.0] of the cell file, and move MOC.cfg away"
        )
    return first


def _section(text: str, name: str) -> str:
    """Return the lines of a section of a configuration file, continued lines joined."""
    joined = text.replace("\r\n", "\n").replace("\\\n", " ")
    match = re.search(rf"(?ms)^{name}:\s*$(.*?)(?=^#|\Z)", joined)
    return match[1] if match else ""


def _base_frame(values: dict[str, str], path: Path, name: str) -> FloatArray:
    def number(key: str, default: float) -> float:
        try:
            return parse_number(values[key].encode("latin-1")) if key in values else default
        except ValueError as error:
            raise FileError(path, f"{name}: {key}: {error}") from None

    p = [_M * number(f"base_frame_pos_{axis}", 0.0) for axis in "xyz"]
    quaternion = [number(f"base_frame_orient_u{k}", float(k == 0)) for k in range(4)]
    try:
        return make_transform(euler("abb", quaternion), p)
    except DataError as error:
        raise FileError(path, f"{name}: base_frame_orient: {error}") from None
