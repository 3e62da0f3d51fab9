"""Hyperparameters of (10) with their starting values, bounds and weak priors, as one vector of logarithms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, Self

import numpy as np

from truepose._typing import FloatArray

_BOUND: Final = 4.0  # prior standard deviations
_DECIMALS: Final = 5
_NEIGHBOURS: Final = 0.5  # the quantile of the distances of angles to their nearest neighbour
_SHORTEST: Final = (0.003, 0.02)  # rad: the range of the smallest joint lengths; the larger one without data


class Weak(NamedTuple):
    """A weak normal prior of a logarithm: the centre of the value itself, and the standard deviation of its logarithm.

    Both are one number for all joints (conditions, ranges), or one for each.
    """

    centre: float | FloatArray
    std: float | FloatArray


_JOINT_STD: Final = Weak(3e-4, 1.5)
_JOINT_LENGTH: Final = Weak(0.2, 1.2)
_TOLERANCE: Final = Weak(1.0, 1.0)
_CONDITION: Final = Weak(1.0, 1.5)
_NOISE: Final = Weak(0.03, 1.5)
_REST_STD: Final = Weak(0.1, 2.0)
_REST_RANGE: Final = Weak(1.5, 1.0)


@dataclass(frozen=True, eq=False)
class HyperPrior:
    """The weak priors of `Hyperparameters`, and the bounds of a search.

    Attributes
    ----------
    joint_std, joint_length : Weak [rad]
        Those of s_j and l_j. Robots that were measured show lengths from 0.02 rad; those of smooth gears reach 0.6.
    tolerance, condition : Weak
        Those of the tolerance scales of geometry and compliance, and of the other effects.
    noise, rest_std : Weak [mm]
        Those of the noise and of the standard deviation of Z.
    rest_range : Weak [rad, m]
        That of the ranges of Z.
    shortest : float or (k,) array [rad]
        The lower bounds of the lengths l_j.
    """

    joint_std: Weak = _JOINT_STD
    joint_length: Weak = _JOINT_LENGTH
    tolerance: Weak = _TOLERANCE
    condition: Weak = _CONDITION
    noise: Weak = _NOISE
    rest_std: Weak = _REST_STD
    rest_range: Weak = _REST_RANGE
    shortest: float | FloatArray = _SHORTEST[1]

    def for_angles(self, q: FloatArray) -> HyperPrior:
        """Return the prior with the shortest lengths that samples at angles q (n, k) [rad] can tell.

        These are the median distances of an angle to its nearest neighbour, within 0.003 and 0.02 rad; angles that are
        equal to rounding count once.

        Examples
        --------
        >>> HyperPrior().for_angles(np.linspace(-1, 1, 201)[:, None]).shortest
        array([0.01])
        """
        return replace(self, shortest=np.array([np.clip(_spacing(angle), *_SHORTEST) for angle in q.T]))


def _spacing(angle: FloatArray) -> float:
    """Return the median distance of angles (n,) [rad] to their nearest neighbour on the circle."""
    known = np.unique(np.round(np.mod(angle, 2.0 * np.pi), _DECIMALS))
    if len(known) < 3:
        return np.inf
    gap = np.diff(known, append=known[0] + 2.0 * np.pi)
    return float(np.quantile(np.minimum(gap, np.roll(gap, 1)), _NEIGHBOURS))


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
    weak : HyperPrior
        Their priors and the bounds of a search; files do not keep it.
    """

    joint_std: FloatArray
    joint_length: FloatArray
    tolerance: FloatArray
    noise: float
    rest_std: float
    rest_range: FloatArray
    weak: HyperPrior = field(default_factory=HyperPrior)

    @classmethod
    def start(
        cls, joints: int, ranges: int, conditions: int = 0, noise: float = 0.05, weak: HyperPrior | None = None
    ) -> Self:
        """Return the starting point of a search: the centres of the priors, and of the noise 0.05 mm."""
        weak = HyperPrior() if weak is None else weak
        return cls(
            joint_std=np.full(joints, weak.joint_std.centre),
            joint_length=np.full(joints, weak.joint_length.centre),
            tolerance=np.r_[np.full(2, weak.tolerance.centre), np.full(conditions, weak.condition.centre)],
            noise=noise,
            rest_std=float(weak.rest_std.centre) if ranges else 0.0,
            rest_range=np.full(ranges, weak.rest_range.centre),
            weak=weak,
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
            self.weak,
        )

    def names(self, joints: Sequence[int], groups: Sequence[str], ranges: Sequence[str]) -> list[str]:
        """Return the names of the logarithms of `to_vector`.

        Parameters
        ----------
        joints : sequence of int
            The visible joints, counted from 0.
        groups : sequence of str
            The kinds of drift columns with a tolerance scale.
        ranges : sequence of str
            The ranges of Z.

        Examples
        --------
        >>> Hyperparameters.start(1, 0, 1).names([3], ["geometry", "compliance", "backlash"], [])[2:]
        ['tolerance of geometry', 'tolerance of compliance', 'tolerance of backlash', 'noise']
        """
        numbers = [int(joint) + 1 for joint in joints]
        names = [f"std of joint {number}" for number in numbers] + [f"length of joint {number}" for number in numbers]
        names += [*(f"tolerance of {group}" for group in groups), "noise"]
        return names + (["std of the rest", *(f"range of {name}" for name in ranges)] if len(self.rest_range) else [])

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the means and standard deviations of the priors of the logarithms."""
        k, weak = len(self.joint_std), self.weak
        kinds = [(weak.joint_std, k), (weak.joint_length, k), (weak.tolerance, 2)]
        kinds += [(weak.condition, len(self.tolerance) - 2), (weak.noise, 1)]
        if len(self.rest_range):
            kinds += [(weak.rest_std, 1), (weak.rest_range, len(self.rest_range))]
        centre = np.concatenate([np.full(count, one.centre) for one, count in kinds])
        return np.log(centre), np.concatenate([np.full(count, one.std) for one, count in kinds])

    def bounds(self) -> list[tuple[float, float]]:
        """Return the bounds of the logarithms."""
        centre, std = self.prior()
        low, high = centre - _BOUND * std, centre + _BOUND * std
        k = len(self.joint_std)
        low[k : 2 * k] = np.log(self.weak.shortest)
        return list(zip(low.tolist(), high.tolist(), strict=True))

    @property
    def least_tolerance(self) -> FloatArray:
        """The lower bounds of `tolerance`, (2 + c,); at it, the effect of a condition is negligible."""
        first = 2 * len(self.joint_std)
        return np.asarray(np.exp(np.array(self.bounds())[first : first + len(self.tolerance), 0]))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for a file."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items() if name != "weak"}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the hyperparameters that `to_dict` described."""
        plain: dict[str, Any] = {name: np.array(value, float) for name, value in values.items()}
        return cls(**plain | {name: float(values[name]) for name in ("noise", "rest_std")})
