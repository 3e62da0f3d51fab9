"""What other robots of a type say of the next one: hyperparameters, tolerances and a mean error as a prior of (10).

Robots of one type come from the same drawings, gears and assembly. From the fits to some of them follow weak priors of
the hyperparameters, and a mean error: the mean of their geometry and compliance, and of each joint's curve, shrunk
by how little they agree (James and Stein 1961). Where no earlier robot was measured, the mean curves are zero. A fit
takes of it what raises the evidence of its own samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.hyperparameters import Hyperparameters, HyperPrior, Weak
from truepose.predictors.kinematic.terms import COMPLIANCE, GEOMETRY, Terms

ANGLES: Final = 1025
"""Angles of a mean curve from −π to π; every eighth of those of `truepose.predictors.kinematic.frozen.POINTS`."""
LEVELS: Final = ("nothing", "hyperparameters", "mean")
"""What a fit may take of a fleet, in steps."""
UNTRIED: Final = "untried"
"""The level before a fit."""
PAYS: Final = 2.0
"""Gain of the log evidence from which a fit takes the next step."""

_SHARED: Final = ("joint_std", "joint_length", "tolerance", "noise", "rest_std", "rest_range")
_LEAST_STD: Final = 0.3  # of a logarithm
_ONE_ROBOT: Final = 0.7  # of a logarithm: one robot does not show by how much others differ
_OWN_OF_ONE: Final = 0.7  # the own part of a robot over the whole, where one other robot is known
_LEAST_OWN: Final = 0.1


@dataclass(frozen=True, eq=False)
class Member:
    """The fit to one robot of a fleet.

    Attributes
    ----------
    name, sha256 : str
        The name of the map, and the hash of its file; "" where it was not read from one.
    hyper : Hyperparameters
        Its hyperparameters.
    joints : (k,) array of int
        The joints that these belong to.
    ranges : sequence of str
        The names of the ranges of Z.
    drift : mapping of str to float
        The estimates of geometry and compliance by name, in their units.
    curves : (dof, ANGLES) array [rad]
        The mean error of each joint at angles from −π to π.
    """

    name: str
    sha256: str
    hyper: Hyperparameters
    joints: IntArray
    ranges: Sequence[str]
    drift: Mapping[str, float]
    curves: FloatArray


@dataclass(frozen=True, eq=False)
class Fleet:
    """The prior from robots of a type, and what a fit took of it.

    Attributes
    ----------
    maps : list of dict
        The ``name`` and ``sha256`` of each map.
    weak : dict
        The centre and standard deviation of logarithms of hyperparameters; those of joints by joint.
    own : dict
        The part of a robot that is its own, as a ratio of standard deviations: of each of the ``joints`` (dof,), and of
        ``geometry`` and ``compliance``.
    drift : dict of str to float
        The mean geometry and compliance by name, in their units.
    curves : (dof, ANGLES) array [rad]
        The mean error of each joint.
    level : str
        The step of `LEVELS` that is taken.
    scale : float
        The factor of the mean error.
    gain : float
        The gain of the log evidence.
    """

    maps: list[dict[str, str]]
    weak: dict[str, Any]
    own: dict[str, Any]
    drift: dict[str, float]
    curves: FloatArray
    level: str = UNTRIED
    scale: float = 1.0
    gain: float = 0.0

    @classmethod
    def of(cls, members: Sequence[Member]) -> Self:
        """Return the prior from the fits to k robots of a type."""
        dof, k = len(members[0].curves), len(members)
        curves = np.array([one.curves for one in members])
        shrunk = [_shrunk(curves[:, j]) for j in range(dof)]
        drift: dict[str, float] = {}
        own: dict[str, Any] = {"joints": [ratio for _, ratio in shrunk]}
        for name, part in zip(("geometry", "compliance"), _parts([one.drift for one in members]), strict=True):
            values = np.array([[one.drift.get(key, 0.0) for key in part] for one in members])
            mean, own[name] = _shrunk(values / _unit(values)) if part else (np.empty(0), 1.0)
            drift |= dict(zip(part, (mean * _unit(values)).tolist() if part else [], strict=True))
        return cls(
            maps=[{"name": one.name, "sha256": one.sha256} for one in members],
            weak={name: _weak(members, name, dof, k) for name in _SHARED},
            own=own,
            drift=drift,
            curves=np.array([mean for mean, _ in shrunk]),
        )

    def prior(self, joints: IntArray, ranges: Sequence[str], plain: HyperPrior) -> HyperPrior:
        """Return the priors of the hyperparameters at this level.

        Parameters
        ----------
        joints : (k,) array of int
            The visible joints.
        ranges : sequence of str
            The names of the ranges of Z.
        plain : HyperPrior
            The priors without a fleet.
        """
        if self.level not in ("hyperparameters", "mean"):
            return plain
        own = self.level == "mean"
        changed: dict[str, Any] = {}
        for name in ("joint_std", "joint_length"):
            usual: Weak = getattr(plain, name)
            rows = np.array([_either(self.weak[name][j], usual) for j in joints]).reshape(-1, 2)
            if own and name == "joint_std":
                rows[:, 0] *= np.array(self.own["joints"])[joints]
            changed[name] = Weak(rows[:, 0], rows[:, 1])
        rows = np.array([_either(one, plain.tolerance) for one in self.weak["tolerance"]])
        if own:
            rows[:, 0] *= [self.own["geometry"], self.own["compliance"]]
        changed["tolerance"] = Weak(rows[:, 0], rows[:, 1])
        for name in ("noise", "rest_std"):
            changed[name] = Weak(*_either(self.weak[name], getattr(plain, name)))
        rows = np.array([_either(self.weak["rest_range"].get(one), plain.rest_range) for one in ranges]).reshape(-1, 2)
        if len(rows):
            changed["rest_range"] = Weak(rows[:, 0], rows[:, 1])
        return replace(plain, **changed)

    def coefficients(self, terms: Terms) -> FloatArray:
        """Return the mean geometry and compliance of the drift columns, in their units: (p,)."""
        if self.level != "mean":
            return np.zeros(len(terms.names))
        known = np.isin(terms.group, (GEOMETRY, COMPLIANCE))
        value = [self.drift.get(name, 0.0) for name in terms.names]
        return np.where(known, self.scale * np.array(value), 0.0)

    def curve(self, joint: int, angle: FloatArray) -> FloatArray:
        """Return the mean error of a joint at angles (m,) [rad], (m,) [rad]."""
        if self.level != "mean":
            return np.zeros(len(angle))
        turned = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
        return np.asarray(self.scale * np.interp(turned, np.linspace(-np.pi, np.pi, ANGLES), self.curves[joint]))

    def errors(self, design: Design, terms: Terms) -> FloatArray:
        """Return the mean errors at configurations, (n, r) [mm, rad]."""
        if self.level != "mean":
            return np.zeros(design.lever.shape[:2])
        joints = np.stack([self.curve(j, angle) for j, angle in enumerate(design.q.T)], axis=1)
        drift = design.drift @ (self.coefficients(terms) / terms.prior_std)
        return np.asarray(drift + np.einsum("naj,nj->na", design.lever, joints))

    @property
    def summary(self) -> dict[str, Any]:
        """What was taken of which maps: plain values."""
        return {"maps": self.maps, "taken": self.level, "gain": self.gain, "scale": self.scale}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for a file; a mean that is not taken is left out."""
        mean = self.level in ("mean", UNTRIED)
        return {**vars(self), "drift": self.drift if mean else {}, "curves": self.curves.tolist() if mean else []}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], dof: int) -> Self:
        """Return the fleet that `to_dict` described.

        Raises
        ------
        DataError
            If a part is missing, not finite, or of another robot.
        """
        try:
            curves = np.array(values["curves"], float).reshape(-1, ANGLES)
            found = cls(
                maps=[{key: str(one[key]) for key in ("name", "sha256")} for one in values["maps"]],
                weak=dict(values["weak"]),
                own=dict(values["own"]),
                drift={str(name): float(value) for name, value in values["drift"].items()},
                curves=curves,
                level=str(values["level"]),
                scale=float(values["scale"]),
                gain=float(values["gain"]),
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise DataError(f"the fleet has a wrong part ({error}); fit the map again with its fleet") from None
        numbers = np.r_[curves.ravel(), list(found.drift.values()), found.scale, found.gain]
        if found.level not in (*LEVELS, UNTRIED) or not np.isfinite(numbers).all() or len(curves) not in (0, dof):
            raise DataError("the fleet has impossible values, or those of another robot; fit the map again")
        if found.level in ("mean", UNTRIED) and len(curves) != dof:
            raise DataError("the fleet has no mean errors; fit the map again with its fleet")
        return found


def _either(given: Sequence[float] | None, usual: Weak) -> tuple[float, float]:
    """Return centre and standard deviation of a logarithm: the given ones, or the usual ones."""
    if given is None:
        return float(np.mean(usual.centre)), float(np.mean(usual.std))
    return float(given[0]), float(given[1])


def _parts(drift: Sequence[Mapping[str, float]]) -> tuple[list[str], list[str]]:
    """Return the names of geometry and of compliance."""
    names = list(dict.fromkeys(name for one in drift for name in one))
    masses = [name for name in names if " under " in name]
    return [name for name in names if name not in masses], masses


def _unit(values: FloatArray) -> FloatArray:
    """Return the size of each parameter over the robots, so that lengths and angles count alike."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)) + np.finfo(float).tiny)


def _shrunk(values: FloatArray) -> tuple[FloatArray, float]:
    """Return the mean of k robots' values (k, m), shrunk by how little they agree, and the ratio of own to whole."""
    k, mean = len(values), values.mean(axis=0)
    if k == 1:
        return mean, _OWN_OF_ONE
    between = float(np.mean(np.var(values, axis=0, ddof=1)))
    common = float(np.mean(mean**2))
    whole = float(np.mean(values**2))
    if common <= 0.0:
        return mean, 1.0
    share = max(0.0, 1.0 - between / k / common)
    ratio = np.sqrt(between * (1.0 + 1.0 / k) / whole) if share else 1.0
    return share * mean, float(np.clip(ratio, _LEAST_OWN, 1.0))


def _weak(members: Sequence[Member], name: str, dof: int, k: int) -> Any:
    """Return centres and standard deviations of one kind of hyperparameters over the robots."""
    if name in ("joint_std", "joint_length"):
        return [
            _of([getattr(one.hyper, name)[one.joints == j][0] for one in members if j in one.joints])
            for j in range(dof)
        ]
    if name == "tolerance":
        return [_of([one.hyper.tolerance[i] for one in members]) for i in range(2)]
    if name == "rest_range":
        ranges = list(dict.fromkeys(label for one in members for label in one.ranges))
        return {
            label: _of([one.hyper.rest_range[list(one.ranges).index(label)] for one in members if label in one.ranges])
            for label in ranges
        }
    return _of([value for one in members if (value := getattr(one.hyper, name)) > 0.0])


def _of(values: Sequence[float]) -> list[float] | None:
    """Return the geometric mean of positive values, and a standard deviation of the logarithm of another one."""
    if not values:
        return None
    logs, k = np.log(np.asarray(values, float)), len(values)
    std = _ONE_ROBOT if k == 1 else max(_LEAST_STD, float(np.std(logs, ddof=1)) * np.sqrt(1.0 + 1.0 / k))
    return [float(np.exp(logs.mean())), float(std)]
