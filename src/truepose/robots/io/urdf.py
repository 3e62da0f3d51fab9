"""Robots from and to URDF: one serial chain of revolute joints between two links; anything else is refused by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from truepose._io.units import MM_PER
from truepose._typing import FloatArray
from truepose.errors import FileError, RobotError
from truepose.geometry.transforms import axis_rotation, invert_transform
from truepose.robots.chain import Chain
from truepose.robots.convert import mdh_of_fixed
from truepose.robots.io.urdf_tree import (
    UrdfJoint,
    UrdfTree,
    axis_frame,
    check_supported,
    joints_by_child,
    joints_to,
    numbers,
    only_tip,
    origin_of,
    read_tree,
)
from truepose.robots.robot import Robot


def load_urdf(path: str | Path, base: str | None = None, tip: str | None = None) -> Robot:
    """Return the serial chain of a URDF file as a robot.

    Parameters
    ----------
    path : str or Path
        The file.
    base : str, optional
        The link whose frame is the robot base; the root link when not given. Only fixed joints may lie between the
        two. ROS's base_link and the controller's base may differ by a turn about z.
    tip : str, optional
        The link whose frame is the flange. When not given, the only end of the chain, or `tool0` or `flange` if there
        are several ends.

    Returns
    -------
    Robot
        The arm in the parameters of theory (1); its poses agree with the file's to rounding.

    Raises
    ------
    FileError
        If the file is not URDF, or a number or link is missing or invalid.
    RobotError
        If the chain has prismatic, floating, planar or mimicking joints, branches or loops.
    """
    tree = read_tree(path)
    by_child = joints_by_child(tree)
    tip = tip or only_tip(tree)
    chain = joints_to(tree, by_child, tip)
    root = chain[0].parent if chain else tip
    tf_base_root = np.eye(4) if base is None else invert_transform(_fixed_path(tree, by_child, base, root))

    fixed, limits, tf = [], [], tf_base_root
    for joint in chain:
        tf = tf @ origin_of(path, joint)
        if joint.kind == "fixed":
            continue
        check_supported(path, joint)
        turn = axis_frame(path, joint)
        fixed.append(tf @ turn)
        limits.append(_limits(path, joint))
        tf = invert_transform(turn)
    if not fixed:
        raise RobotError(f"{path}: no revolute joint between {root} and {tip}; pass another tip")
    zero = np.zeros(len(fixed))
    names = Robot(tree.name, alpha=zero, a=zero, d=zero, offset=zero, limits=np.array(limits), source=str(path))
    return mdh_of_fixed(names, np.array([*fixed, tf]))


def to_urdf(robot: Chain) -> str:
    """Return a robot as the text of a URDF file (m and rad, all digits), which `load_urdf` reads back.

    The links are base_link, link_1 …, tool0, without masses and shapes. Joint i turns about z of its frame, or −z where
    the robot's sign is −1, so that its zero and sense are the controller's. Calibrated arms are written exactly.

    Examples
    --------
    >>> arm = Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0])
    >>> print(to_urdf(arm).splitlines()[5].strip())
    <joint name="joint_1" type="continuous">
    """
    origins = robot.fixed.copy()
    origins[:-1] = origins[:-1] @ axis_rotation(2, robot.offset)
    names = ["base_link", *(f"link_{j}" for j in range(1, robot.dof + 1)), "tool0"]
    from xml.sax.saxutils import quoteattr  # imports the network modules of Python

    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    lines += [f"  <link name={quoteattr(name)}/>" for name in names]
    for j in range(robot.dof):
        lower, upper = robot.limits[j]
        endless = not np.isfinite([lower, upper]).all()
        lines += [
            f'  <joint name="joint_{j + 1}" type="{"continuous" if endless else "revolute"}">',
            *_between(names[j], names[j + 1], origins[j]),
            f'    <axis xyz="0 0 {robot.sign[j]:.0f}"/>',
        ]
        if not endless:
            lines += [f'    <limit lower="{float(lower)!r}" upper="{float(upper)!r}" effort="0" velocity="0"/>']
        lines += ["  </joint>"]
    lines += ['  <joint name="flange" type="fixed">', *_between(names[-2], names[-1], origins[-1]), "  </joint>"]
    return "\n".join([*lines, "</robot>"]) + "\n"


def _fixed_path(tree: UrdfTree, by_child: dict[str, UrdfJoint], base: str, root: str) -> FloatArray:
    """Return tf_root_base (4, 4) [mm] for a base link on the fixed part of the tree."""
    chain = joints_to(tree, by_child, base)
    tf = np.eye(4)
    for joint in chain:
        if joint.kind != "fixed":
            raise RobotError(
                f'{tree.path}: joint "{joint.name}" ({joint.kind}) lies between the root "{root}" and the base '
                f'"{base}"; pass a base before the first joint that moves'
            )
        tf = tf @ origin_of(tree.path, joint)
    return tf


def _limits(path: str | Path, joint: UrdfJoint) -> tuple[float, float]:
    if joint.kind == "continuous":
        return -np.inf, np.inf
    element, where = joint.element.find("limit"), f'joint "{joint.name}"'
    if element is None:
        raise FileError(path, f"{where} is revolute and has no <limit>; give lower and upper [rad]")
    lower, upper = (numbers(path, where, f"limit {end}", element.get(end, "0"), 1)[0] for end in ("lower", "upper"))
    if not lower < upper:
        raise FileError(path, f"{where}: limit lower {lower:g} is not below upper {upper:g} rad")
    return lower, upper


def _between(parent: str, child: str, tf: FloatArray) -> list[str]:
    xyz = " ".join(repr(float(x)) for x in tf[:3, 3] / MM_PER["m"])
    rpy = " ".join(repr(float(x)) for x in _rpy(tf))
    return [
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
    ]


def _rpy(tf: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch, yaw of R = Rz(yaw) Ry(pitch) Rx(roll), exact also at pitch ±90 deg."""
    yaw = np.arctan2(tf[1, 0], tf[0, 0])
    rest = axis_rotation(2, -yaw) @ tf
    return float(np.arctan2(-rest[1, 2], rest[1, 1])), float(np.arctan2(-rest[2, 0], rest[0, 0])), float(yaw)
