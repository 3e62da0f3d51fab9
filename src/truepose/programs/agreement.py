"""Checks that a map belongs to the robot of a program and of a cell file."""

from __future__ import annotations

import unicodedata
from typing import Final

from truepose.cell import Cell
from truepose.errors import RefusedError
from truepose.programs.core.program import Program
from truepose.programs.reading import LANGUAGES, language_of
from truepose.robots import Robot, to_toml

_OF_THE_MAP: Final = ("tool", "base", "tracker", "payload")
"""Tables of a cell file that a map was fitted with, and that a correction does not read again."""


def check_cell(own: Cell, robot: Robot, cell: Cell) -> list[str]:
    """Refuse a cell file of another robot; return warnings about its tables that differ from the map's.

    Such tables have no effect on a correction.

    Raises
    ------
    RefusedError
        If the robots differ.
    """
    other = cell.load_robot()
    if other.name != robot.name and to_toml(other) != to_toml(robot):
        raise RefusedError(f"the cell file is of {other.name}, the map of {robot.name}; take the cell file of this map")
    differ = [f"[{name}]" for name in _OF_THE_MAP if getattr(own, name) != getattr(cell, name)]
    if not differ:
        return []
    what = f"{', '.join(differ)} of the cell file differ from what the map was fitted with and have no effect"
    return [f"{what}: 'truepose fit' or 'truepose update' takes them into a map"]


def check_maker(robot: Robot, program: Program, *, other_maker: bool = False) -> list[str]:
    """Refuse a program of another maker than the robot's; return the warnings where it is accepted.

    Raises
    ------
    RefusedError
        If the makers differ and `other_maker` is False.
    """
    language = LANGUAGES.get(language_of(program.sources[0].path))
    made_for = "" if language is None else language.maker
    if not made_for:
        return []
    where = f"{program.path}: a program for {made_for}"
    judged = f"its words of configuration are judged as those of {made_for} wherever the arm can have them"
    if not robot.maker:
        return [f'{where}, but {robot.name} names no maker: {judged}; state maker = "{made_for}" in the robot\'s file']
    if _plain(made_for) in _plain(robot.maker):
        return []
    if other_maker:
        return [f"{where}, corrected with the map of a robot of {robot.maker} ({robot.name}): {judged}"]
    raise RefusedError(
        f"{where}, but the map is of {robot.name}, a robot of {robot.maker}; take the map of the robot that runs it, "
        "or allow it (--other-maker, other_maker=True) if this robot does"
    )


def _plain(maker: str) -> str:
    """Return a maker's name in lower case, without accents, blanks and hyphens."""
    letters = unicodedata.normalize("NFKD", maker).lower()
    return "".join(letter for letter in letters if letter.isalnum())
