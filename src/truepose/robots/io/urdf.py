"""Robots from and to URDF: one serial chain of revolute joints between two links; anything else is refused by name."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.files import read_text
from truepose._io.strict import LARGEST, to_float
from truepose._io.units import MM_PER
from truepose._typing import FloatArray
from truepose.errors import FileError, RobotError
from truepose.geometry.transforms import axis_rotation, invert_transform, make_transform
from truepose.robots.chain import Chain
from truepose.robots.convert import mdh_of_fixed
from truepose.robots.robot import Robot

_TURNING: Final = ("revolute", "continuous")
_TIPS: Final = ("tool0", "flange")  # names of the last frame in ROS (REP 199), preferred first


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    element: ET.Element


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
    joints, links, name = _read(path)
    by_child = _parents(path, joints)
    tip = tip or _only_tip(path, joints, links)
    chain = _chain(path, by_child, links, tip)
    root = chain[0].parent if chain else tip
    tf_base_root = np.eye(4) if base is None else invert_transform(_fixed_path(path, by_child, links, base, root))

    fixed, limits, tf = [], [], tf_base_root
    for joint in chain:
        tf = tf @ _origin(path, joint)
        if joint.kind == "fixed":
            continue
        _check_supported(path, joint)
        turn = _axis_frame(path, joint)
        fixed.append(tf @ turn)
        limits.append(_limits(path, joint))
        tf = invert_transform(turn)
    if not fixed:
        raise RobotError(f"{path}: no revolute joint between {root} and {tip}; pass another tip")
    zero = np.zeros(len(fixed))
    names = Robot(name, alpha=zero, a=zero, d=zero, offset=zero, limits=np.array(limits), source=str(path))
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


def _read(path: str | Path) -> tuple[list[_Joint], set[str], str]:
    text = read_text(path)
    # entities are declared in a DOCTYPE, which URDF never needs: without one nothing can be expanded
    if "<!doctype" in text.lower() or "<!entity" in text.lower():
        raise FileError(path, "has a DOCTYPE or ENTITY declaration, which is not supported; remove it")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise FileError(path, f"is not XML: {error.msg.split(':')[0]}", line=error.position[0]) from None
    except ValueError as error:
        raise FileError(path, f"is not XML: {error}") from None
    if root.tag != "robot":
        raise FileError(path, f"is not URDF: its root is <{root.tag}>, expected <robot>")
    if any("}" in element.tag for element in root.iter()):
        raise FileError(path, "still has xacro elements; expand them first (xacro FILE > robot.urdf)")
    links = {_attribute(path, link, "name", "a link") for link in root.findall("link")}
    joints = []
    for element in root.findall("joint"):
        joint_name = _attribute(path, element, "name", "a joint")
        where = f'joint "{joint_name}"'
        ends: list[str] = []
        for end in ("parent", "child"):
            found = element.find(end)
            if found is None:
                raise FileError(path, f"{where} has no <{end}>")
            ends.append(_attribute(path, found, "link", where))
            if ends[-1] not in links:
                raise FileError(path, f'{where} names the link "{ends[-1]}", which does not exist')
        joints.append(_Joint(joint_name, _attribute(path, element, "type", where), ends[0], ends[1], element))
    if not joints:
        raise RobotError(f"{path}: no joints; expected a serial chain")
    return joints, links, root.get("name") or Path(path).stem


def _parents(path: str | Path, joints: list[_Joint]) -> dict[str, _Joint]:
    by_child: dict[str, _Joint] = {}
    for joint in joints:
        other = by_child.setdefault(joint.child, joint)
        if other is not joint:
            raise RobotError(
                f'{path}: link "{joint.child}" has two parent joints, "{other.name}" and "{joint.name}": a closed '
                "chain or parallel linkage is not supported; describe the equivalent serial chain"
            )
    return by_child


def _only_tip(path: str | Path, joints: list[_Joint], links: set[str]) -> str:
    """Return the end of the chain; links on fixed joints are ends only after the last turning joint."""
    children: dict[str, list[_Joint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    moving_below: dict[str, bool] = {}
    roots = sorted(links - {joint.child for joint in joints})
    if len(roots) != 1:
        raise RobotError(f"{path}: expected one root link, found {', '.join(roots) or 'a loop of links'}; pass tip=…")
    order = [roots[0]]
    for link in order:  # breadth first: grows while it is read
        order.extend(joint.child for joint in children.get(link, ()))
    for link in reversed(order):
        moving_below[link] = any(j.kind != "fixed" or moving_below[j.child] for j in children.get(link, ()))

    link = roots[0]
    while moving_below[link]:
        ways = [j for j in children[link] if j.kind != "fixed" or moving_below[j.child]]
        if len(ways) > 1:
            names = " and ".join(f'"{joint.name}"' for joint in ways)
            raise RobotError(
                f'{path}: the chain branches at link "{link}" into {names}; pass the tip of the arm (tip=…)'
            )
        link = ways[0].child
    below = [link]
    for one in below:
        below.extend(joint.child for joint in children.get(one, ()))
    ends = [one for one in below if one not in children]
    named = [one for wanted in _TIPS for one in below if one == wanted]
    if len(ends) == 1 and not named:
        return ends[0]
    if named:
        return named[0]
    raise RobotError(f"{path}: the last joint carries several links, {', '.join(ends)}; pass the flange (tip=…)")


def _chain(path: str | Path, by_child: dict[str, _Joint], links: set[str], tip: str) -> list[_Joint]:
    """Return the joints from the root to a link."""
    if tip not in links:
        raise RobotError(f'{path}: no link "{tip}"; the file has {", ".join(sorted(links))}')
    chain: list[_Joint] = []
    link = tip
    while link in by_child:
        if len(chain) > len(by_child):
            raise RobotError(f'{path}: link "{link}" is part of a loop; a closed chain is not supported')
        chain.append(by_child[link])
        link = by_child[link].parent
    return chain[::-1]


def _fixed_path(path: str | Path, by_child: dict[str, _Joint], links: set[str], base: str, root: str) -> FloatArray:
    """Return tf_root_base (4, 4) [mm] for a base link on the fixed part of the tree."""
    chain = _chain(path, by_child, links, base)
    tf = np.eye(4)
    for joint in chain:
        if joint.kind != "fixed":
            raise RobotError(
                f'{path}: joint "{joint.name}" ({joint.kind}) lies between the root "{root}" and the base "{base}"; '
                "pass a base before the first joint that moves"
            )
        tf = tf @ _origin(path, joint)
    return tf


def _check_supported(path: str | Path, joint: _Joint) -> None:
    if joint.kind not in _TURNING:
        raise RobotError(
            f'{path}: joint "{joint.name}" is {joint.kind}; only revolute, continuous and fixed joints are supported: '
            "pass a base and a tip that exclude it"
        )
    mimic = joint.element.find("mimic")
    if mimic is not None:
        raise RobotError(
            f'{path}: joint "{joint.name}" mimics "{mimic.get("joint")}" (a parallel linkage or gripper): '
            "not supported; describe the equivalent serial chain"
        )


def _origin(path: str | Path, joint: _Joint) -> FloatArray:
    element = joint.element.find("origin")
    if element is None:
        return np.eye(4)
    xyz = _three(path, joint, "origin xyz", element.get("xyz", "0 0 0"))
    rpy = _three(path, joint, "origin rpy", element.get("rpy", "0 0 0"))
    return make_transform(Rotation.from_euler("xyz", rpy), xyz * MM_PER["m"])


def _axis_frame(path: str | Path, joint: _Joint) -> FloatArray:
    """Return a rotation (4, 4) whose z is the joint's axis; the identity for z itself."""
    element = joint.element.find("axis")
    axis = _three(path, joint, "axis xyz", "1 0 0" if element is None else element.get("xyz", "1 0 0"))
    if np.linalg.norm(axis) < 1e-6:
        raise FileError(path, f'joint "{joint.name}": its axis is zero')
    z = axis / np.linalg.norm(axis)
    away = np.eye(3)[int(np.argmin(np.abs(z)))] if abs(z[2]) < 1.0 else np.array([1.0, 0.0, 0.0])
    x = away - (away @ z) * z
    x /= np.linalg.norm(x)
    return make_transform(np.column_stack([x, np.cross(z, x), z]))


def _limits(path: str | Path, joint: _Joint) -> tuple[float, float]:
    if joint.kind == "continuous":
        return -np.inf, np.inf
    element = joint.element.find("limit")
    if element is None:
        raise FileError(path, f'joint "{joint.name}" is revolute and has no <limit>; give lower and upper [rad]')
    lower, upper = (_floats(path, joint, f"limit {end}", element.get(end, "0"), 1)[0] for end in ("lower", "upper"))
    if not lower < upper:
        raise FileError(path, f'joint "{joint.name}": limit lower {lower:g} is not below upper {upper:g} rad')
    return lower, upper


def _attribute(path: str | Path, element: ET.Element, key: str, where: str) -> str:
    value = element.get(key)
    if not value:
        raise FileError(path, f'{where} has no attribute "{key}" in <{element.tag}>')
    return value


def _three(path: str | Path, joint: _Joint, what: str, text: str) -> FloatArray:
    return _floats(path, joint, what, text, 3)


def _floats(path: str | Path, joint: _Joint, what: str, text: str, count: int) -> FloatArray:
    try:
        values = np.array([to_float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not (np.abs(values) <= LARGEST).all():
        raise FileError(path, f'joint "{joint.name}": {what} must be {count} finite numbers; got "{text}"')
    return values


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
