"""The parametrisation of a variogram of one or several structures, which all fits share.

A search works on a vector θ: logarithms of ranges, of shapes and of the sills after the first (in units of the first),
and rotation vectors. The names are those of `VariogramModel.derivatives`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.model import VariogramModel
from truepose.similarity.structure import FAMILIES, TURNS, check_shape, family_named

RANGES: Final = ("one", "each", "rotated")
SHAPES: Final = (0.1, 20.0)
"""Bounds of a shape in θ."""
SILLS: Final = (1e-4, 1e4)
"""Bounds of a sill in units of the first."""
TURN: Final = 2 * math.pi
"""Bound of each number of a rotation vector."""
UNEQUAL: Final = (1.6, 1.0, 0.6)
"""Ranges of a start along turned axes: equal ones would not feel a turn."""


@dataclass(frozen=True)
class Parametrisation:
    """The parameters of a model, as a vector θ.

    Parameters
    ----------
    families : tuple of str
        The family of each structure; families with a sill.
    ranges : {"one", "each", "rotated"}
        One range for each structure, one for each coordinate, or one for each axis of a rotation.
    dimensions : int
        The number of coordinates d.
    shape : float, optional
        The shape of the families that have one; a part of θ when not given.
    """

    families: tuple[str, ...]
    ranges: str
    dimensions: int
    shape: float | None = None

    @classmethod
    def of(cls, name: str, ranges: str, dimensions: int, shape: float | None = None) -> Parametrisation:
        """Return the parametrisation of a name such as "spherical" or "spherical+exponential".

        Raises
        ------
        KrigingError
            If a family is not known, has no sill or range, or is not valid in so many coordinates.
        """
        families = tuple(part.strip() for part in name.split("+"))
        for family in families:
            kind = family_named(family)
            if not kind.bounded or kind.practical == 0:
                usable = ", ".join(other for other, k in FAMILIES.items() if k.bounded and k.practical != 0)
                raise KrigingError(
                    f"variogram family {family!r} cannot be fitted in this way; use families with a sill: {usable}"
                )
            if shape is not None and (kind.shape is not None or len(families) == 1):
                check_shape(family, shape)
            if kind.dimensions < dimensions:
                raise KrigingError(
                    f"a {family} variogram is valid in up to {kind.dimensions} coordinates, but x has {dimensions}; "
                    "use exponential, gaussian, matern32 or matern52"
                )
        if ranges not in RANGES:
            raise DataError(f"ranges is {ranges!r}; expected one of {', '.join(RANGES)}")
        if ranges == "rotated" and dimensions not in (2, 3):
            raise KrigingError(f"ranges='rotated' needs 2 or 3 coordinates, but there are {dimensions}; use 'each'")
        return cls(families, ranges, dimensions, shape)

    @property
    def axes(self) -> int:
        """Number of ranges of one structure."""
        return 1 if self.ranges == "one" else self.dimensions

    @property
    def turns(self) -> tuple[str, ...]:
        """Names of the numbers of a rotation vector in θ."""
        if self.ranges != "rotated":
            return ()
        return TURNS[-1:] if self.dimensions == 2 else TURNS

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers in θ."""
        ranges = ("range",) if self.ranges == "one" else tuple(f"range_{k + 1}" for k in range(self.axes))
        names: list[str] = []
        for k, family in enumerate(self.families, 1):
            own = (*ranges, *self.turns, *(("shape",) if self._free(family) else ()), *(("sill",) if k > 1 else ()))
            names += own if k == 1 else [f"{name}_of_{k}" for name in own]
        return tuple(names)

    def parts(self, theta: FloatArray) -> list[VariogramModel]:
        """Return each structure as a model without nugget, in units of the first one's sill."""
        values = iter(theta.tolist())
        parts = []
        for k, family in enumerate(self.families):
            ranges = tuple(math.exp(next(values)) for _ in range(self.axes))
            turn = tuple(next(values) for _ in self.turns)
            shape = math.exp(next(values)) if self._free(family) else self._given(family)
            parts.append(
                VariogramModel(
                    family,
                    sill=math.exp(next(values)) if k else 1.0,
                    range=ranges[0] if self.ranges == "one" else ranges,
                    rotation=(0.0, 0.0, 0.0)[len(turn) :] + turn if turn else None,
                    shape=shape,
                )
            )
        return parts

    def model(self, theta: FloatArray, nugget: float, sill: float) -> VariogramModel:
        """Return the whole model, with the sill of its first structure [mm²]."""
        first, *rest = (part.scaled(sill) for part in self.parts(theta))
        return replace(first, nugget=nugget, plus=tuple(rest))

    def bounds(self, low: FloatArray, high: FloatArray) -> list[tuple[float, float]]:
        """Return the bounds of θ, given those of the practical ranges along each axis, (axes,)."""
        bounds: list[tuple[float, float]] = []
        for k, family in enumerate(self.families):
            practical = self.practical(family)
            bounds += zip(np.log(low / practical).tolist(), np.log(high / practical).tolist(), strict=True)
            bounds += [(-TURN, TURN)] * len(self.turns)
            if self._free(family):
                most = FAMILIES[family].shape
                assert most is not None
                bounds.append((math.log(SHAPES[0]), math.log(min(most.most, SHAPES[1]))))
            bounds += [(math.log(SILLS[0]), math.log(SILLS[1]))] * (k > 0)
        return bounds

    def start(self, practical: FloatArray, spread: float = 0.2) -> FloatArray:
        """Return θ with practical ranges of the last structure along each axis, (axes,); those before are shorter."""
        theta: list[float] = []
        for k, family in enumerate(self.families):
            reach = practical * spread ** (len(self.families) - 1 - k)
            theta += np.log(reach / self.practical(family)).tolist()
            theta += [0.0] * (len(self.turns) + self._free(family) + (k > 0))
        return np.array(theta)

    def turned(self, theta: FloatArray) -> Iterator[FloatArray]:
        """Yield starts with unequal ranges, along the coordinates and at 45 degrees to them."""
        if not self.turns:
            yield theta
            return
        d, names = self.dimensions, self.names
        ranges = np.array([name.startswith("range") for name in names])
        ratio = np.tile(np.log(UNEQUAL[:d]), len(self.families))
        for shift in range(d):
            start = theta.copy()
            start[ranges] += np.roll(ratio.reshape(-1, d), shift, axis=1).ravel()
            yield start
        for turn in self.turns:
            start[[name.startswith(turn) for name in names]] = math.pi / 4
            yield start.copy()
            start[[name.startswith(turn) for name in names]] = 0.0

    def _free(self, family: str) -> bool:
        return FAMILIES[family].shape is not None and self.shape is None

    def _given(self, family: str) -> float | None:
        return self.shape if FAMILIES[family].shape is not None else None

    def practical(self, family: str) -> float:
        """Return the practical range of a family in units of its range; at shape 1 where the shape is free."""
        return FAMILIES[family].practical_range(1.0 if self._free(family) else self.shape)
