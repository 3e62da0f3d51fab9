"""The robots that come with the package, and robots from files."""

from __future__ import annotations

import difflib
from importlib.resources import files
from pathlib import Path
from typing import Final

from truepose._io.files import LARGEST_CONFIG, read_text
from truepose.errors import RobotError
from truepose.robots.io.csv import parse_robot_csv
from truepose.robots.io.plausible import check_units
from truepose.robots.io.toml import parse_robot
from truepose.robots.io.urdf import load_urdf
from truepose.robots.robot import Robot

ROBOT_FILES: Final = (".toml", ".csv", ".urdf")
"""The endings of robot files; other names are those of the library."""
_FOLDER = files("truepose.robots") / "library"


def list_robots() -> list[str]:
    """Return the names of the library's robots, sorted.

    Examples
    --------
    >>> "kuka-kr150-2" in list_robots()
    True
    """
    return sorted(entry.name.removesuffix(".toml") for entry in _FOLDER.iterdir() if entry.name.endswith(".toml"))


def load_robot(name_or_path: str | Path) -> Robot:
    """Return a robot from the library, or from a .toml, .csv or .urdf file.

    Parameters
    ----------
    name_or_path : str or Path
        A name from `list_robots`, or the path of a file. A .csv is a table of D-H parameters, see
        `truepose.robots.parse_robot_csv`. From URDF the chain between the root link and the only tip is read; pass
        other links to `truepose.robots.load_urdf`.

    Raises
    ------
    RobotError
        If the name is no text or path, or unknown (the message lists the nearest ones), or the chain is not supported.
    FileError
        If the file cannot be read, or its content is invalid.

    Examples
    --------
    >>> load_robot("kuka-kr150-2").dof
    6
    """
    if not isinstance(name_or_path, (str, Path)):
        raise RobotError(f"expected a library name or the path of a file; got a {type(name_or_path).__name__}")
    name = str(name_or_path)
    suffix = Path(name).suffix.lower()
    if suffix == ".urdf":
        return load_urdf(name)
    if suffix in (".toml", ".csv"):
        parse = parse_robot if suffix == ".toml" else parse_robot_csv
        robot = parse(read_text(name, LARGEST_CONFIG), path=name)
        check_units(robot, name)
        return robot
    if suffix in (".xacro", ".xml"):
        raise RobotError(f"{name}: only .urdf is read; expand xacro first (xacro {Path(name).name} > robot.urdf)")
    known = list_robots()
    if name not in known:
        raise RobotError(
            f'no robot "{name}"; {_nearest(name.lower(), known)} (or the path of a .toml, .csv or .urdf file)'
        )
    return parse_robot((_FOLDER / f"{name}.toml").read_text("utf-8"), path=f"{name}.toml")


def _nearest(name: str, known: list[str]) -> str:
    """Return the hint of an unknown name: names that contain it, else similar ones."""
    near = [one for one in known if name in one] or difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if near:
        return f"did you mean {' or '.join(near[:3])}?"
    return f"`truepose robots` (list_robots()) lists the {len(known)} names of the library"
