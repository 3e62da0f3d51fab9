"""Checks that a map belongs to the robot of a program and of a cell file."""

from __future__ import annotations

import json
import re
import unicodedata
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.cell import Cell
from truepose.errors import DataError, RefusedError
from truepose.programs.backups.backup import Backup, Controller
from truepose.programs.backups.reading import chosen
from truepose.programs.core.program import Program
from truepose.programs.languages import LANGUAGES, language_of
from truepose.robots import Robot, list_robots, load_robot, to_toml

_OF_THE_MAP: Final = ("tool", "reflectors", "base", "tracker", "payload")
"""Tables of a cell file that a map was fitted with, and that a correction does not read again."""
_SOME_ANGLE: Final = float(np.deg2rad(10.0))  # signs of joints have no effect at zero
_SAME_MM: Final = 1e-3
_SAME_RAD: Final = 1e-6


def check_cell(own: Cell, robot: Robot, cell: Cell, *, placed: bool = False) -> list[str]:
    """Refuse a cell file of another robot; return warnings about its tables that differ from the map's.

    Such tables have no effect on a correction. `placed` says that the fit placed the model in the controller's base.

    Raises
    ------
    RefusedError
        If the robots differ, or the robot of the same name reaches other poses than when the map was fitted.
    """
    other = _placed(cell.load_robot(), robot) if placed else cell.load_robot()
    if other.name != robot.name and to_toml(other) != to_toml(robot):
        raise RefusedError(f"the cell file is of {other.name}, the map of {robot.name}; take the cell file of this map")
    if other.name == robot.name and (change := _change(robot, other)):
        raise RefusedError(f"the cell file's {other.name} is not the one with which the map was fitted: {change}")
    differ = [f"[{name}]" for name in _OF_THE_MAP if _of_the_map(own, name) != _of_the_map(cell, name)]
    if not differ:
        return []
    what = f"{', '.join(differ)} of the cell file differ from what the map was fitted with and have no effect"
    return [f"{what}: 'truepose fit' or 'truepose update' takes them into a map"]


def _of_the_map(cell: Cell, name: str) -> object:
    """Return a table without the mass on the flange, which is that at work by default."""
    table = getattr(cell, name)
    return table.model_copy(update={"mass_kg": 0.0}) if name == "payload" else table


def check_identity(
    own: Cell, cell: Cell, reason: str = "", *, stated: str | None = None, this_robot: bool = False
) -> list[str]:
    """Refuse the cell file of another robot of the same type; return the warning where a reason is given.

    Robots of one type have errors of their own: the map of one makes the programs of another worse.

    Parameters
    ----------
    own, cell : Cell
        The cell of the map, and the cell file.
    reason : str
        Why the map of another robot is used.
    stated : str, optional
        The id of the robot of the map by what its user has stated since.
    this_robot : bool
        Whether the user states now that it is that of the cell file.

    Raises
    ------
    RefusedError
        If both cells name their robot, the names differ, and there is no reason.
    DataError
        If it is to be that of the cell file, which names none.
    """
    mine, theirs = own.robot_id or stated, cell.robot_id
    if this_robot and theirs is None:
        raise DataError(f"--this-robot: the cell file names no robot; write {_id(mine)} under [robot] in it")
    if mine is None and this_robot:
        return []
    if mine is None or theirs is None:
        if mine == theirs:
            return []
        where = "the map was fitted without one" if mine is None else "the cell file states none"
        remedy = (
            "state it once with --this-robot (Python: this_robot=True)"
            if mine is None
            else f"write {_id(mine)} under [robot] in the cell file"
        )
        what = f"it is not known whether this is the robot of the map: [robot] id is {mine or theirs!r}, but {where}"
        return [f"{what}; if it is, {remedy}"]
    if same_robot(mine, theirs):
        return []
    what = f"the map is of the robot {mine!r}, the cell file of {theirs!r}"
    if reason:
        return [f"{what}; accepted, with the reason: {reason}"]
    raise RefusedError(
        f"{what}: each robot has errors of its own, so the map of one makes programs of another worse; take the map of "
        "this robot, or accept it with --other-robot REASON (Python: other_robot=REASON)"
    )


def _id(robot_id: str | None) -> str:
    return f"id = {json.dumps(robot_id or 'SERIAL NUMBER', ensure_ascii=False)}"


def same_robot(mine: str | None, theirs: str | None) -> bool:
    """Return whether two ids name the same robot; letters in another case do not count.

    Examples
    --------
    >>> same_robot("A-17", " a-17"), same_robot("A-17", None)
    (True, False)
    """
    return mine is not None and theirs is not None and mine.strip().casefold() == theirs.strip().casefold()


def check_library(own: Cell, robot: Robot, *, placed: bool = False) -> list[str]:
    """Return the warning of a map whose library arm is described otherwise today; `placed` as of `check_cell`."""
    if robot.name != own.robot.model or robot.name not in list_robots():
        return []
    other = load_robot(robot.name)
    if not (change := _change(robot, _placed(other, robot) if placed else other)):
        return []
    return [
        f"the map was fitted with an earlier description of {robot.name}, whose base it reads programs in: {change}"
    ]


def _placed(robot: Robot, like: Robot) -> Robot:
    """Return a robot in the base of another one."""
    return replace(robot, tf_base_first=like.tf_base_first)


def _change(robot: Robot, other: Robot) -> str:
    """Return how the flange poses of two descriptions of an arm differ, with the remedy; empty if they do not."""
    if other.dof != robot.dof:
        return f"it has {other.dof} joints, not {robot.dof}; fit the map again"
    for q in np.zeros(robot.dof), np.full(robot.dof, _SOME_ANGLE):
        before, after = robot.forward(q), other.forward(q)
        apart = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
        turned = float(Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).magnitude())
        if apart > _SAME_MM or turned > _SAME_RAD:
            was, now = (", ".join(f"{x:.1f}" for x in tf[:3, 3] + 0.0) for tf in (before, after))
            return (
                f"with all joints at {np.rad2deg(q[0]):g}° its flange is at ({now}) mm, turned by "
                f"{np.rad2deg(turned):.1f}°, not at ({was}) mm; fit the map again"
            )
    return ""


def check_maker(robot: Robot, program: Program, *, other_maker: bool = False) -> list[str]:
    """Refuse a program of another maker than the robot's; return the warnings where it is accepted.

    Raises
    ------
    RefusedError
        If the makers differ and `other_maker` is False.
    """
    if not (made_for := _made_for(program)):
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


def foreign_maker(robot: Robot, program: Program) -> str:
    """Return the maker of the robots that a program is for, where the robot is of another one; else nothing."""
    made_for = _made_for(program)
    return made_for if robot.maker and _plain(made_for) not in _plain(robot.maker) else ""


def _made_for(program: Program) -> str:
    language = LANGUAGES.get(language_of(program.sources[0].path))
    return "" if language is None else language.maker


def controllers_for(
    backup: Backup, robot: Robot | None, names: Sequence[str] = (), reason: str = "", *, other_maker: bool = False
) -> list[Controller]:
    """Return the controllers of a backup that a map corrects: those of some names, or the only one of its maker.

    `reason`: why the map of another robot is used.

    Raises
    ------
    RefusedError
        If there is none, or several and no names, or it names another model than that of the map's robot and there is
        no reason.
    DataError
        If there is no controller of a name.
    """
    known = robot is not None and robot.maker and not other_maker
    fitting = [one for one in backup.controllers if not known or _same_maker(robot, one)]
    shown = "; ".join(f"{one.name} ({one})" for one in backup.controllers)
    wanted = chosen(backup, names) if names else fitting
    if not wanted:
        makers = " and ".join(backup.makers)
        raise RefusedError(f"{backup.path}: is a backup of {makers}, but the map is of {_robot(robot)}; take its map")
    if len(wanted) > 1 and not names:
        raise RefusedError(f"{backup.path}: holds {len(wanted)} controllers, name one (--controller NAME): {shown}")
    if others := [one for one in backup.controllers if one not in wanted]:
        left = ", ".join(f"{one.name} ({one.maker})" for one in others)
        warnings.warn(f"{backup.path}: left as they are: {left}", UserWarning, stacklevel=2)
    for one in wanted:
        _check_model(backup, one, robot, reason)
    return wanted


def _check_model(backup: Backup, controller: Controller, robot: Robot | None, reason: str) -> None:
    """Refuse a controller whose robot is another model than the map's; warn where its name may mean the same one."""
    if robot is None or not controller.contents.robot or _fits(controller, robot) or not _numbers(robot.name):
        return
    what = f"{controller.root}: the backup names the robot {controller.contents.robot}, the map is of {robot.name}"
    if better := [one for one in backup.controllers if one.contents.robot and _fits(one, robot)]:
        raise RefusedError(f"{what}, which is that of {better[0].name}; name that one, or take the map of this robot")
    if reason:
        warnings.warn(f"{what}; accepted, with the reason: {reason}", UserWarning, stacklevel=3)
    elif _is_other(controller.contents.robot, robot.name):
        raise RefusedError(f"{what}; take the map of this robot, or accept it with --other-robot REASON")
    else:
        warnings.warn(f"{what}: make sure that they are the same", UserWarning, stacklevel=3)


def check_serial(controller: Controller, cells: Sequence[Cell], reason: str = "") -> None:
    """Refuse the backup of another robot than that of a map, by the serial number in the backup; warn if unsure.

    Parameters
    ----------
    controller : Controller
        The controller of a backup.
    cells : sequence of Cell
        The cell of the map, and the cell file if there is one.
    reason : str
        Why the map of another robot is used.

    Raises
    ------
    RefusedError
        If a cell states another serial number, and there is no reason.
    """
    serial = controller.contents.serial
    known = [one for cell in cells for one in (cell.robot.id, cell.report.robot_serial) if one]
    if not serial or not known or any(same_robot(one.lstrip("0"), serial) for one in known):
        return
    what = f"{controller.root}: the backup is of the robot with the serial number {serial}"
    if reason:
        warnings.warn(f"{what}; accepted, with the reason: {reason}", UserWarning, stacklevel=2)
        return
    stated = [cell.report.robot_serial for cell in cells if cell.report.robot_serial]
    if stated:
        remedy = "take the map of this robot, or accept it with --other-robot REASON"
        raise RefusedError(f"{what}, the map and its cell are of {stated[0]}; {remedy}")
    remedy = f"write robot_serial = {json.dumps(serial)} under [report] in the cell file (--cell) if it is the same"
    warnings.warn(f"{what}, the map is of {known[0]!r}: {remedy}", UserWarning, stacklevel=2)


def _fits(controller: Controller, robot: Robot) -> bool:
    """Return whether the numbers in the name of the map's robot are in that of the controller's."""
    return _numbers(robot.name) <= _numbers(controller.contents.robot)


def _numbers(name: str) -> set[str]:
    return set(_in_order(name))


def _in_order(name: str) -> list[str]:
    """Return the numbers of a name; a reach of 1.45 m is 145 in other names, and a UR10e is no UR10."""
    return re.findall(r"0*(\d+(?:e(?![a-z]))?)", name.replace(".", "").lower())


def _is_other(named: str, own: str) -> bool:
    """Return whether two names of one family (IRB, KR, GP) surely are of two models: by payload, type or reach.

    Examples
    --------
    >>> _is_other("#KR125_2 ZH", "kuka-kr210-r2700-extra"), _is_other("KR 6 R700", "kuka-kr6-r900-sixx")
    (True, True)
    >>> _is_other("#KR16R1610 C4", "kuka-kr16-2"), _is_other("1-06VX12-A00", "yaskawa-gp12")
    (False, False)
    >>> _is_other("IRB", "abb-irb4600-60-205")
    False
    >>> _is_other("UR10", "universal-robots-ur10e"), _is_other("UR10e", "universal-robots-ur10e")
    (True, False)
    """
    family, other = (set(re.findall(r"[a-z]{2,}", name.lower())) for name in (named, own))
    if not family & other:
        return False
    numbers = _in_order(named), _in_order(own)
    if not all(numbers):  # the family alone
        return False
    if numbers[0][:1] != numbers[1][:1]:
        return True
    large = [{number for number in of[1:] if len(number) > 2} for of in numbers]
    return bool(large[0] and large[1]) and not large[0] & large[1]


def _robot(robot: Robot | None) -> str:
    return "no robot" if robot is None else f"{robot.name}, a robot of {robot.maker}"


def _same_maker(robot: Robot | None, controller: Controller) -> bool:
    return robot is not None and _plain(controller.maker) in _plain(robot.maker)


def _plain(maker: str) -> str:
    """Return a maker's name in lower case, without accents, blanks and hyphens."""
    letters = unicodedata.normalize("NFKD", maker).lower()
    return "".join(letter for letter in letters if letter.isalnum())
