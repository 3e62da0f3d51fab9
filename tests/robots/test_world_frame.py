"""The base of a library arm is the frame in which its controller states positions when all frames are null."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from truepose.geometry import euler
from truepose.robots import list_robots, load_robot, load_urdf, parse_robot, to_mdh, to_toml, to_urdf
from truepose.robots.inverse.axes import Axes

AT_AXIS_2 = ("FANUC", "Yaskawa", "Stäubli")


@pytest.mark.parametrize("name", list_robots())
def test_the_base_is_at_axis_2_or_at_the_mounting_face(name: str) -> None:
    robot = load_robot(name)
    axes = Axes.of(robot)
    if robot.maker in AT_AXIS_2:
        np.testing.assert_allclose(axes.point[0][:2], 0.0, atol=1e-9)  # axis 1 goes through the origin
        np.testing.assert_allclose(axes.direction[1][2], 0.0, atol=1e-12)
        assert axes.point[1][2] == pytest.approx(0.0, abs=1e-9)  # axis 2 at its height
        assert robot.world_height_mm is not None
        assert 300.0 < robot.world_height_mm < 1000.0
        np.testing.assert_array_equal(robot.tf_base_first[:3, 3], [0.0, 0.0, -robot.world_height_mm])
        assert robot.d[0] == robot.world_height_mm  # from the mounting face to axis 2
    else:
        assert robot.world_height_mm is None
        np.testing.assert_array_equal(robot.tf_base_first, np.eye(4))
        assert axes.point[1][2] > 80.0


def test_fanuc_lr_mate_200id_at_zero_and_with_joint_2_at_20_deg() -> None:
    """The pendant's (465, 0, 365, 180, -90, 0) of the home pose, as mattj23/industrial-robots tests it.

    J3 of the pendant is relative to the ground: at J2 = 20°, J3 = 0 only the upper arm of 330 mm leans forward.
    """
    robot = load_robot("fanuc-lrmate200id")
    home = robot.forward(np.zeros(6))
    np.testing.assert_allclose(home[:3, 3], [465.0, 0.0, 365.0], atol=1e-9)
    np.testing.assert_allclose(home[:3, :3], euler("fanuc", np.array([180.0, -90.0, 0.0])).as_matrix(), atol=1e-12)
    lean = np.deg2rad(20.0)
    p = robot.forward([0.0, lean, lean, 0.0, 0.0, 0.0])[:3, 3]
    np.testing.assert_allclose(p, [50 + 330 * np.sin(lean) + 335 + 80, 0.0, 330 * np.cos(lean) + 35], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "p"),
    [  # forward reach of the stretched forearm, and upper arm plus elbow: the height above axis 2
        ("fanuc-m10ia", [150 + 640 + 100, 0, 600 + 200]),
        ("yaskawa-gp25", [150 + 795 + 100, 0, 760 + 200]),
        ("staubli-tx2-90", [50, 50, 425 + 425 + 100]),
    ],
)
def test_zero_pose_counts_from_axis_2(name: str, p: list[float]) -> None:
    np.testing.assert_allclose(load_robot(name).forward(np.zeros(6))[:3, 3], p, atol=1e-9)


@pytest.mark.parametrize("name", ["fanuc-m710ic-50", "yaskawa-gp180", "staubli-tx2-160l"])
def test_the_base_survives_text_urdf_and_conversion(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(*robot.limits.T, size=(20, 6))
    path = tmp_path / "arm.urdf"
    path.write_text(to_urdf(robot), "utf-8")
    again = parse_robot(to_toml(robot))
    assert again.world_height_mm == robot.world_height_mm
    for arm in (again, load_urdf(path), to_mdh(robot)):
        np.testing.assert_allclose(arm.forward(q), robot.forward(q), atol=1e-8)
    mounted = robot.frames(q)[:, 0]
    np.testing.assert_array_equal(mounted[:, 2, 3], -robot.world_height_mm)  # where a drawing begins
