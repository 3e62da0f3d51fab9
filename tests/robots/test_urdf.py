"""URDF: poses of the chain as written; unsupported parts are refused by name; arms are read back as written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.errors import FileError, RobotError
from truepose.robots import list_robots, load_robot, load_urdf, nearest_branch, to_mdh, to_toml, to_urdf

Joint = tuple[str, str, str, str, list[float], list[float], list[float]]

# an arm in ROS's manner: links square to the base at zero, axes by vector, dimensions of the library's FANUC M-20iA
FANUC: list[Joint] = [
    ("base_to_ctrl", "fixed", "base_link", "base", [0, 0, 0.525], [0, 0, 0], [1, 0, 0]),
    ("joint_1", "revolute", "base_link", "link_1", [0, 0, 0.525], [0, 0, 0], [0, 0, 1]),
    ("joint_2", "revolute", "link_1", "link_2", [0.15, 0, 0], [0, 0, 0], [0, 1, 0]),
    ("joint_3", "revolute", "link_2", "link_3", [0, 0, 0.79], [0, 0, 0], [0, -1, 0]),
    ("joint_4", "revolute", "link_3", "link_4", [0, 0, 0.25], [0, 0, 0], [-1, 0, 0]),
    ("joint_5", "revolute", "link_4", "link_5", [0.835, 0, 0], [0, 0, 0], [0, -1, 0]),
    ("joint_6", "continuous", "link_5", "link_6", [0.1, 0, 0], [0, 0, 0], [-1, 0, 0]),
    ("mount", "fixed", "link_6", "tool0", [0, 0, 0], [3.141592653589793, -1.5707963267948966, 0], [1, 0, 0]),
]


def write(path: Path, joints: list[Joint], extra: str = "", into: str = "") -> Path:
    links = sorted({link for joint in joints for link in joint[2:4]})
    text = ['<?xml version="1.0"?>', '<robot name="arm">', *(f'<link name="{link}"/>' for link in links)]
    for name, kind, parent, child, xyz, rpy, axis in joints:
        limit = '<limit lower="-3" upper="3.5" effort="1" velocity="1"/>' if kind == "revolute" else ""
        words = [" ".join(repr(float(x)) for x in vector) for vector in (xyz, rpy, axis)]
        text.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{words[0]}" rpy="{words[1]}"/><axis xyz="{words[2]}"/>{limit}{into}</joint>'
        )
    path.write_text("\n".join([*text, extra, "</robot>"]), "utf-8")
    return path


def pose_as_written(joints: list[Joint], q: np.ndarray) -> np.ndarray:
    """Pose of the last link in the root: origins and rotations about the axes, one after the other [mm]."""
    tf, turned = np.eye(4), iter(q)
    for _, kind, _, _, xyz, rpy, axis in joints:
        step = np.eye(4)
        step[:3, 3] = 1000 * np.array(xyz)
        step[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        tf = tf @ step
        if kind != "fixed":
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(next(turned) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
            tf = tf @ turn
    return tf


def test_an_arm_in_ros_manner_is_the_librarys(tmp_path: Path, rng: np.random.Generator) -> None:
    arm = load_urdf(write(tmp_path / "arm.urdf", FANUC), base="base")  # ROS's name for the controller's world
    library = load_robot("fanuc-m20ia")
    q = rng.uniform(-3, 3, (50, 6))
    np.testing.assert_allclose(arm.forward(q), library.forward(q), atol=1e-9)
    np.testing.assert_allclose(nearest_branch(arm.inverse(arm.forward(q)), q), q, atol=1e-6)
    assert (arm.name, arm.dof) == ("arm", 6)
    np.testing.assert_allclose(arm.limits[:5], np.tile([-3.0, 3.5], (5, 1)))
    assert np.isinf(arm.limits[5]).all()


@pytest.mark.parametrize("dof", [1, 3, 7])
def test_any_axes_and_origins(tmp_path: Path, rng: np.random.Generator, dof: int) -> None:
    joints: list[Joint] = []
    for i in range(dof + 2):
        kind = "fixed" if i in (1, dof + 1) else "revolute"
        numbers = (rng.normal(size=3).tolist(), rng.normal(size=3).tolist(), rng.normal(size=3).tolist())
        joints.append((f"j{i}", kind, f"l{i}", f"l{i + 1}", *numbers))
    arm = load_urdf(write(tmp_path / "arm.urdf", joints))
    assert arm.dof == dof
    q = rng.uniform(-3, 3, (20, dof))
    np.testing.assert_allclose(arm.forward(q), [pose_as_written(joints, row) for row in q], atol=1e-9)


def test_base_and_tip_by_name(tmp_path: Path, rng: np.random.Generator) -> None:
    path = write(tmp_path / "arm.urdf", FANUC)
    q = rng.uniform(-3, 3, (5, 6))
    whole = load_urdf(path).forward(q)
    from_base = load_urdf(path, base="base").forward(q)
    np.testing.assert_allclose(from_base[:, :3, 3], whole[:, :3, 3] - [0, 0, 525], atol=1e-9)
    assert load_urdf(path, tip="link_3").dof == 3
    np.testing.assert_allclose(load_urdf(path, tip="link_6").forward(q)[:, :3, 3], whole[:, :3, 3], atol=1e-9)


def joint(name: str, kind: str, parent: str, child: str) -> Joint:
    return (name, kind, parent, child, [0, 0, 0.1], [0, 0, 0], [0, 0, 1])


@pytest.mark.parametrize(
    ("joints", "match"),
    [
        ([joint("rail", "prismatic", "a", "b"), joint("j", "revolute", "b", "c")], 'joint "rail" is prismatic; only'),
        ([joint("free", "floating", "a", "b"), joint("j", "revolute", "b", "c")], 'joint "free" is floating'),
        ([joint("flat", "planar", "a", "b"), joint("j", "revolute", "b", "c")], 'joint "flat" is planar'),
        (
            [
                joint("j", "revolute", "a", "b"),
                joint("left", "revolute", "b", "c"),
                joint("right", "revolute", "b", "d"),
            ],
            'the chain branches at link "b" into "left" and "right"; pass the tip',
        ),
        (
            [joint("j", "revolute", "a", "b"), joint("k", "revolute", "a", "c"), joint("rod", "revolute", "c", "b")],
            'link "b" has two parent joints, "j" and "rod": a closed chain or parallel linkage',
        ),
        ([joint("j", "revolute", "a", "b"), joint("k", "revolute", "b", "a")], "found a loop of links"),
        ([joint("j", "revolute", "a", "b"), joint("k", "revolute", "c", "d")], "expected one root link, found a, c"),
        ([joint("j", "fixed", "a", "b")], "no revolute joint between a and b"),
        (
            [joint("j", "revolute", "a", "b"), joint("f", "fixed", "b", "camera"), joint("g", "fixed", "b", "gripper")],
            "the last joint carries several links, camera, gripper; pass the flange",
        ),
    ],
)
def test_unsupported_chains_are_refused_by_name(tmp_path: Path, joints: list[Joint], match: str) -> None:
    with pytest.raises(RobotError, match=match):
        load_urdf(write(tmp_path / "arm.urdf", joints))


def test_mimic_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "arm.urdf", [joint("rod", "revolute", "a", "b")], into='<mimic joint="j2"/>')
    with pytest.raises(RobotError, match='joint "rod" mimics "j2" \\(a parallel linkage or gripper\\): not supported'):
        load_urdf(path)


def test_gripper_behind_a_named_tip_does_not_matter(tmp_path: Path) -> None:
    fingers = [joint("left", "prismatic", "c", "d"), joint("right", "prismatic", "c", "e")]
    joints = [joint("j", "revolute", "a", "b"), joint("k", "fixed", "b", "c"), *fingers]
    assert load_urdf(write(tmp_path / "arm.urdf", joints), tip="c").dof == 1


def test_wrong_base_or_tip(tmp_path: Path) -> None:
    path = write(tmp_path / "arm.urdf", FANUC)
    with pytest.raises(RobotError, match='no link "tool1"; the file has base, base_link, link_1'):
        load_urdf(path, tip="tool1")
    with pytest.raises(
        RobotError, match=r'joint "joint_1" \(revolute\) lies between the root "base_link" and the base'
    ):
        load_urdf(path, base="link_2")


BOMB = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("<robot", f"{BOMB}<robot", "has a DOCTYPE or ENTITY declaration, which is not supported"),
        ("</robot>", "", "is not XML: no element found"),
        ("<link ", "<lnk><link ", "is not XML: mismatched tag"),
        ('"0.0 0.0 0.1"', '"0.0 0.1"', 'joint "j": origin xyz must be 3 finite numbers; got "0.0 0.1"'),
        ('"0.0 0.0 0.1"', '"0.0 0.0 nan"', 'joint "j": origin xyz must be 3 finite numbers'),
        ('"0.0 0.0 1.0"', '"0 0 0"', 'joint "j": its axis is zero'),
        ('lower="-3"', 'lower="4"', 'joint "j": limit lower 4 is not below upper 3.5 rad'),
        ("<limit ", "<limits ", 'joint "j" is revolute and has no <limit>'),
        ('<parent link="a"/>', "", 'joint "j" has no <parent>'),
        ('<child link="b"/>', '<child link="x"/>', 'joint "j" names the link "x", which does not exist'),
        (' type="revolute"', "", 'joint "j" has no attribute "type"'),
        ("<robot ", '<robot xmlns:x="u" ', None),
        ("<link ", '<x:arg xmlns:x="u"/><link ', "still has xacro elements"),
    ],
)
def test_invalid_files_are_refused(tmp_path: Path, old: str, new: str, match: str | None) -> None:
    path = write(tmp_path / "arm.urdf", [joint("j", "revolute", "a", "b")])
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")
    if match is None:
        assert load_urdf(path).dof == 1
        return
    with pytest.raises(FileError, match=rf"arm\.urdf.*: {match}"):
        load_urdf(path)


def test_no_joints_and_other_roots(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text('<robot name="r"><link name="a"/></robot>', "utf-8")
    with pytest.raises(RobotError, match="no joints"):
        load_urdf(path)
    path.write_text("<sdf/>", "utf-8")
    with pytest.raises(FileError, match="its root is <sdf>, expected <robot>"):
        load_urdf(path)


@pytest.mark.parametrize("name", list_robots())
@pytest.mark.parametrize("kind", ["urdf", "toml"])
@pytest.mark.sampled(12)
def test_round_trip(name, kind, rng, tmp_path):
    nominal = load_robot(name)
    size = {"alpha": 3e-4, "offset": 3e-4, "beta": 3e-4, "a": 0.3, "d": 0.3}
    mdh = to_mdh(nominal)
    calibrated = replace(mdh, **{key: getattr(mdh, key) + rng.normal(scale=s, size=6) for key, s in size.items()})
    q = rng.uniform(-np.pi, np.pi, (500, 6))
    for robot in (nominal, calibrated):
        path = tmp_path / f"arm.{kind}"
        path.write_text(to_urdf(robot) if kind == "urdf" else to_toml(robot), "utf-8")
        again = load_robot(path)
        np.testing.assert_allclose(again.forward(q), robot.forward(q), atol=1e-9)
        np.testing.assert_allclose(again.limits, robot.limits)


def test_joints_without_limits_and_names_with_signs(tmp_path):
    robot = replace(load_robot("kuka-kr150-2"), name="a <b> & c", limits=np.tile([-np.inf, np.inf], (6, 1)))
    path = tmp_path / "arm.urdf"
    path.write_text(to_urdf(robot), "utf-8")
    again = load_robot(path)
    assert again.name == robot.name
    assert np.isinf(again.limits).all()
