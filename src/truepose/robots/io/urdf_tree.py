"""The tree of links and joints of a URDF file, for the readers of arms and of their meshes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.files import LARGEST_FILE, read_text
from truepose._io.strict import LARGEST, to_float
from truepose._io.units import MM_PER
from truepose._typing import FloatArray
from truepose.errors import FileError, RobotError
from truepose.geometry.transforms import make_transform

_TURNING: Final = ("revolute", "continuous")
_MOST_TAGS: Final = 2_000_000
TIPS: Final = ("tool0", "flange")
"""Names of the last frame in ROS (REP 199), preferred first."""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint, with the links that it joins."""

    name: str
    kind: str
    parent: str
    child: str
    element: ET.Element


@dataclass(frozen=True)
class UrdfTree:
    """A URDF file as it is written: its links by name, and its joints in their order."""

    path: Path
    name: str
    root: ET.Element
    links: set[str]
    joints: list[UrdfJoint]


def read_xml(path: str | Path, largest: int = LARGEST_FILE) -> ET.Element:
    """Return the root of an XML file; entities, which an attacker declares and our formats never need, are refused."""
    text = read_text(path, largest)
    # entities are declared in a DOCTYPE: without one nothing can be expanded
    if "<!doctype" in text.lower() or "<!entity" in text.lower():
        raise FileError(path, "has a DOCTYPE or ENTITY declaration, which is not supported; remove it")
    if text.count("<") > _MOST_TAGS:
        raise FileError(path, f"has more than {_MOST_TAGS:,} tags; export a simpler file")
    try:
        return ET.fromstring(text)
    except ET.ParseError as error:
        raise FileError(path, f"is not XML: {error.msg.split(':')[0]}", line=error.position[0]) from None
    except ValueError as error:
        raise FileError(path, f"is not XML: {error}") from None


def read_tree(path: str | Path) -> UrdfTree:
    """Return the links and joints of a URDF file.

    Raises
    ------
    FileError
        If the file is not URDF, or a joint is incomplete.
    RobotError
        If there are no joints.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise FileError(path, f"is not URDF: its root is <{root.tag}>, expected <robot>")
    if any("}" in element.tag for element in root.iter()):
        raise FileError(path, "still has xacro elements; expand them first (xacro FILE > robot.urdf)")
    links = {attribute_of(path, link, "name", "a link") for link in root.findall("link")}
    joints = []
    for element in root.findall("joint"):
        joint_name = attribute_of(path, element, "name", "a joint")
        where = f'joint "{joint_name}"'
        ends: list[str] = []
        for end in ("parent", "child"):
            found = element.find(end)
            if found is None:
                raise FileError(path, f"{where} has no <{end}>")
            ends.append(attribute_of(path, found, "link", where))
            if ends[-1] not in links:
                raise FileError(path, f'{where} names the link "{ends[-1]}", which does not exist')
        joints.append(UrdfJoint(joint_name, attribute_of(path, element, "type", where), ends[0], ends[1], element))
    if not joints:
        raise RobotError(f"{path}: no joints; expected a serial chain")
    return UrdfTree(Path(path), root.get("name") or Path(path).stem, root, links, joints)


def joints_by_child(tree: UrdfTree) -> dict[str, UrdfJoint]:
    """Return the joints by the link that each moves; a RobotError names a link with two of them."""
    by_child: dict[str, UrdfJoint] = {}
    for joint in tree.joints:
        other = by_child.setdefault(joint.child, joint)
        if other is not joint:
            raise RobotError(
                f'{tree.path}: link "{joint.child}" has two parent joints, "{other.name}" and "{joint.name}": a closed '
                "chain or parallel linkage is not supported; describe the equivalent serial chain"
            )
    return by_child


def only_tip(tree: UrdfTree) -> str:
    """Return the end of the chain; links on fixed joints are ends only after the last turning joint."""
    children: dict[str, list[UrdfJoint]] = {}
    for joint in tree.joints:
        children.setdefault(joint.parent, []).append(joint)
    moving_below: dict[str, bool] = {}
    roots = sorted(tree.links - {joint.child for joint in tree.joints})
    if len(roots) != 1:
        raise RobotError(
            f"{tree.path}: expected one root link, found {', '.join(roots) or 'a loop of links'}; pass tip=…"
        )
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
                f'{tree.path}: the chain branches at link "{link}" into {names}; pass the tip of the arm (tip=…)'
            )
        link = ways[0].child
    below = [link]
    for one in below:
        below.extend(joint.child for joint in children.get(one, ()))
    ends = [one for one in below if one not in children]
    named = [one for wanted in TIPS for one in below if one == wanted]
    if len(ends) == 1 and not named:
        return ends[0]
    if named:
        return named[0]
    raise RobotError(f"{tree.path}: the last joint carries several links, {', '.join(ends)}; pass the flange (tip=…)")


def joints_to(tree: UrdfTree, by_child: dict[str, UrdfJoint], tip: str) -> list[UrdfJoint]:
    """Return the joints from the root to a link."""
    if tip not in tree.links:
        raise RobotError(f'{tree.path}: no link "{tip}"; the file has {", ".join(sorted(tree.links))}')
    chain: list[UrdfJoint] = []
    link = tip
    while link in by_child:
        if len(chain) > len(by_child):
            raise RobotError(f'{tree.path}: link "{link}" is part of a loop; a closed chain is not supported')
        chain.append(by_child[link])
        link = by_child[link].parent
    return chain[::-1]


def origin_of(path: str | Path, joint: UrdfJoint) -> FloatArray:
    """Return the frame of a joint in that of its parent link at zero, (4, 4) [mm]."""
    return tf_of_origin(path, joint.element, f'joint "{joint.name}"')


def tf_of_origin(path: str | Path, holder: ET.Element, where: str) -> FloatArray:
    """Return the <origin> of an element, (4, 4) [mm]; `where` names the element in errors."""
    element = holder.find("origin")
    if element is None:
        return np.eye(4)
    xyz = numbers(path, where, "origin xyz", element.get("xyz", "0 0 0"), 3)
    rpy = numbers(path, where, "origin rpy", element.get("rpy", "0 0 0"), 3)
    return make_transform(Rotation.from_euler("xyz", rpy), xyz * MM_PER["m"])


def axis_frame(path: str | Path, joint: UrdfJoint) -> FloatArray:
    """Return a rotation (4, 4) whose z is the joint's axis; the identity for z itself."""
    element = joint.element.find("axis")
    where = f'joint "{joint.name}"'
    axis = numbers(path, where, "axis xyz", "1 0 0" if element is None else element.get("xyz", "1 0 0"), 3)
    if np.linalg.norm(axis) < 1e-6:
        raise FileError(path, f"{where}: its axis is zero")
    z = axis / np.linalg.norm(axis)
    away = np.eye(3)[int(np.argmin(np.abs(z)))] if abs(z[2]) < 1.0 else np.array([1.0, 0.0, 0.0])
    x = away - (away @ z) * z
    x /= np.linalg.norm(x)
    return make_transform(np.column_stack([x, np.cross(z, x), z]))


def attribute_of(path: str | Path, element: ET.Element, key: str, where: str) -> str:
    """Return an attribute of an element, which must not be empty; `where` names the element in errors."""
    value = element.get(key)
    if not value:
        raise FileError(path, f'{where} has no attribute "{key}" in <{element.tag}>')
    return value


def numbers(path: str | Path, where: str, what: str, text: str, count: int) -> FloatArray:
    """Return the numbers of an attribute, (count,); a FileError names the element if there are others."""
    try:
        values = np.array([to_float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not (np.abs(values) <= LARGEST).all():
        raise FileError(path, f'{where}: {what} must be {count} finite numbers; got "{text}"')
    return values


def check_supported(path: str | Path, joint: UrdfJoint) -> None:
    """Refuse joints that do not turn by an angle of their own."""
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
