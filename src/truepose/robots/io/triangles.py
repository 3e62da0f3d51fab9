"""Triangles of meshes, and the checks that every reader of mesh files makes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from truepose._typing import FloatArray
from truepose.errors import FileError

LARGEST_MESH: Final = 2**26
"""The largest size of a mesh file in bytes: 64 MiB."""
MOST_TRIANGLES: Final = 2_000_000
"""The largest number of triangles of one file."""
IntArray = npt.NDArray[np.int32]
Colour = tuple[float, float, float]

FARTHEST: Final = 1e9
"""Beyond this a coordinate is a mistake, whatever its unit is."""
_LONGEST: Final = 64  # letters of a number
_BATCH: Final = 1 << 18


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one colour.

    Attributes
    ----------
    points : (n, 3) array
        The corners, in the unit of the file; in m from COLLADA, which states its unit.
    triangles : (m, 3) array of int32
        The corners of each triangle, from 0.
    colour : (red, green, blue), optional
        From 0 to 1, as the file states it.
    """

    points: FloatArray
    triangles: IntArray
    colour: Colour | None = None


def checked(path: Path, mesh: Mesh) -> Mesh:
    """Return a mesh after a check of its numbers; a FileError says what is wrong."""
    check_count(path, len(mesh.triangles))
    wrong = ~(np.abs(mesh.points) < FARTHEST).all(axis=1)
    if wrong.any():
        raise FileError(path, f"point {int(np.argmax(wrong)) + 1} is not finite, or impossibly far away")
    if len(mesh.triangles) and not (mesh.triangles.min() >= 0 and mesh.triangles.max() < len(mesh.points)):
        raise FileError(path, f"names a point that does not exist; it has {len(mesh.points):,} points")
    return mesh


def check_count(path: Path, count: int) -> None:
    """Refuse more triangles than a mesh for a picture needs."""
    if count > MOST_TRIANGLES:
        limit = f"at most {MOST_TRIANGLES:,} are read"
        raise FileError(path, f"has more triangles than a picture needs ({limit}); export it in a lower resolution")


class Numbers:
    """Numbers of a text file, converted in batches: words take ten times the memory of numbers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._words: list[bytes] = []
        self._done: list[FloatArray] = []

    def add(self, words: Iterable[bytes]) -> None:
        """Append words."""
        self._words += words
        if len(self._words) > _BATCH:
            self._convert()

    def array(self) -> FloatArray:
        """Return all numbers, (n,)."""
        self._convert()
        return np.concatenate([np.empty(0), *self._done])

    def _convert(self) -> None:
        words, self._words = self._words, []
        try:
            # an array of words is as wide as the longest one
            if max(map(len, words), default=0) > _LONGEST:
                raise ValueError
            self._done.append(np.array(words, "S").astype(np.float64))
        except ValueError:
            raise FileError(self.path, "holds a coordinate or index that is not a number") from None


def numbers_of(path: Path, text: str | None) -> FloatArray:
    """Return the numbers of a text, (n,)."""
    data, found, start = (text or "").encode(), Numbers(path), 0
    while start < len(data):
        end = min(start + _BATCH, len(data))
        while end < len(data) and not data[end : end + 1].isspace():
            end += 1
        found.add(data[start:end].split())
        start = end
    return found.array()
