"""Compare words of configuration before and after a correction.

The word in the program (KUKA's S and T, ABB's confdata, FANUC's CONFIG) stays as it is, so the joints at the corrected
pose must still have it. Joints are those of the nominal robot. A word that does not fit the pose even before the
correction is not judged.

Along straight, circular and spline motions every joint moves on from where it is: KUKA's Turn and FANUC's turn numbers
have no effect there, so only Status and letters are compared. ABB monitors the whole confdata there, too (ConfL).
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray, FloatArray
from truepose.errors import RobotError
from truepose.geometry import invert_transform
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.target import Target
from truepose.robots import (
    Robot,
    abb_configuration,
    fanuc_configuration,
    find_branches,
    nearest_branch,
    select,
    status_turn,
)
from truepose.robots.configuration import BRANCH, select_abb, select_fanuc

StrArray = NDArray[np.str_]
_ABB: Final = re.compile(r"\s*(-?[0-9]{1,3})\s*,\s*(-?[0-9]{1,3})\s*,\s*(-?[0-9]{1,3})\s*,\s*([0-7])\s*")
_TURN: Final = r"\s*,\s*(-?[0-9])"
_FANUC: Final = re.compile(rf"\s*([NF])\s*[LR]?\s*([UD])\s*([TB]){3 * _TURN}\s*", re.I)
_TURNS: Final = 0b111111
_CHUNK: Final = 50_000
_HAIR: Final = 0.02  # [mm]


def changed_words(
    robot: Robot, columns: TargetColumns, poses: FloatArray, commands: FloatArray, tools: FloatArray
) -> dict[int, str]:
    """Return the reasons why targets would change their words of configuration, by index.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    columns : TargetColumns
        The n targets.
    poses, commands : (n, 4, 4) arrays [mm]
        The poses, base to tool, as programmed and as corrected.
    tools : (n, 4, 4) array [mm]
        The transforms from flange to tool.
    """
    controller = columns.controller
    words = words_of(columns)
    named = np.flatnonzero([bool(word) for word in words])
    reasons: dict[int, str] = {}
    for start in range(0, len(named), _CHUNK):
        rows = named[start : start + _CHUNK]
        wanted = np.array([words[i] for i in rows])
        tf_tool_flange = invert_transform(tools[rows])
        try:
            q = _joints_of(controller, robot, poses[rows] @ tf_tool_flange, wanted)
            known = np.flatnonzero(np.isfinite(q).all(axis=1))
            known = known[_words(controller, robot, q[known], wanted[known]) == wanted[known]]
            others = np.setdiff1d(np.arange(len(rows)), known)
            border = _on_border(controller, robot, poses[rows[others]], tf_tool_flange[others], wanted[others])
            for i in others[border]:
                reasons[int(rows[i])] = f"it lies on the border of its configuration {wanted[i]}"
            if not len(known):
                continue
            q_after = nearest_branch(find_branches(robot, (commands[rows] @ tf_tool_flange)[known]).q, q[known])
        except RobotError:
            return reasons  # an arm of another kind: its programs name no such words
        lost = ~np.isfinite(q_after).all(axis=1)
        got = np.full(len(known), "out of reach", dtype="<U40")
        got[~lost] = _words(controller, robot, q_after[~lost], wanted[known[~lost]])
        for k in np.flatnonzero(got != wanted[known]):
            reasons[int(rows[known[k]])] = f"its configuration would change from {wanted[known[k]]} to {got[k]}"
    return reasons


def joints_of_words(robot: Robot, columns: TargetColumns, flange: FloatArray) -> FloatArray:
    """Return the joints that the words of n targets name at flange poses, (n, 6) [rad]; NaN without a word.

    Raises
    ------
    RobotError
        If the arm is of another kind than those whose controllers have such words.
    """
    words = words_of(columns)
    named = np.flatnonzero([bool(word) for word in words])
    q = np.full((len(columns), robot.dof), np.nan)
    if len(named):
        q[named] = _joints_of(columns.controller, robot, flange[named], np.array([words[i] for i in named]))
    return q


def words_of(columns: TargetColumns) -> list[str]:
    """Return the words of targets in one form; empty where a target names none, or no valid one.

    Where only paths lead to a target, the word has no turns; see the head of this module.
    """
    if columns.controller == "kuka":
        numbers = zip(columns.status.tolist(), columns.turn.tolist(), columns.on_paths.tolist(), strict=True)
        return [_kuka_word(*row) for row in numbers]
    kinds, which = columns.shared()
    words = [_word(columns.controller, target) for target in kinds]
    return [words[k] for k in which.tolist()]


def _kuka_word(status: int, turn: int, on_paths: bool) -> str:
    if status < 0 or (turn < 0 and not on_paths):
        return ""
    return f"S {status & BRANCH}" + ("" if on_paths else f", T {turn & _TURNS}")


def _word(controller: str, target: Target) -> str:
    if controller == "abb" and (m := _ABB.fullmatch(target.configuration)):
        return ",".join(str(int(number)) for number in m.groups())
    if controller == "fanuc" and (m := _FANUC.fullmatch(target.configuration)):
        flip, elbow, front, *turns = m.groups()
        turns = [] if target.on_paths else turns
        return ", ".join([f"{flip} {elbow} {front}".upper(), *(str(int(turn)) for turn in turns)])
    return ""


def _joints_of(controller: str, robot: Robot, flange: FloatArray, words: StrArray) -> FloatArray:
    """Return the joints that poses and words name, (n, 6) [rad]; NaN where there are none."""
    solutions = find_branches(robot, flange).q
    if controller == "fanuc":
        return select_fanuc(robot, solutions, [word if "," in word else f"{word}, 0, 0, 0" for word in words])
    numbers = [[int(n) for n in re.findall(r"-?[0-9]+", word)] for word in words]
    if controller == "abb":
        return select_abb(robot, solutions, np.array(numbers).reshape(-1, 4))
    status, turn = np.array([(*row, 0)[:2] for row in numbers]).reshape(-1, 2).T
    return select(robot, solutions, status, turn)


def _on_border(
    controller: str, robot: Robot, poses: FloatArray, tf_tool_flange: FloatArray, words: StrArray
) -> BoolArray:
    """Return which poses that have not their word have it a hair's breadth away: their digits are rounded."""
    border = np.zeros(len(poses), dtype=bool)
    for step in _HAIR * np.concatenate([np.eye(3), -np.eye(3)]) if len(poses) else ():
        near = poses.copy()
        near[:, :3, 3] += step
        q = _joints_of(controller, robot, near @ tf_tool_flange, words)
        known = np.isfinite(q).all(axis=1)
        border[known] |= _words(controller, robot, q[known], words[known]) == words[known]
    return border


def _words(controller: str, robot: Robot, q: FloatArray, like: StrArray) -> StrArray:
    """Return the words of joints, (n,) of str; without turns where those in `like` have none."""
    if not len(q):
        return np.array([], dtype=str)
    if controller == "kuka":
        words = np.array([f"S {s}, T {t}" for s, t in zip(*status_turn(robot, q), strict=True)])
    elif controller == "abb":
        words = np.array([",".join(map(str, row)) for row in abb_configuration(robot, q)])
    else:
        words = fanuc_configuration(robot, q)
    return np.where(np.char.count(like, ",") > 0, words, np.char.partition(words, ",")[:, 0])
