"""Hyperparameters of (10) with their starting values, bounds and weak priors, as one vector of logarithms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from truepose._typing import FloatArray

# centre and standard deviation of the weak normal priors of the logarithms, and bounds in standard units
_JOINT_STD: Final = (3e-4, 1.5)  # s_j [rad]
_JOINT_LENGTH: Final = (0.2, 1.0)  # l_j [rad, chord]
_TOLERANCE: Final = (1.0, 1.0)
_CONDITION: Final = (1.0, 1.5)  # the tolerance scale of a condition's effect
_NOISE: Final = (0.03, 1.5)  # mm
_REST_STD: Final = (0.1, 2.0)  # mm
_REST_RANGE: Final = (1.5, 1.0)  # rad (chord), or m
_BOUND: Final = 4.0  # prior standard deviations
_SHORTEST: Final = 0.02  # rad: the smallest joint length


@dataclass(frozen=True, eq=False)
class Hyperparameters:
    """Hyperparameters of (10).

    Attributes
    ----------
    joint_std, joint_length : (k,) arrays [rad]
        The standard deviations s_j and lengths l_j of the visible joints; lengths are chords.
    tolerance : (2 + c,) array
        The scales of the prior standard deviations of geometry, compliance, and the effects of c conditions.
    noise : float [mm]
        The standard deviation of repeatability and unknown reading noise in each direction.
    rest_std : float [mm]
        The standard deviation of Z in each direction; 0 without Z.
    rest_range : (g,) array
        The ranges of Z: chords of the joint angles [rad], and metres for the position.
    """

    joint_std: FloatArray
    joint_length: FloatArray
    tolerance: FloatArray
    noise: float
    rest_std: float
    rest_range: FloatArray

    @classmethod
    def start(cls, joints: int, ranges: int, conditions: int = 0, noise: float = 0.05) -> Self:
        """Return the starting point of a search."""
        return cls(
            joint_std=np.full(joints, _JOINT_STD[0]),
            joint_length=np.full(joints, _JOINT_LENGTH[0]),
            tolerance=np.full(2 + conditions, _TOLERANCE[0]),
            noise=noise,
            rest_std=_REST_STD[0] if ranges else 0.0,
            rest_range=np.full(ranges, _REST_RANGE[0]),
        )

    def to_vector(self) -> FloatArray:
        """Return the logarithms; those of Z come last, and only if there is Z."""
        rest = np.r_[self.rest_std, self.rest_range] if len(self.rest_range) else np.empty(0)
        return np.asarray(np.log(np.r_[self.joint_std, self.joint_length, self.tolerance, self.noise, rest]))

    def with_vector(self, theta: FloatArray) -> Hyperparameters:
        """Return the hyperparameters of a vector of logarithms; the shapes are those of `self`."""
        value, k = np.exp(theta), len(self.joint_std)
        noise = 2 * k + len(self.tolerance)
        rest = value[noise + 1 :]
        return Hyperparameters(
            value[:k],
            value[k : 2 * k],
            value[2 * k : noise],
            float(value[noise]),
            float(rest[0]) if len(rest) else 0.0,
            rest[1:],
        )

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the means and standard deviations of the priors of the logarithms."""
        k = len(self.joint_std)
        kinds = [_JOINT_STD] * k + [_JOINT_LENGTH] * k + [_TOLERANCE] * 2
        kinds += [_CONDITION] * (len(self.tolerance) - 2) + [_NOISE]
        if len(self.rest_range):
            kinds += [_REST_STD] + [_REST_RANGE] * len(self.rest_range)
        centre, std = np.array(kinds).T
        return np.log(centre), std

    def bounds(self) -> list[tuple[float, float]]:
        """Return the bounds of the logarithms."""
        centre, std = self.prior()
        low, high = centre - _BOUND * std, centre + _BOUND * std
        k = len(self.joint_std)
        low[k : 2 * k] = np.maximum(low[k : 2 * k], np.log(_SHORTEST))
        return list(zip(low.tolist(), high.tolist(), strict=True))

    @property
    def least_tolerance(self) -> FloatArray:
        """The lower bounds of `tolerance`, (2 + c,); at it, the effect of a condition is negligible."""
        first = 2 * len(self.joint_std)
        return np.asarray(np.exp(np.array(self.bounds())[first : first + len(self.tolerance), 0]))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for a file."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the hyperparameters that `to_dict` described."""
        plain: dict[str, Any] = {name: np.array(value, float) for name, value in values.items()}
        return cls(**plain | {name: float(values[name]) for name in ("noise", "rest_std")})
