"""Forward kinematics against matrices written out, and what is no chain or no joint vector."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.errors import DataError, RobotError
from truepose.robots import Robot, list_robots, load_robot


def elementary(kind: str, value: float) -> np.ndarray:
    """Rot or Trans along one axis by scipy: "rx", "tz", …"""
    tf = np.eye(4)
    if kind[0] == "r":
        tf[:3, :3] = Rotation.from_euler(kind[1], value).as_matrix()
    else:
        tf["xyz".index(kind[1]), 3] = value
    return tf


def product_of_links(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Theory (1) and (2), one pose, one factor after the other: the frames after each link."""
    frames = [robot.tf_base_first]
    for i in range(robot.dof):
        theta = robot.sign[i] * q[i] + robot.offset[i]
        factors = {
            "mdh": [
                ("rx", robot.alpha[i]),
                ("tx", robot.a[i]),
                ("rz", theta),
                ("tz", robot.d[i]),
                ("ry", robot.beta[i]),
            ],
            "dh": [("rz", theta), ("tz", robot.d[i]), ("tx", robot.a[i]), ("rx", robot.alpha[i])],
        }[robot.convention]
        frames.append(np.linalg.multi_dot([frames[-1], *(elementary(*factor) for factor in factors)]))
    return frames


def random_robot(rng: np.random.Generator, dof: int = 6, convention: str = "mdh") -> Robot:
    """A chain with every parameter in use."""
    return Robot(
        name="random",
        alpha=rng.normal(size=dof),
        a=rng.normal(scale=500, size=dof),
        d=rng.normal(scale=500, size=dof),
        offset=rng.normal(size=dof),
        beta=rng.normal(size=dof) * (convention == "mdh"),
        sign=rng.choice([-1.0, 1.0], size=dof),
        convention=convention,  # type: ignore[arg-type]
        tf_base_first=elementary("rx", 0.3) @ elementary("ty", 100.0),
        tf_last_flange=elementary("ry", 1.3) @ elementary("tz", 80.0),
    )


@pytest.mark.parametrize("convention", ["mdh", "dh"])
@pytest.mark.parametrize("dof", [1, 2, 6, 7])
def test_forward_is_the_product_of_links(rng: np.random.Generator, convention: str, dof: int) -> None:
    robot = random_robot(rng, dof, convention)
    q = rng.uniform(-np.pi, np.pi, (5, dof))
    tool = elementary("rz", 0.4) @ elementary("tx", 250.0)
    frames = [product_of_links(robot, row) for row in q]
    flange = np.array([row[-1] @ robot.tf_last_flange for row in frames])
    np.testing.assert_allclose(robot.forward(q), flange, atol=1e-9)
    np.testing.assert_allclose(robot.forward(q, tool=tool), flange @ tool, atol=1e-9)
    np.testing.assert_allclose(robot.frames(q), frames, atol=1e-9)


@pytest.mark.parametrize("name", list_robots())
@pytest.mark.sampled(8)
def test_forward_of_library_robots(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(-np.pi, np.pi, (20, robot.dof))
    expected = [product_of_links(robot, row)[-1] @ robot.tf_last_flange for row in q]
    np.testing.assert_allclose(robot.forward(q), expected, atol=1e-9)


def test_shapes_follow_the_joints(rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr150-2")
    q = rng.uniform(-1, 1, (4, 8, 6))
    tf = robot.forward(q)
    assert tf.shape == (4, 8, 4, 4)
    assert robot.frames(q).shape == (4, 8, 7, 4, 4)
    np.testing.assert_allclose(robot.forward(q[1, 2]), tf[1, 2], atol=1e-9)
    np.testing.assert_array_equal(robot.forward(q[0], tool=[0, 0, 10]), robot.forward(q[0], tool=elementary("tz", 10)))


def test_many_poses_equal_few(rng: np.random.Generator) -> None:
    robot = load_robot("abb-irb120")
    q = rng.uniform(-1, 1, (5000, 6))
    np.testing.assert_allclose(robot.forward(q)[4990:], robot.forward(q[4990:]), atol=1e-10)


@pytest.mark.parametrize(
    ("q", "match"),
    [
        (np.zeros((3, 5)), r"expected joints of shape \(n, 6\) for kuka-kr150-2, got \(3, 5\)"),
        (np.zeros((0, 6)), "joints are empty"),
        ([[0] * 6, [0, np.nan, 0, 0, 0, 0]], "NaN or infinite numbers in row 1"),
        ([[0] * 6, [0, -90, 90, 0, 0, 0]], "joints reach -90 rad in row 1: looks like degrees"),
        ("zero", "not an array of numbers"),
    ],
)
def test_invalid_joints_are_refused(q: object, match: str) -> None:
    robot = load_robot("kuka-kr150-2")
    for method in (robot.forward, robot.frames, robot.check_limits):
        with pytest.raises(DataError, match=match):
            method(q)  # type: ignore[operator]


def test_invalid_tools_are_refused() -> None:
    with pytest.raises(DataError, match=r"expected tool of shape \(4, 4\), or \(3,\) .* got \(2,\)"):
        load_robot("kuka-kr150-2").forward(np.zeros(6), tool=[1.0, 2.0])


def test_limits_name_row_joint_value_and_limits() -> None:
    robot = load_robot("kuka-kr150-2")
    q = np.deg2rad([[0, -90, 90, 0, 0, 0], [0, 10, 90, 0, 0, 0], [0, -90, 160, 0, 0, 360]])
    robot.check_limits(q[0])
    robot.check_limits(np.deg2rad([185, -146, 155, -350, 125, 350]))  # the limits themselves are inside
    with pytest.raises(RobotError, match=r"row 1 joint 2 at 10\.000 deg, limits -146 to 0; row 2 joint 3 at 160\.000"):
        robot.check_limits(q)
    assert robot.within_limits(q).sum(axis=1).tolist() == [6, 5, 4]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"a": [0.0]}, "a must be 6 finite numbers"),
        ({"d": [0, 0, 0, 0, 0, np.inf]}, "d must be 6 finite numbers"),
        ({"sign": [1, 1, 1, 1, 1, 0]}, "sign must be -1 or"),
        ({"limits": np.zeros((6, 2))}, "joint 1: the lower limit 0° is not below the upper 0°"),
        ({"convention": "sdh"}, 'unknown convention "sdh"; expected "mdh"'),
        ({"convention": "dh", "beta": np.ones(6)}, "beta needs the convention"),
        ({"tf_last_flange": np.diag([1.0, 1, -1, 1])}, "tf_last_flange: the 3×3 part is not a rotation"),
        ({"alpha": np.empty(0)}, "no joints"),
    ],
)
def test_what_is_no_chain_is_refused(change: dict[str, object], match: str) -> None:
    with pytest.raises(RobotError, match=match):
        replace(load_robot("kuka-kr150-2"), **change)  # type: ignore[arg-type]


def test_forward_is_exact_to_rounding_at_every_angle(rng: np.random.Generator) -> None:
    link = Robot("link", alpha=[0], a=[0], d=[0], offset=[0])
    q = np.concatenate(
        [rng.uniform(-12, 12, 10_000), np.arange(-8, 9) * np.pi / 2, np.pi + np.linspace(-1e-7, 1e-7, 99)]
    )
    tf = link.forward(q[:, None])
    exact = np.stack([np.cos(q.astype(np.longdouble)), np.sin(q.astype(np.longdouble))], axis=1)
    assert np.abs(tf[:, :2, 0] - exact).max() < 4e-16


def test_repr_and_str_fit_a_screen() -> None:
    robot = load_robot("kuka-kr150-2")
    assert repr(robot) == "<Robot kuka-kr150-2: KUKA KR 150-2, 6 joints, mdh>"
    bare = Robot("bare", alpha=[0], a=[0], d=[0], offset=[0])
    assert repr(bare) == "<Robot bare, 1 joint, mdh>"
    lines = str(robot).splitlines()
    assert len(lines) == 8
    assert max(map(len, lines)) <= 100
    assert lines[3].split()[0] == "2"
    assert float(lines[3].split()[2]) == robot.a[1]
