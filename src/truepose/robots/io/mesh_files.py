"""Triangle meshes from STL (binary and ASCII), OBJ and COLLADA files, which may come from anywhere.

A file is read completely or refused: a count that does not agree with the content, a corner that does not exist, and
coordinates that are not finite are errors, never a mesh with holes.
"""

from __future__ import annotations

import io
from array import array
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.robots.io.collada import read_collada
from truepose.robots.io.triangles import LARGEST_MESH, IntArray, Mesh, Numbers, check_count, checked

_HEADER: Final = 84
_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> list[Mesh]:
    """Return the meshes of a file by its ending: .stl, .obj or .dae.

    Raises
    ------
    FileError
        If the file is of another kind, damaged, too large, or holds numbers that are not finite.
    """
    readers: dict[str, Callable[[Path], list[Mesh]]] = {".stl": _read_stl, ".obj": _read_obj, ".dae": read_collada}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(path, "is no mesh that can be read; expected .stl, .obj or .dae")
    meshes = [checked(path, mesh) for mesh in reader(path)]
    if not any(len(mesh.triangles) for mesh in meshes):
        raise FileError(path, "holds no triangles")
    return meshes


def _read_stl(path: Path) -> list[Mesh]:
    data = read_bytes(path, LARGEST_MESH)
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    # a binary file may begin with "solid", too: its size decides
    if len(data) >= _HEADER and len(data) == _HEADER + count * _FACET.itemsize:
        check_count(path, count)
        corners = np.frombuffer(data, _FACET, count, _HEADER)["corners"].reshape(-1, 3)
        with np.errstate(invalid="ignore"):  # a NaN, which is refused with its point
            return [Mesh(corners.astype(np.float64), _in_order(count))]
    if data[:512].lstrip().lower().startswith(b"solid") and b"\0" not in data[:512]:
        return [_ascii_stl(path, data)]
    held = max(len(data) - _HEADER, 0) // _FACET.itemsize
    raise FileError(path, f"states {count:,} triangles, but its size is that of {held:,}: it is damaged; copy it again")


def _ascii_stl(path: Path, data: bytes) -> Mesh:
    numbers, facets = Numbers(path), 0
    for line in io.BytesIO(data):
        first, *rest = line.lower().split(maxsplit=4) or [b""]
        if first == b"vertex":
            numbers.add(rest if len(rest) == 3 else [b"?"])
        facets += first == b"endfacet"
    check_count(path, facets)
    values = numbers.array()
    if b"endsolid" not in data[-1024:].lower() or len(values) != 9 * facets:
        raise FileError(path, "is a truncated or damaged STL text; copy it again")
    return Mesh(values.reshape(-1, 3), _in_order(facets))


def _in_order(count: int) -> IntArray:
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def _read_obj(path: Path) -> list[Mesh]:
    numbers, points, triangles = Numbers(path), 0, array("i")
    for number, line in enumerate(io.BytesIO(read_bytes(path, LARGEST_MESH)), start=1):
        first, *rest = line.split() or [b""]
        if first == b"v":
            numbers.add(rest[:3] if len(rest) >= 3 else [b"?"] * 3)
            points += 1
        elif first == b"f":
            corners = _corners(path, rest, points, number)
            for pair in pairwise(corners[1:]):
                triangles.extend((corners[0], *pair))
            check_count(path, len(triangles) // 3)
    return [Mesh(numbers.array().reshape(-1, 3), np.array(triangles, np.int32).reshape(-1, 3))]


def _corners(path: Path, words: list[bytes], known: int, line: int) -> list[int]:
    """Return the points of a face, from 0: 1 is the first point of the file, −1 the last one before the face."""
    try:
        named = [int(word.split(b"/", 1)[0]) for word in words]
    except ValueError:
        raise FileError(path, "has a face whose points are not numbers", line=line) from None
    corners = [one - 1 if one > 0 else known + one for one in named]
    if min(named, key=abs, default=0) == 0 or not all(0 <= one < 2**31 for one in corners):
        raise FileError(path, "has a face with a point that does not exist", line=line)
    return corners
