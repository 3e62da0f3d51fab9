"""One structure of a variogram model: its scaled distance, its correlation, and their derivatives."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.families import FAMILIES, Family

TURNS = ("rotation_x", "rotation_y", "rotation_z")


class SingleStructure:
    """The methods of a variogram model that concern its first structure alone."""

    family: str
    sill: float
    range: float | tuple[float, ...]
    shape: float | None
    rotation: tuple[float, ...] | None

    @property
    def kind(self) -> Family:
        """The first structure's entry in the table of families."""
        return FAMILIES[self.family]

    def coordinates(self, x: FloatArray) -> FloatArray:
        """Return points (n, d) in units of the first structure's ranges, along its axes: r is their plain distance."""
        if self.rotation is not None:
            x = x @ self.axes()[: x.shape[1], : x.shape[1]]
        return np.asarray(x / np.asarray(self.range, dtype=np.float64))

    def axes(self) -> FloatArray:
        """Return the axes of the first structure's ranges as columns, (d, d)."""
        d = len(np.ravel(self.range))
        if self.rotation is None:
            return np.eye(d)
        from scipy.spatial.transform import Rotation

        if d == 2 and any(self.rotation[:2]):
            raise KrigingError("a rotation of two coordinates must be about z: (0, 0, angle)")
        return Rotation.from_rotvec(self.rotation).as_matrix()[:d, :d]

    def scaled_distance(self, h: ArrayLike, direction: ArrayLike | None) -> FloatArray:
        """Return r of distances h along a direction."""
        if not isinstance(self.range, tuple):
            return np.asarray(h, dtype=np.float64) / self.range
        per_h = float(np.linalg.norm(self.coordinates(self._unit(direction)[None])))
        return np.asarray(h, dtype=np.float64) * per_h

    def correlation(self, r: FloatArray) -> FloatArray:
        """Return ρ at scaled distances r of any shape."""
        from truepose.similarity.covariance import correlation

        return correlation(self.kind.code, r, self.shape or 0.0)

    def slope_over_distance(self, r: FloatArray) -> FloatArray:
        """Return ρ'(r)/r at scaled distances r of any shape."""
        from truepose.similarity.covariance import slope_over_distance

        return slope_over_distance(self.kind.code, r, self.shape or 0.0)

    def structure_derivatives(self, h: FloatArray, direction: ArrayLike | None) -> dict[str, FloatArray]:
        """Return ∂γ/∂parameter of the first structure at distances h along a direction, by name."""
        from truepose.similarity.covariance import correlation_by_shape

        r = self.scaled_distance(h, direction)
        found = {"sill": 1 - self.correlation(r)}
        names, u, ranges = ["range"], np.ones(1), np.atleast_1d(np.asarray(self.range, dtype=np.float64))
        square = r * r
        if isinstance(self.range, tuple):
            u, square = self.coordinates(self._unit(direction)[None])[0], h * h
            names = [f"range_{k}" for k, _ in enumerate(ranges, 1)]
        moments = (-self.slope_over_distance(r) * square)[..., None, None] * np.outer(u, u)
        rates = -self.sill * self.by_logarithms(moments)
        found |= {name: rates[..., k] / ranges[k] for k, name in enumerate(names)}
        if self.rotation is not None:
            turns = TURNS[-1:] if len(ranges) == 2 else TURNS
            found |= {name: rates[..., k] for k, name in enumerate(turns, len(names))}
        if self.shape is not None:
            found["shape"] = -self.sill * correlation_by_shape(self.family, r, self.shape)
        return found

    def by_logarithms(self, moments: FloatArray) -> FloatArray:
        """Return the derivatives of Σ W ρ by the logarithms of the ranges and by the rotation vector, (…, p).

        With M = Σ W (−ρ'/r) u uᵀ, u = Rᵀh/a: by log a_k it is M_kk (their sum for one range). A small rotation ω turns
        the axes, so that ∂u = −[Rᵀω]× of u in units of the ranges, and the rotation vector φ gives ω = J(φ) dφ with
        the left Jacobian of SO(3).

        Parameters
        ----------
        moments : (…, d, d) array
            The matrix M.
        """
        diagonal = np.diagonal(moments, axis1=-2, axis2=-1)
        if not isinstance(self.range, tuple):
            return np.asarray(diagonal.sum(axis=-1, keepdims=True))
        if self.rotation is None:
            return diagonal
        d, a = diagonal.shape[-1], np.asarray(self.range)
        turned = np.zeros((*moments.shape[:-2], 3, 3))
        turned[..., :d, :d] = moments * a / a[:, None]
        across = turned - turned.swapaxes(-1, -2)
        own = np.stack([across[..., 2, 1], across[..., 0, 2], across[..., 1, 0]], axis=-1)
        by_rotation = own[..., 2:] if d == 2 else own @ (left_jacobian(np.asarray(self.rotation)).T @ self.axes()).T
        return np.concatenate([diagonal, by_rotation], axis=-1)

    def _unit(self, direction: ArrayLike | None) -> FloatArray:
        d = len(np.ravel(self.range))
        if direction is None:
            raise KrigingError(f"the variogram has {d} ranges; pass the direction of the distances")
        axis = np.asarray(direction, dtype=np.float64)
        length = np.linalg.norm(axis)
        if axis.shape != (d,) or not 0 < length < math.inf:
            raise DataError(f"direction is {axis}; expected a vector of {d} numbers that is not zero")
        return np.asarray(axis / length)


def left_jacobian(phi: FloatArray) -> FloatArray:
    """Return J with R(φ + dφ) ≈ exp(J dφ) R(φ), (3, 3). Source: T. Barfoot, State Estimation (2017), 7.1.5."""
    angle = float(np.linalg.norm(phi))
    cross = np.array([[0, -phi[2], phi[1]], [phi[2], 0, -phi[0]], [-phi[1], phi[0], 0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) + cross / 2 + cross @ cross / 6)
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)
