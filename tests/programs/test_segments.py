"""The arm between targets: a corrected path that it cannot follow as it follows the programmed one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.errors import RefusedError
from truepose.programs import correct_program
from truepose.programs.core.segments import _Ends, _follow
from truepose.robots import Robot, load_robot, nearest_branch, status_turn

ROBOT = load_robot("kuka-kr150-2")
NOTHING_HELD = np.zeros(2, bool)
HEAD = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"


class Shift:
    """A map of an arm whose corrections are all the same [mm]."""

    def __init__(self, correction: list[float], robot: Robot = ROBOT) -> None:
        self.robot, self.c = robot, np.array(correction)

    def correct(self, poses: Any, **_: Any) -> Any:
        p, n = poses[:, :3, 3], len(poses)
        std = np.full((n, 3), 0.05)
        verdict, reason = np.full(n, "correct"), [""] * n
        e = np.tile(-self.c, (n, 1))
        return SimpleNamespace(p_target=p, p_command=p + self.c, e=e, std=std, verdict=verdict, reason=reason)


def point(q: np.ndarray, named: bool = True) -> str:
    """Return the point of joints [rad] as KRL writes it, with S and T if named."""
    pose = ROBOT.forward(q)
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    x, y, z = pose[:3, 3]
    status, turn = (int(v) for v in status_turn(ROBOT, q))
    word = f",S {status},T {turn}" if named else ""
    return f"{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.5f},B {b:.5f},C {c:.5f}{word}}}"


def through(tmp_path: Path, middle: np.ndarray, along: np.ndarray) -> Path:
    """Write a straight motion of 400 mm through the flange pose of joints, in its middle."""
    pose = ROBOT.forward(middle)
    ends = []
    for half in (-200.0, 200.0):
        end = pose.copy()
        end[:3, 3] += half * along
        ends.append(nearest_branch(ROBOT.inverse(end), middle))
    path = tmp_path / "a.src"
    path.write_text(f"DEF a()\n{HEAD}PTP {point(ends[0])}\nLIN {point(ends[1], named=False)}\nEND\n")
    return path


SINGULAR = np.deg2rad([10.0, -80.0, 100.0, 15.0, 0.4, 0.0])
SOUND = np.deg2rad([10.0, -80.0, 100.0, 15.0, 35.0, 0.0])


def across(q: np.ndarray) -> np.ndarray:
    """Return a direction along which the wrist stays near its singularity only at q: that of the flange's x axis."""
    return np.asarray(ROBOT.forward(q)[:3, 0])


@pytest.mark.promise("A corrected path that turns a joint away near a singularity between its targets is refused.")
def test_a_singularity_between_two_targets(tmp_path: Path) -> None:
    path = through(tmp_path, SINGULAR, across(SINGULAR))
    sideways = (3.0 * ROBOT.forward(SINGULAR)[:3, 1]).tolist()
    message = r"a\.src:4: PTP:4: between PTP:4 \(line 4\) and LIN:5 \(line 5\) the corrected path turns joint [46] by"
    with pytest.raises(RefusedError, match=message):
        correct_program(path, Shift(sideways), on_guard="refuse")
    left = correct_program(path, Shift(sideways), on_guard="skip")
    assert left.coverage.corrected == 0
    assert all("near a singularity" in target.reason for target in left.targets)


def test_a_sound_path_is_corrected(tmp_path: Path) -> None:
    path = through(tmp_path, SOUND, across(SOUND))
    done = correct_program(path, Shift([2.0, -2.0, 1.0]), on_guard="refuse")
    assert done.coverage.corrected == 2


def test_nothing_is_judged_where_the_branch_is_not_known(tmp_path: Path) -> None:
    path = through(tmp_path, SINGULAR, across(SINGULAR))
    text = path.read_text()
    path.write_text(re.sub(r",S \d+,T \d+", "", text).replace("PTP {", "LIN {"))
    assert correct_program(path, Shift([0.0, 3.0, 0.0]), on_guard="refuse").coverage.corrected == 2


@pytest.mark.parametrize("step", [2.0, -2.0])
def test_reach_and_limits_between_targets(step: float) -> None:
    """A chord of the sphere of reach: its middle is nearest to the axis, its ends are farthest."""
    q = np.deg2rad([0.0, -10.0, 12.0, 0.0, 30.0, 0.0])
    pose = ROBOT.forward(q)
    out = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    ends = np.stack([pose, pose])
    ends[0, :3, 3] -= 150.0 * np.array([0.0, 1.0, 0.0])
    ends[1, :3, 3] += 150.0 * np.array([0.0, 1.0, 0.0])
    start = nearest_branch(ROBOT.inverse(ends), q)
    flange = np.broadcast_to(np.eye(4), (2, 4, 4))
    found = {}
    for size in (step, 400.0):
        given = _Ends(ends, np.stack([size * out] * 2), flange, NOTHING_HELD, start)
        found[size] = _follow(ROBOT, given, np.array([[0, 1]]))[0]
    assert not found[step]
    assert found[400.0] == "the corrected path is out of reach"


def test_a_limit_of_a_joint_between_targets() -> None:
    narrow = np.array(ROBOT.limits)
    q = SOUND.copy()
    narrow[0, 1] = q[0] + 1e-4
    robot = replace(ROBOT, limits=narrow)
    pose = robot.forward(q)
    ends = np.stack([pose, pose])
    ends[0, :3, 3] -= 60.0 * pose[:3, 3] / np.linalg.norm(pose[:3, 3]) * [1, 1, 0]
    ends[1, :3, 3] += 60.0 * pose[:3, 3] / np.linalg.norm(pose[:3, 3]) * [1, 1, 0]
    tangent = np.cross([0.0, 0.0, -1.0], pose[:3, 3] / np.linalg.norm(pose[:3, 3]))
    start = nearest_branch(robot.inverse(ends), q)
    given = _Ends(ends, np.stack([tangent] * 2), np.broadcast_to(np.eye(4), (2, 4, 4)), NOTHING_HELD, start)
    assert _follow(robot, given, np.array([[0, 1]])) == ["the corrected path leaves the limits of a joint"]


def test_orientation_turns_along_the_segment() -> None:
    """A segment that only turns half about the tool's axis is followed without a jump."""
    pose = ROBOT.forward(SOUND)
    other = pose.copy()
    other[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec([0, 0, 1.5]).as_matrix()
    other[:3, 3] += [100.0, 0.0, 0.0]
    ends = np.stack([pose, other])
    start = nearest_branch(ROBOT.inverse(ends), SOUND)
    given = _Ends(ends, np.full((2, 3), 0.5), np.broadcast_to(np.eye(4), (2, 4, 4)), NOTHING_HELD, start)
    assert _follow(ROBOT, given, np.array([[0, 1]])) == [""]
