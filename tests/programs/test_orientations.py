"""Orientations: digits change only when asked for, in each language's own numbers, next to the old ones."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.programs.test_virtual_cell import LANGUAGES, N

from truepose.errors import DataError
from truepose.geometry import euler, invert_transform, make_transform
from truepose.programs import FrameTable, ReadOptions, correct_program, read_program
from truepose.programs.core.orientations import AXES, STEPS, rotation, turned

ANGLE = st.floats(-179.0, 179.0)
EULER = ["kuka", "fanuc", "yaskawa", "staubli"]
SMALL = st.tuples(*[st.floats(-5e-3, 5e-3)] * 3).map(np.array)


@pytest.mark.parametrize("controller", EULER)
@given(angles=st.tuples(ANGLE, st.floats(-89.0, 89.0), ANGLE).map(np.array), turn=SMALL, turns=st.integers(-1, 1))
def test_angles_mean_the_turned_orientation_and_stay_near(
    controller: str, angles: np.ndarray, turn: np.ndarray, turns: int
) -> None:
    before = angles + np.array([360.0 * turns, 0.0, 0.0])
    after = turned(controller, before[None], Rotation.from_rotvec(turn[None]))[0]
    wanted = Rotation.from_rotvec(turn) * euler(controller, before)
    assert (euler(controller, after) * wanted.inv()).magnitude() < 1e-9
    assert abs(after - before).max() <= np.rad2deg(np.linalg.norm(turn)) / np.cos(np.deg2rad(angles[1])) * 1.1 + 1e-6


@pytest.mark.parametrize("controller", EULER)
@pytest.mark.parametrize("middle", [90.0, -90.0])
def test_gimbal_lock(controller: str, middle: float) -> None:
    before = np.array([[25.0, middle, 40.0]] * 2)
    axis = euler(controller, before[0]).apply(np.eye(3))  # turns that keep the lock, and some that leave it
    for vector in (*(1e-3 * axis), *(1e-3 * np.eye(3)), np.zeros(3), np.array([1e-3, -2e-3, 5e-4])):
        turn = Rotation.from_rotvec([vector] * 2)
        after = turned(controller, before, turn)
        wanted = turn * euler(controller, before)
        assert (euler(controller, after) * wanted.inv()).magnitude().max() < 1e-7
    np.testing.assert_array_equal(turned(controller, before, Rotation.identity(2)), before)


def test_in_gimbal_lock_one_angle_carries_the_turn() -> None:
    for middle in (90.0, -90.0):
        kept = turned("kuka", np.array([[25.0, middle, 40.0]] * 2), Rotation.from_euler("z", [[0.1]] * 2, degrees=True))
        np.testing.assert_allclose(kept, [[25.1, middle, 40.0]] * 2, atol=1e-6)


@pytest.mark.parametrize("length", [3.1, np.pi - 1e-4, np.pi, np.pi + 1e-4, 3.2, 6.2, 1e-3, 0.0])
def test_rotation_vectors_keep_their_branch(length: float) -> None:
    axis = np.array([0.6, -0.48, 0.64])
    before = (length * axis)[None]
    for vector in 2e-3 * np.concatenate([np.eye(3), -np.eye(3), [axis]]):
        turn = Rotation.from_rotvec([vector])
        after = turned("ur", before, turn)
        wanted = turn * Rotation.from_rotvec(before)
        assert (Rotation.from_rotvec(after) * wanted.inv()).magnitude()[0] < 1e-9
        if length > 1.0 and length < 6.0:
            assert np.linalg.norm(after - before) < 0.02


@given(q=st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.3), turn=SMALL)
def test_quaternions_keep_their_sign_and_are_of_unit_length(q: np.ndarray, turn: np.ndarray) -> None:
    before = (q / np.linalg.norm(q))[None]
    after = turned("abb", before, Rotation.from_rotvec(turn[None]))
    assert np.linalg.norm(after - before) < 0.01
    assert abs(np.linalg.norm(after) - 1.0) < 1e-12
    wanted = Rotation.from_rotvec(turn) * euler("abb", before[0])
    assert (euler("abb", after[0]) * wanted.inv()).magnitude() < 1e-9


def test_a_tool_axis_turns_with_the_tool() -> None:
    before = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
    turn = Rotation.from_rotvec([[2e-3, 0, 0], [0, 1e-3, 1e-3]])
    for rule, sign in AXES.items():
        after = turned(rule, before, turn)
        z = (turn * rotation(rule, before)).as_matrix()[:, :, 2]
        np.testing.assert_allclose(sign * after, z, atol=1e-12)


class TurningMap:
    """Asks for one turn and one shift everywhere, base frame."""

    hash = "0" * 64

    def __init__(self, turn: Any, shift: Any = (0.0, 0.0, 0.0), make_map: Any = None) -> None:
        self.turn, self.inner = np.asarray(turn, float), make_map(shift)

    def correct(self, poses: np.ndarray, **more: Any) -> Any:
        answer = self.inner.correct(poses, **more)
        answer.rotation = np.tile(self.turn, (len(poses), 1)) if more["orientation"] else None
        return answer


FRAMES = {1: make_transform(euler("kuka", [20.0, 5.0, -3.0]), [50.0, -20.0, 10.0]), 2: np.eye(4)}
ANGLE_PATTERNS = {
    "krl": r"A NUM,B NUM,C NUM",
    "rapid": r"\],\[NUM,NUM,NUM,NUM\]",
    "fanuc": r"W =NUM deg, P =NUM deg, R =NUM deg",
    "inform": r"C\d+=[^,]*,[^,]*,[^,]*,NUM,NUM,NUM",
    "val3": r'rx="NUM" ry="NUM" rz="NUM"',
    "table": r"p,w\d,[^,]*,[^,]*,[^,]*,NUM,NUM,NUM",
    "gcode": r"A NUM B NUM C NUM".replace(" NUM", "NUM"),
    "urscript": r"p\[[^,]*,[^,]*,[^,]*,NUM,NUM,NUM",
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", sorted(LANGUAGES))
def test_orientation_digits_change_only_when_asked(name: str, tmp_path: Path, make_map: Any) -> None:
    language = LANGUAGES[name]
    rng = np.random.default_rng(3)
    poses = make_transform(Rotation.random(N, random_state=4), rng.uniform(-500, 500, (N, 3)))
    frames = [2] * N if name == "urscript" else [1 + i % 2 for i in range(N)]
    inside = np.array([invert_transform(FRAMES[f]) @ pose for f, pose in zip(frames, poses, strict=True)])
    angles = euler(language.controller, Rotation.from_matrix(inside[:, :3, :3]))
    text = language.write(list(np.column_stack([inside[:, :3, 3] / language.unit, angles])), frames)
    path = tmp_path / f"a{language.ending}"
    path.write_text(text)
    bases = {key: FRAMES[n] for n in (1, 2) for key in (n, f"w{n}", f"G{53 + n}")}
    table = FrameTable({1: np.eye(4), "tA": np.eye(4)}, bases, tool="map")
    turn = np.array([1e-3, -2e-3, 0.5e-3])
    pattern = re.compile(ANGLE_PATTERNS[name].replace("NUM", r"\s*(-?[\d.]+)"))
    before = [[float(v) for v in row] for row in pattern.findall(text)]
    assert len(before) == N
    options = language.options
    without = correct_program(path, TurningMap(turn, [0.1, 0, 0], make_map), frames=table, options=options)
    assert pattern.findall(without.files[path].decode()) == pattern.findall(text)
    asked = correct_program(path, TurningMap(turn, make_map=make_map), frames=table, options=options, orientation=True)
    after = np.array([[float(v) for v in row] for row in pattern.findall(asked.files[path].decode())])
    step = STEPS.get(language.controller, 1e-4) * (1.0 if language.controller in ("abb", "ur") else np.pi / 180)
    for k, f in enumerate(frames):
        wanted = (
            Rotation.from_rotvec(turn) * Rotation.from_matrix(FRAMES[f][:3, :3]) * euler(language.controller, before[k])
        )
        got = Rotation.from_matrix(FRAMES[f][:3, :3]) * euler(language.controller, after[k])
        assert (got * wanted.inv()).magnitude() < 2 * step
    outcome = asked.targets[0]
    assert {tuple(np.round(o.angles_after, 9)) for o in asked.targets} == {tuple(np.round(row, 9)) for row in after}
    assert len(asked.to_dict()["targets"][0]["angles_after"]) == len(outcome.angles_after)
    zero = correct_program(
        path, TurningMap([0, 0, 0], make_map=make_map), frames=table, options=options, orientation=True
    )
    assert zero.files[path] == path.read_bytes()


def test_a_written_quaternion_has_unit_length(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.mod"
    ext = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    path.write_text(
        f"MODULE m\nPROC main()\nMoveL [[1,2,3],[-0.707,0,.707,0],[0,0,0,0],{ext}],v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    )
    done = correct_program(path, TurningMap([1e-3, 2e-3, 3e-3], make_map=make_map), orientation=True)
    numbers = [float(v) for v in re.findall(r"\],\[([^]]*)\],\[0", done.files[path].decode())[0].split(",")]
    assert numbers[0] < 0
    assert abs(np.linalg.norm(numbers) - 1.0) < 2e-7


@pytest.mark.parametrize(
    ("name", "text", "kept"),
    [
        ("a.nc", "G21 G90 G54\nG1 X1 Y2 Z3 A10 B20 C30\nG1 X2 Y2 Z3\nG1 X3 Y2 Z3 A1 B2 C3\n", [0, 0, 1]),
        ("a.apt", "GOTO/1,2,3,0,0,1\nGOTO/2,2,3\nGOTO/3,2,3,0,0.6,0.8\n", [0, 0, 1]),
    ],
)
def test_an_orientation_that_holds_over_lines_is_left(
    tmp_path: Path, make_map: Any, name: str, text: str, kept: list[int]
) -> None:
    path = tmp_path / name
    path.write_text(text)
    options, frames = ReadOptions(angles="kuka" if name == "a.nc" else "z"), FrameTable(base=0)
    done = correct_program(
        path, TurningMap([1e-3, 0, 0], make_map=make_map), frames=frames, options=options, orientation=True
    )
    assert [o.verdict == "correct" for o in done.targets] == [bool(k) for k in kept]
    assert "holds over several lines" in done.targets[0].reason
    assert read_program(path, frames, options).counts()["correct"] == 3
    lines = zip(text.splitlines(), done.files[path].decode().splitlines(), strict=True)
    assert sum(a != b for a, b in lines) == 1


def test_a_map_without_orientation_says_so(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1,2,3,0,0,0\n")
    with pytest.raises(DataError, match="gives no orientations"):
        correct_program(path, make_map(), orientation=True)
