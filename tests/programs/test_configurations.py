"""The word of configuration after a correction is the one in the program, or the target is refused."""

# ruff: noqa: E501
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.geometry import euler
from truepose.programs import FrameTable, correct_program
from truepose.robots import (
    abb_configuration,
    fanuc_configuration,
    find_branches,
    load_robot,
    nearest_branch,
    status_turn,
)

N = 5000
ROBOTS = {"kuka": "kuka-kr210-r2700-extra", "abb": "abb-irb6640-185-280", "fanuc": "fanuc-m20ia"}


def words(controller: str, robot: Any, q: np.ndarray) -> list[str]:
    if controller == "kuka":
        return [f"S {s},T {t}" for s, t in zip(*status_turn(robot, q), strict=True)]
    if controller == "abb":
        return ["[" + ",".join(map(str, row)) + "]" for row in abb_configuration(robot, q)]
    return [str(word) for word in fanuc_configuration(robot, q)]


def program(controller: str, poses: np.ndarray, q: np.ndarray, robot: Any) -> tuple[str, str]:
    """Return the ending and the text of a program that goes to all poses."""
    numbers = np.column_stack([poses[:, :3, 3], euler(controller, Rotation.from_matrix(poses[:, :3, :3]))])
    named = zip(numbers, words(controller, robot, q), strict=True)
    if controller == "kuka":
        lines = [
            "PTP {" + ",".join(f"{k} {v:.4f}" for k, v in zip("XYZABC", row, strict=True)) + f",{word}}}"
            for row, word in named
        ]
        return ".src", "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n" + "\n".join(lines) + "\nEND\n"
    if controller == "abb":
        ext = "[9E9,9E9,9E9,9E9,9E9,9E9]"
        lines = [
            f"MoveJ [[{','.join(f'{v:.4f}' for v in row[:3])}],[{','.join(f'{v:.9f}' for v in row[3:])}],{word},{ext}],v1,fine,tool0;"
            for row, word in named
        ]
        return ".mod", "MODULE m\nPROC main()\n" + "\n".join(lines) + "\nENDPROC\nENDMODULE\n"
    moves = "".join(f"{i}:J P[{i}] 100% FINE ;\n" for i in range(1, len(q) + 1))
    points = "".join(
        f"P[{i}]{{\n GP1:\n UF : 0, UT : 0, CONFIG : '{word}',\n"
        + ", ".join(f"{k} = {v:.4f} {'mm' if k in 'XYZ' else 'deg'}" for k, v in zip("XYZWPR", row, strict=True))
        + "\n};\n"
        for i, (row, word) in enumerate(named, 1)
    )
    return ".ls", f"/PROG A\n/MN\n{moves}/POS\n{points}/END\n"


def test_a_target_that_the_map_leaves_keeps_its_reason(tmp_path: Path, make_map: Any) -> None:
    """Nobody asks about the configuration of a target that stays where it is, even on the border of its own."""
    robot = load_robot(ROBOTS["kuka"])
    q = np.deg2rad([[10.0, -80.0, 95.0, 0.0, 40.0, 20.0], [5.0, -75.0, 95.0, 30.0, 40.0, 20.0]])
    ending, text = program("kuka", robot.forward(q), q, robot)
    path = tmp_path / f"a{ending}"
    path.write_text(text)
    for guarded, reason in (({}, "configuration"), ({0: "too far from the samples"}, "too far from the samples")):
        error_map = make_map((0.0, 0.5, 0.0), guarded=guarded)
        error_map.robot = robot
        first = correct_program(path, error_map, frames=FrameTable(), on_guard="skip").to_dict()["targets"][0]
        assert (first["verdict"], reason in first["reason"]) == ("skip", True)


@pytest.mark.exhaustive
@pytest.mark.parametrize("controller", ROBOTS)
def test_the_word_stays_or_the_target_is_refused(
    tmp_path: Path, make_map: Any, rng: np.random.Generator, controller: str
) -> None:
    robot = load_robot(ROBOTS[controller])
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], size=(N, 6))
    q[::10, rng.integers(3, 6)] = rng.normal(scale=1e-3, size=len(q[::10]))  # near the borders of the words
    poses = robot.forward(q)
    ending, text = program(controller, poses, q, robot)
    path = tmp_path / f"a{ending}"
    path.write_text(text)
    error_map = make_map(rng.normal(scale=2.0, size=(N, 3)))
    error_map.robot = robot
    corrected = correct_program(path, error_map, frames=FrameTable(), on_guard="skip")
    done = np.array([target.verdict == "correct" for target in corrected.targets])
    moved = poses.copy()
    moved[:, :3, 3] = [target.p_after for target in corrected.targets]
    after = nearest_branch(find_branches(robot, moved[done]).q, q[done])
    before = np.array(words(controller, robot, q))
    np.testing.assert_array_equal(np.array(words(controller, robot, after)), before[done])
    assert 0.8 * N < done.sum() < N
    reasons = {target.reason for target in corrected.targets if target.verdict == "skip"}
    assert all("its configuration" in reason for reason in reasons)
