"""Derivatives of one structure's semivariance by its parameters, for fits and for standard errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.similarity import covariance as kernels
from truepose.similarity.model import VariogramModel


def structure_derivatives(part: VariogramModel, h: FloatArray, direction: ArrayLike | None) -> dict[str, FloatArray]:
    """Return ∂γ/∂parameter of a model of one structure at distances h along a direction, by name.

    With u = Rᵀh/a and r = ‖u‖: ∂γ/∂a_k = C ρ'(r)/r u_k²/a_k; a small rotation ω turns the axes, so that
    ∂u = Rᵀ(h × ω)/a, and the rotation vector φ gives ω = J(φ) dφ with the left Jacobian of SO(3).
    """
    code, shape = part.kind.code, part.shape or 0.0
    r = part._scaled(h, direction)
    rho, slope = kernels.correlation(code, r, shape), kernels.slope_over_distance(code, r, shape)
    found = {"sill": 1 - rho}
    if isinstance(part.range, tuple):
        unit = part._unit(direction)
        u = part.coordinates(unit[None])[0]
        ranges = np.asarray(part.range)
        by_range = part.sill * (slope * h * h)[..., None] * u**2 / ranges
        found |= {f"range_{k + 1}": by_range[..., k] for k in range(len(u))}
        if part.rotation is not None:
            found |= _by_rotation(part, unit, u / ranges, part.sill * slope * h * h)
    else:
        found["range"] = part.sill * slope * r * r / part.range
    if part.shape is not None:
        found["shape"] = -part.sill * correlation_by_shape(part.family, r, part.shape)
    return found


def _by_rotation(
    part: VariogramModel, unit: FloatArray, weighted: FloatArray, scale: FloatArray
) -> dict[str, FloatArray]:
    d = len(unit)
    lag = np.zeros(3)
    lag[:d] = unit
    turned = np.cross(lag, left_jacobian(np.asarray(part.rotation)).T)[:, :d] @ part._axes()
    rate = turned @ weighted
    names = ("rotation_x", "rotation_y", "rotation_z")
    return {name: -scale * rate[k] for k, name in enumerate(names) if d == 3 or k == 2}


def left_jacobian(phi: FloatArray) -> FloatArray:
    """Return J with R(φ + dφ) ≈ exp(J dφ) R(φ), (3, 3). Source: T. Barfoot, State Estimation (2017), 7.1.5."""
    angle = float(np.linalg.norm(phi))
    cross = np.array([[0, -phi[2], phi[1]], [phi[2], 0, -phi[0]], [-phi[1], phi[0], 0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) + cross / 2 + cross @ cross / 6)
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def correlation_by_shape(family: str, r: FloatArray, shape: float) -> FloatArray:
    """Return ∂ρ/∂shape at scaled distances r; Matérn's by ν in central differences of fourth order."""
    safe = np.where(r > 0, r, 1.0)
    if family == "stable":
        power = safe**shape
        return np.where(r > 0, -power * np.log(safe) * np.exp(-power), 0.0)
    if family == "power":
        return np.where(r > 0, -(safe**shape) * np.log(safe), 0.0)
    if family == "rational":
        q = r * r / (2 * shape)
        return np.asarray((q / (1 + q) - np.log1p(q)) * (1 + q) ** -shape)
    step = 2e-3 * shape
    near = kernels.matern(shape + step, r) - kernels.matern(shape - step, r)
    far = kernels.matern(shape + 2 * step, r) - kernels.matern(shape - 2 * step, r)
    return np.asarray((8 * near - far) / (12 * step))
