"""Programs with null frames are read in the controller's world, which is the base of the library's arm; old maps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.cell import Cell
from truepose.error_map import fit_cell, load_map
from truepose.errors import RefusedError
from truepose.geometry import apply_transform, euler, make_transform
from truepose.programs import FrameTable, read_program
from truepose.programs.agreement import check_cell, check_library
from truepose.robots import Robot, load_robot
from truepose.samples import Samples

TP = """/PROG A
/MN
1:L P[1] 100mm/sec FINE ;
/POS
P[1]{
 GP1:
 UF : 0, UT : 0, CONFIG : 'N U T, 0, 0, 0',
 X = 465.000 mm, Y = 0.000 mm, Z = 365.000 mm, W = 180.000 deg, P = -90.000 deg, R = 0.000 deg
};
/END
"""
JOB = """/JOB
//NAME A
//POS
///NPOS 1,0,0,0,0,0
///TOOL 0
///POSTYPE ROBOT
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00000=1045.000,0.000,960.000,180.0000,-90.0000,0.0000
//INST
///DATE 2026/01/01 00:00
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVL C00000 V=100.0
END
"""
OLD_HEIGHT = 330.0


def lowered(robot: Robot) -> Robot:
    """The arm of version 0.2, whose base was the mounting face."""
    return replace(robot, tf_base_first=np.eye(4), data_sheet=None)


@pytest.mark.parametrize(("name", "file", "text"), [("fanuc-lrmate200id", "a.ls", TP), ("yaskawa-gp25", "A.JBI", JOB)])
def test_the_zero_pose_in_a_program_with_null_frames_is_the_arms(
    tmp_path: Path, name: str, file: str, text: str
) -> None:
    path = tmp_path / file
    path.write_text(text)
    cell = Cell.from_toml(f'[robot]\nmodel = "{name}"\n')
    frames = replace(FrameTable.from_cell(cell), tools={0: np.eye(4)})
    (target,) = read_program(path, frames).targets
    assert target.verdict == "correct", target.reason
    assert target.p is not None
    np.testing.assert_allclose(target.p, load_robot(name).forward(np.zeros(6))[:3, 3], atol=1e-6)


def test_an_old_map_keeps_its_base_and_frames_and_says_so(tmp_path: Path, rng: np.random.Generator) -> None:
    old = lowered(load_robot("fanuc-lrmate200id"))
    described = {"robot": {"model": old.name}, "frames": {"bases": {"0": {"z_mm": OLD_HEIGHT}, "1": {"z_mm": 400.0}}}}
    cell = Cell.model_validate(described, context={"robot": old})
    q = np.deg2rad(rng.uniform(-30.0, 30.0, (30, 6)))
    tf_base_tracker = make_transform(euler("kuka", np.array([20.0, 5.0, -10.0])), [2000.0, 300.0, 500.0])
    p = old.forward(q)[:, :3, 3] + rng.normal(0.0, 0.05, (30, 3))
    samples = Samples(q=q, p_meas=apply_transform(np.linalg.inv(tf_base_tracker), p))
    fit_cell(cell, samples, "idw").save(tmp_path / "old.map")

    error_map = load_map(tmp_path / "old.map")
    np.testing.assert_allclose(error_map.robot.forward(q), old.forward(q), atol=1e-9)
    frames = FrameTable.from_cell(error_map.cell)
    assert [frames.bases[key][2, 3] for key in (0, 1)] == [OLD_HEIGHT, 400.0]
    (warning,) = check_library(error_map.cell, error_map.robot)
    assert "its flange is at (465.0, 0.0, 365.0) mm, turned by 0.0°, not at (465.0, 0.0, 695.0) mm" in warning
    assert "fit the map again" in warning
    with pytest.raises(RefusedError, match="is not the one with which the map was fitted: with all joints at 0°"):
        check_cell(error_map.cell, error_map.robot, Cell.from_toml(f'[robot]\nmodel = "{old.name}"\n'))


def test_a_turned_flange_and_a_changed_sign_are_noticed_and_nothing_else() -> None:
    robot = load_robot("fanuc-m20ia")
    cell = Cell.from_toml('[robot]\nmodel = "fanuc-m20ia"\n')
    assert check_library(cell, robot) == []
    half = make_transform(Rotation.from_euler("z", 180, degrees=True))
    (turned,) = check_library(cell, replace(robot, tf_last_flange=half))
    assert "turned by 180.0°" in turned
    (signed,) = check_library(cell, replace(robot, sign=robot.sign * [-1, 1, 1, 1, 1, 1]))
    assert "with all joints at 10°" in signed
    assert check_library(cell, replace(robot, name="another", tf_last_flange=half)) == []
