"""Triangle meshes from COLLADA (.dae) files: geometry, nodes, unit and plain colours.

The axis that the file calls "up" is not applied: viewers of ROS show meshes in the axes of the link.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry.transforms import apply_transform
from truepose.robots.io.triangles import (
    FARTHEST,
    LARGEST_MESH,
    Colour,
    IntArray,
    Mesh,
    check_count,
    checked,
    numbers_of,
)
from truepose.robots.io.urdf_tree import read_xml

_MOST_NODES: Final = 10_000
_READ: Final = ("triangles", "polylist", "polygons")
_NOT_READ: Final = ("tristrips", "trifans")
_SHADERS: Final = ("phong", "lambert", "blinn", "constant")


def read_collada(path: Path) -> list[Mesh]:
    """Return the meshes of a file in m, each of one colour, where its scene puts them.

    Raises
    ------
    FileError
        If the file is not COLLADA, declares entities, or its parts do not fit together.
    """
    root = read_xml(path, LARGEST_MESH)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise FileError(path, f"is not COLLADA: its root is <{root.tag}>")
    return _Document(path, root).meshes()


class _Document:
    def __init__(self, path: Path, root: ET.Element) -> None:
        self.path, self.root = path, root
        self.by_id = {found: element for element in root.iter() if (found := element.get("id"))}
        self._nodes = self._triangles = 0
        self._read: dict[int, tuple[FloatArray, IntArray]] = {}

    def meshes(self) -> list[Mesh]:
        unit = self.root.find("asset/unit")
        metres = 1.0 if unit is None else self._numbers(unit.get("meter", "1"), 1)[0]
        if not 1e-6 < metres < 1e6:
            raise FileError(self.path, f"states a unit of {metres:g} m, which is impossible")
        scale = np.diag([metres, metres, metres, 1.0])
        scene = self.root.find("scene/instance_visual_scene")
        if scene is None:
            geometries = self.root.findall("library_geometries/geometry")
            return [mesh for one in geometries for mesh in self._geometry(one, scale, {})]
        nodes = self._target(scene).findall("node")
        return [mesh for node in nodes for mesh in self._node(node, scale, 0)]

    def _target(self, element: ET.Element, key: str = "url") -> ET.Element:
        """Return the element of this file that another one refers to."""
        reference = element.get(key, "")
        found = self.by_id.get(reference.removeprefix("#"))
        if found is None or not reference.startswith("#"):
            raise FileError(self.path, f'<{element.tag}> refers to "{reference}", which is not in the file')
        return found

    def _node(self, node: ET.Element, tf: FloatArray, depth: int) -> Iterator[Mesh]:
        self._nodes += 1
        # a node that contains itself, or many nodes that contain each other many times
        if depth > 50 or self._nodes > _MOST_NODES:
            raise FileError(self.path, f"has more than {_MOST_NODES:,} nodes, or nodes that contain themselves")
        tf = tf @ self._pose(node)
        self._check_place(tf)
        for child in node:
            if child.tag == "node":
                yield from self._node(child, tf, depth + 1)
            elif child.tag == "instance_node":
                yield from self._node(self._target(child), tf, depth + 1)
            elif child.tag == "instance_geometry":
                yield from self._geometry(self._target(child), tf, self._materials(child))

    def _check_place(self, tf: FloatArray) -> None:
        if not (np.abs(tf) < FARTHEST).all():
            raise FileError(self.path, "has a node that is impossibly large or far away")

    def _pose(self, node: ET.Element) -> FloatArray:
        tf = np.eye(4)
        for child in node:
            step = np.eye(4)
            if child.tag == "matrix":
                step = self._numbers(child.text, 16).reshape(4, 4)
                step[3] = [0.0, 0.0, 0.0, 1.0]
            elif child.tag == "translate":
                step[:3, 3] = self._numbers(child.text, 3)
            elif child.tag == "scale":
                step[[0, 1, 2], [0, 1, 2]] = self._numbers(child.text, 3)
            elif child.tag == "rotate":
                *axis, angle = self._numbers(child.text, 4)
                length = float(np.linalg.norm(axis)) or 1.0
                step[:3, :3] = Rotation.from_rotvec(np.deg2rad(angle) * np.array(axis) / length).as_matrix()
            self._check_place(step)
            tf = tf @ step
            self._check_place(tf)
        return tf

    def _materials(self, instance: ET.Element) -> dict[str, Colour]:
        """Return the colours of the symbols that primitives of a geometry use."""
        bound = instance.findall("bind_material/technique_common/instance_material")
        found = {one.get("symbol", ""): self._colour(self._target(one, "target")) for one in bound}
        return {symbol: colour for symbol, colour in found.items() if colour is not None}

    def _colour(self, material: ET.Element) -> Colour | None:
        """Return the diffuse colour of a material; None for a texture."""
        effect = material.find("instance_effect")
        if effect is None:
            return None
        common = self._target(effect).find("profile_COMMON/technique")
        for shader in _SHADERS:
            colour = None if common is None else common.find(f"{shader}/diffuse/color")
            if colour is not None:
                red, green, blue = np.clip(self._numbers(colour.text, 4)[:3], 0.0, 1.0).tolist()
                return red, green, blue
        return None

    def _geometry(self, geometry: ET.Element, tf: FloatArray, colours: dict[str, Colour]) -> Iterator[Mesh]:
        mesh = geometry.find("mesh")
        for primitive in [] if mesh is None else mesh:
            if primitive.tag in _NOT_READ:
                raise FileError(self.path, f"has <{primitive.tag}>, which is not read; export it as triangles")
            if primitive.tag in _READ and primitive.find("input") is not None:
                points, triangles = self._primitive_once(primitive)
                self._triangles += len(triangles)
                check_count(self.path, self._triangles)
                yield Mesh(apply_transform(tf, points), triangles, colours.get(primitive.get("material", "")))

    def _primitive_once(self, primitive: ET.Element) -> tuple[FloatArray, IntArray]:
        """Return points and triangles of a primitive, which many nodes may use, without points of others."""
        if id(primitive) not in self._read:
            whole = checked(self.path, Mesh(*self._primitive(primitive)))
            used, corners = np.unique(whole.triangles, return_inverse=True)
            self._read[id(primitive)] = whole.points[used], corners.astype(np.int32).reshape(-1, 3)
        return self._read[id(primitive)]

    def _primitive(self, primitive: ET.Element) -> tuple[FloatArray, IntArray]:
        inputs = primitive.findall("input")
        vertex = next((one for one in inputs if one.get("semantic") == "VERTEX"), None)
        if vertex is None:
            raise FileError(self.path, f"has <{primitive.tag}> without points")
        offsets = [self._whole(one.get("offset", "0")) for one in inputs]
        stride, offset = max(offsets) + 1, self._whole(vertex.get("offset", "0"))
        position = next((one for one in self._target(vertex, "source") if one.get("semantic") == "POSITION"), None)
        if position is None:
            raise FileError(self.path, "has vertices without positions")
        corners = [self._indices(p.text, stride)[:, offset] for p in primitive.findall("p")]
        return self._source(self._target(position, "source")), self._triangulated(primitive, corners)

    def _triangulated(self, primitive: ET.Element, corners: list[IntArray]) -> IntArray:
        """Return polygons as fans of triangles around their first corner, (m, 3)."""
        flat = np.concatenate([*corners, np.empty(0, np.int32)])
        if primitive.tag == "polygons":
            sizes = np.array([len(one) for one in corners], np.int32)
        elif primitive.tag == "polylist":
            sizes = self._indices(primitive.findtext("vcount"), 1)[:, 0]
        else:
            sizes = np.full(len(flat) // 3, 3, np.int32)
        if sizes.sum(dtype=np.int64) != len(flat) or (sizes < 0).any():
            raise FileError(self.path, f"has <{primitive.tag}> whose counts do not agree with its points")
        fans = np.maximum(sizes - 2, 0)
        check_count(self.path, int(fans.sum(dtype=np.int64)))
        first = np.repeat(np.cumsum(sizes) - sizes, fans)
        step = np.arange(len(first)) - np.repeat(np.cumsum(fans) - fans, fans)
        return np.asarray(flat[np.column_stack([first, first + step + 1, first + step + 2])], np.int32)

    def _source(self, source: ET.Element) -> FloatArray:
        array, accessor = source.find("float_array"), source.find("technique_common/accessor")
        if array is None:
            raise FileError(self.path, "has a source of positions without numbers")
        values = numbers_of(self.path, array.text)
        stride = 3 if accessor is None else self._whole(accessor.get("stride", "3"))
        start = 0 if accessor is None else self._whole(accessor.get("offset", "0"))
        if stride < 3 or len(values[start:]) % stride:
            raise FileError(self.path, "has positions whose number does not agree with their layout")
        return values[start:].reshape(-1, stride)[:, :3]

    def _indices(self, text: str | None, stride: int) -> IntArray:
        values = numbers_of(self.path, text)
        if len(values) % stride or not ((values >= 0) & (values < 2**31) & (values == np.floor(values))).all():
            raise FileError(self.path, "has a list of points that is incomplete or not made of whole numbers")
        return values.astype(np.int32).reshape(-1, stride)

    def _whole(self, text: str) -> int:
        value = self._numbers(text, 1)[0]
        if not (0 <= value < 100 and value == int(value)):
            raise FileError(self.path, f"has an offset or stride of {value:g}")
        return int(value)

    def _numbers(self, text: str | None, count: int) -> FloatArray:
        values = numbers_of(self.path, text)
        if len(values) != count or not np.isfinite(values).all():
            raise FileError(self.path, f'expected {count} finite numbers, got "{(text or "")[:80]}"')
        return values
