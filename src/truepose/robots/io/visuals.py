"""The visible shapes of a URDF arm: which file or solid, where, and on which body of the chain."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.units import MM_PER
from truepose._typing import FloatArray
from truepose.errors import FileError, RobotError
from truepose.geometry.transforms import axis_rotation
from truepose.robots.io.triangles import Colour, IntArray, Mesh
from truepose.robots.io.urdf_tree import (
    TIPS,
    UrdfJoint,
    UrdfTree,
    attribute_of,
    axis_frame,
    check_supported,
    joints_by_child,
    joints_to,
    numbers,
    only_tip,
    origin_of,
    read_tree,
    tf_of_origin,
)

_BASE: Final = "base"
_AROUND: Final = 32
_MOST_VISUALS: Final = 200


@dataclass(frozen=True, eq=False)
class Visual:
    """A visible shape.

    Attributes
    ----------
    link : str
        The link that carries it.
    body : int
        The body of the arm that the link belongs to: 0 is the base, i turns with joint i.
    tf_root_shape : (4, 4) array [mm]
        Its frame with all joints at zero, in the frame of the root link.
    file : str
        The mesh as the URDF names it; empty for a solid.
    scale : (3,) array
        mm per unit of the mesh along its axes.
    solid : Mesh, optional
        A box, cylinder or sphere, in m.
    colour : (red, green, blue), optional
        The colour of its material.
    """

    link: str
    body: int
    tf_root_shape: FloatArray
    file: str
    scale: FloatArray
    solid: Mesh | None = None
    colour: Colour | None = None


@dataclass(frozen=True, eq=False)
class VisibleArm:
    """An arm of a URDF file with its shapes, all joints at zero.

    Attributes
    ----------
    tf_root_axes : (dof, 4, 4) array [mm]
        Frames on the joints whose z is the axis, in the frame of the root link.
    tf_root_base : (4, 4) array [mm]
        The link ``base`` of ROS, the controller's base; the root itself if there is none.
    visuals : list of Visual
        The shapes of the links that belong to the arm.
    apart : list of str
        Links with shapes on joints that are none of the arm's, such as the fingers of a gripper.
    """

    tf_root_axes: FloatArray
    tf_root_base: FloatArray
    visuals: list[Visual] = field(default_factory=list)
    apart: list[str] = field(default_factory=list)


def load_visuals(path: Path) -> VisibleArm:
    """Return the arm of a URDF file with its shapes.

    Raises
    ------
    FileError
        If the file is not URDF, or a number is missing or invalid.
    RobotError
        If the chain is none of revolute joints, or the file has too many shapes.
    """
    tree = read_tree(path)
    by_child = joints_by_child(tree)
    tip = next((name for name in TIPS if name in tree.links), "") or only_tip(tree)
    chain = joints_to(tree, by_child, tip)
    turning = [joint for joint in chain if joint.kind != "fixed"]
    for joint in turning:
        check_supported(path, joint)
    if not turning:
        raise RobotError(f"{path}: no revolute joint between the root and {tip}")
    placed = _placed(tree, chain[0].parent, turning)
    axes = np.array([placed[joint.child][1] @ axis_frame(path, joint) for joint in turning])
    base = placed.get(_BASE, (0, np.eye(4)))
    arm = VisibleArm(axes, base[1] if base[0] == 0 else np.eye(4))
    materials = {name: one for one in tree.root.findall("material") if (name := one.get("name"))}
    for link in tree.root.findall("link"):
        name, shapes = link.get("name", ""), link.findall("visual")
        body, tf_root_link = placed.get(name, (None, np.eye(4)))
        if body is None:
            arm.apart.extend([name] if shapes else [])
            continue
        arm.visuals.extend(_visual(path, name, body, tf_root_link, shape, materials) for shape in shapes)
    if len(arm.visuals) > _MOST_VISUALS:
        raise RobotError(f"{path}: has {len(arm.visuals)} visible shapes, at most {_MOST_VISUALS} are shown")
    return arm


def _placed(tree: UrdfTree, root: str, turning: list[UrdfJoint]) -> dict[str, tuple[int, FloatArray]]:
    """Return the body of each link of the arm, and its frame at zero in the frame of the root link."""
    children: dict[str, list[UrdfJoint]] = {}
    for joint in tree.joints:
        children.setdefault(joint.parent, []).append(joint)
    body_of = {joint.child: number for number, joint in enumerate(turning, start=1)}
    placed: dict[str, tuple[int, FloatArray]] = {root: (0, np.eye(4))}
    order = [root]
    for link in order:  # breadth first: grows while it is read
        body, tf = placed[link]
        for joint in children.get(link, ()):
            if joint.kind == "fixed" or joint.child in body_of:
                placed[joint.child] = (body_of.get(joint.child, body), tf @ origin_of(tree.path, joint))
                order.append(joint.child)
    return placed


def _visual(
    path: Path, link: str, body: int, tf_root_link: FloatArray, element: ET.Element, materials: dict[str, ET.Element]
) -> Visual:
    where = f'link "{link}"'
    tf = tf_root_link @ tf_of_origin(path, element, where)
    shape = next(iter(element.findall("geometry/*")), None)
    if shape is None:
        raise FileError(path, f"{where} has a <visual> without geometry")
    colour = _colour(path, where, element, materials)
    scale = np.full(3, MM_PER["m"])
    if shape.tag == "mesh":
        factors = numbers(path, where, "mesh scale", shape.get("scale", "1 1 1"), 3)
        return Visual(link, body, tf, attribute_of(path, shape, "filename", where), scale * factors, None, colour)
    return Visual(link, body, tf, "", scale, _solid(path, where, shape), colour)


def _colour(path: Path, where: str, element: ET.Element, materials: dict[str, ET.Element]) -> Colour | None:
    """Return the colour of a material, which may be described once for the whole file."""
    material = element.find("material")
    if material is None:
        return None
    found = material.find("color")
    if found is None:
        found = materials.get(material.get("name", ""), material).find("color")
    if found is None:
        return None
    red, green, blue = np.clip(numbers(path, where, "color rgba", found.get("rgba", ""), 4)[:3], 0.0, 1.0).tolist()
    return red, green, blue


def _solid(path: Path, where: str, shape: ET.Element) -> Mesh:
    """Return a box, cylinder or sphere of URDF around its middle, in m."""

    def size(key: str, count: int = 1) -> list[float]:
        return [abs(float(x)) for x in numbers(path, where, f"{shape.tag} {key}", shape.get(key, ""), count)]

    if shape.tag == "box":
        half = np.array(size("size", 3)) / 2
        corners, triangles = _turned(np.array([[1.0, -1.0], [1.0, 1.0]]), 4, np.pi / 4)
        return Mesh(corners * half * [np.sqrt(2.0), np.sqrt(2.0), 1.0], triangles)
    if shape.tag == "cylinder":
        (radius,), (length,) = size("radius"), size("length")
        return Mesh(*_turned(np.array([[radius, -length / 2], [radius, length / 2]]), _AROUND))
    if shape.tag == "sphere":
        (radius,) = size("radius")
        angle = np.linspace(-np.pi / 2, np.pi / 2, _AROUND // 2 + 1)[1:-1]
        return Mesh(*_turned(radius * np.column_stack([np.cos(angle), np.sin(angle)]), _AROUND, poles=radius))
    raise FileError(path, f"{where} has a shape <{shape.tag}> that is not known")


def _turned(
    outline: FloatArray, around: int, start: float = 0.0, poles: float | None = None
) -> tuple[FloatArray, IntArray]:
    """Return points and triangles of an outline of (radius, height) that is turned about z, closed at both ends."""
    rings, step = len(outline), np.arange(around)
    turns = axis_rotation(2, start + 2 * np.pi * step / around)[:, :3, :3]
    points = np.concatenate([turns @ [radius, 0.0, height] for radius, height in outline])
    ends = (outline[0, 1], outline[-1, 1]) if poles is None else (-poles, poles)
    points = np.vstack([points, [[0.0, 0.0, ends[0]], [0.0, 0.0, ends[1]]]])
    after = (step + 1) % around
    bottom, top = rings * around, rings * around + 1
    last = (rings - 1) * around
    faces = [np.column_stack([np.full(around, bottom), after, step])]
    for ring in np.arange(rings - 1) * around:
        faces.append(np.column_stack([ring + step, ring + after, ring + around + after]))
        faces.append(np.column_stack([ring + step, ring + around + after, ring + around + step]))
    faces.append(np.column_stack([np.full(around, top), last + step, last + after]))
    return points, np.concatenate(faces).astype(np.int32)
