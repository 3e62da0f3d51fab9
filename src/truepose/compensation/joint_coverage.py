"""Find the angles of each joint that no sample covers at the scale of that joint's own error (theory, compensation).

The standard deviation of a map assumes that the error of a joint is as large where nothing was measured as where it
was. This cannot be known from samples elsewhere, so such angles are refused whatever the standard deviation is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray

_LENGTHS: Final = 4.0
"""Distance in lengths at which a sample says nothing more: Matérn 3/2 correlates by less than 0.01 there."""
_FARTHEST: Final = float(np.deg2rad(45.0))
"""Distance beyond which no sample covers, however long the length: a length is known where samples are."""
_MARGIN: Final = 2.5
"""Multiple of the usual spacing that counts as covered: of angles at random, e⁻⁷·⁵ are farther from a sample."""
_USUAL: Final = 0.95
_TURN: Final = 2.0 * np.pi
_PAIRS: Final = 3
"""Samples that must stand near another one a full turn away, before such samples count."""


@dataclass(frozen=True)
class Gap:
    """Angles of a joint that no sample covers.

    Attributes
    ----------
    joint : int
        The joint, counted from 0.
    low, high : float [rad]
        The ends of the gap: angles of samples.
    uncovered_low, uncovered_high : float [rad]
        The angles in the gap that are farther from a sample than the limit.
    measure : float [rad]
        The angle at which a sample covers most.
    """

    joint: int
    low: float
    high: float
    uncovered_low: float
    uncovered_high: float
    measure: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values; joints count from 1, angles are in degrees."""
        degrees = {
            f"{name}_deg": round(float(np.rad2deg(value)), 3) for name, value in vars(self).items() if name != "joint"
        }
        return {"joint": self.joint + 1, **degrees}


class JointCoverage:
    """The angles of each joint that samples cover.

    Parameters
    ----------
    q : (n, dof) array [rad]
        The joints of the samples.
    joints : (k,) array of int
        The joints with an error of their own, counted from 0.
    length : (k,) array [rad]
        The length of each of these errors.
    limit : float [rad], optional
        The distance to a sample within which an angle is covered, of all joints; default: see the notes.

    Notes
    -----
    An angle is covered if a sample is within four lengths of the joint's error and 45°, or within 2.5 times the 95th
    percentile of the spacing (the distance of each sample to its nearest neighbour in this joint), whichever is larger.

    The error of a joint is modelled as periodic, but motor and cables stand differently a turn later. Therefore +179°
    and −179° are 358° apart, unless three samples stand within the limit of one a full turn away: then the samples show
    whether both turns agree, and a sample a turn away covers, too.

    Examples
    --------
    >>> q = np.deg2rad([*range(-100, 1, 2), 60.0])[:, None]
    >>> (gap,) = JointCoverage(q, np.array([0]), np.array([0.1])).gaps()
    >>> [round(float(angle)) for angle in np.rad2deg([gap.low, gap.high])]
    [0, 60]
    """

    def __init__(self, q: FloatArray, joints: IntArray, length: FloatArray, limit: float | None = None) -> None:
        self.joints = np.asarray(joints, np.int64)
        self.angles = [np.sort(q[:, j]) for j in self.joints]
        self.length = np.asarray(length, float)
        spacing = np.array([_usual_spacing(angle) for angle in self.angles])
        found = np.maximum(np.minimum(_LENGTHS * self.length, _FARTHEST), _MARGIN * spacing)
        self.limit: FloatArray = found if limit is None else np.full(len(found), limit)
        self.periodic = []
        for i, angle in enumerate(self.angles):
            self.periodic.append(bool(self._near_a_turn_away(i, angle).sum() >= _PAIRS))
            if self.periodic[i]:
                self.angles[i] = np.concatenate([angle - _TURN, angle, angle + _TURN])
                self.angles[i].sort()

    def _near_a_turn_away(self, i: int, angle: FloatArray) -> NDArray[np.bool_]:
        """Return which of (m,) angles are within the limit of a sample a full turn away."""
        gap = [np.abs(angle + turn - self.nearest(i, angle + turn)) for turn in (-_TURN, _TURN)]
        return np.asarray(np.minimum(*gap) <= self.limit[i])

    def nearest(self, i: int, angle: FloatArray) -> FloatArray:
        """Return the angle of the sample nearest to each of (m,) angles of the i-th of these joints, (m,) [rad]."""
        known = self.angles[i]
        after = np.clip(np.searchsorted(known, angle), 1, len(known) - 1) if len(known) > 1 else np.zeros(1, np.int64)
        before = np.maximum(after - 1, 0)
        return np.where(angle - known[before] <= known[after] - angle, known[before], known[after])

    def reasons(self, q: FloatArray) -> list[str]:
        """Return the reason why a joint of each of (m, dof) configurations is not covered, or an empty string."""
        reasons = [""] * len(q)
        worst = np.ones(len(q))
        for i, j in enumerate(self.joints.tolist()):
            nearest = self.nearest(i, q[:, j])
            excess = np.abs(q[:, j] - nearest) / self.limit[i]
            for row in np.flatnonzero(excess > worst).tolist():
                reasons[row] = self._reason(i, float(q[row, j]), float(nearest[row]))
            worst = np.maximum(worst, excess)
        return reasons

    def _reason(self, i: int, angle: float, nearest: float) -> str:
        name = f"joint {self.joints[i] + 1}"
        at, near, limit = (f"{np.rad2deg(value):.1f}°" for value in (angle, nearest, self.limit[i]))
        turn = ""
        if self._near_a_turn_away(i, np.array([angle]))[0]:
            turn = "; samples a full turn away do not count, since none shows that both turns agree"
        return (
            f"no sample covers {name} at {at}: the nearest has {name} at {near}, limit {limit}{turn}; "
            f"measure a pose with {name} near {np.rad2deg(angle):.0f}°"
        )

    def gaps(self) -> list[Gap]:
        """Return the gaps between samples, by joint and angle."""
        found = []
        for i, j in enumerate(self.joints.tolist()):
            limit, known = float(self.limit[i]), self.angles[i]
            if self.periodic[i]:  # once around, from one sample to the same one a turn later
                known = known[(known >= 0.0) & (known < _TURN)]
                known = np.r_[known, known[:1] + _TURN]
            for k in np.flatnonzero(np.diff(known) > 2.0 * limit).tolist():
                start, end = float(known[k]), float(known[k + 1])
                found.append(Gap(j, start, end, start + limit, end - limit, 0.5 * (start + end)))
        return found


def _usual_spacing(angle: FloatArray) -> float:
    """Return the distance to its nearest neighbour that 95 % of sorted angles (n,) keep [rad]."""
    if len(angle) < 2:
        return 0.0
    step = np.diff(angle)
    nearest = np.minimum(np.r_[np.inf, step], np.r_[step, np.inf])
    return float(np.quantile(nearest, _USUAL))
