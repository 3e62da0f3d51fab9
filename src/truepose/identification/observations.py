"""Observations of an arm: positions, full poses or distances, and their residuals for an arm with changes x."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.identification.arm import ParametricArm


class Observations(Protocol):
    """A series of n observations of k numbers each."""

    @property
    def kind(self) -> IntArray:
        """The group of each of the k numbers, from 0; a group has one unit and one misfit: (k,)."""

    @property
    def covariance(self) -> FloatArray:
        """The covariances of the readings: (n, k, k)."""

    def __len__(self) -> int: ...

    def one(self, i: int) -> Self:
        """Return observation i alone."""

    def residual(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return measured minus predicted: (n, k)."""

    def jacobian(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return the derivative of the prediction by x: (n, k, p)."""

    def residuals_of(self, arm: ParametricArm, i: int, many: FloatArray) -> FloatArray:
        """Return the residuals of observation i for many changes (s, p): (s, k)."""


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of the tool point.

    Attributes
    ----------
    q : (n, dof) array [rad]
        The commanded joints.
    p : (n, 3) array [mm], base frame
        The measured positions after registration.
    covariance : (n, 3, 3) array [mm²], base frame
        The covariances of the readings; zero where unknown, as the misfit is estimated.
    approach : (n, dof) array of -1, 0, +1, optional
        The signs of the last motion of each joint.
    r : (n, 3) array [mm], tool frame, optional
        The measured points; by default the tool point.
    """

    q: FloatArray
    p: FloatArray
    covariance: FloatArray
    approach: FloatArray | None = None
    r: FloatArray | None = None

    kind = np.zeros(3, dtype=np.intp)

    def __len__(self) -> int:
        return len(self.q)

    def one(self, i: int) -> Self:
        """Return observation i alone."""
        approach, r = (None if values is None else values[[i]] for values in (self.approach, self.r))
        return replace(self, q=self.q[[i]], p=self.p[[i]], covariance=self.covariance[[i]], approach=approach, r=r)

    def predicted(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return the positions of the points: (n, 3) [mm]."""
        return _points(arm.pose(self.q, x, self.approach), self.r)

    def residual(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return measured minus predicted positions: (n, 3) [mm]."""
        return np.asarray(self.p - self.predicted(arm, x))

    def jacobian(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return the derivative of the positions: (n, 3, p)."""
        if self.r is None:
            return arm.jacobian(self.q, x, self.approach)
        columns, tf = arm.jacobian(self.q, x, self.approach, outputs="pose"), arm.pose(self.q, x, self.approach)
        lever = np.einsum("nij,nj->ni", tf[:, :3, :3], self.r)
        return np.asarray(columns[:, :3] + np.cross(columns[:, 3:], lever[:, :, None], axis=1))

    def residuals_of(self, arm: ParametricArm, i: int, many: FloatArray) -> FloatArray:
        """Return the residuals of one position: (s, 3) [mm]."""
        r = None if self.r is None else np.broadcast_to(self.r[i], (len(many), 3))
        return np.asarray(self.p[i] - _points(arm.poses_of(self.q[i], many, _row(self.approach, i)), r))


@dataclass(frozen=True, eq=False)
class PoseObservations:
    """Full poses; residuals are position and rotation vector from predicted to measured orientation, base frame.

    Attributes
    ----------
    q : (n, dof) array [rad]
        The commanded joints.
    tf : (n, 4, 4) array [mm], base frame
        The measured poses after registration.
    covariance : (n, 6, 6) array [mm²], [mm rad], [rad²]
        The covariances of the readings.
    approach : (n, dof) array of -1, 0, +1, optional
        The signs of the last motion of each joint.
    """

    q: FloatArray
    tf: FloatArray
    covariance: FloatArray
    approach: FloatArray | None = None

    kind = np.array([0, 0, 0, 1, 1, 1], dtype=np.intp)

    def __len__(self) -> int:
        return len(self.q)

    def one(self, i: int) -> Self:
        """Return observation i alone."""
        approach = None if self.approach is None else self.approach[[i]]
        return replace(self, q=self.q[[i]], tf=self.tf[[i]], covariance=self.covariance[[i]], approach=approach)

    def residual(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return measured minus predicted poses: (n, 6) [mm], [rad]."""
        return _pose_difference(self.tf, arm.pose(self.q, x, self.approach))

    def jacobian(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return the derivative of the poses: (n, 6, p)."""
        return arm.jacobian(self.q, x, self.approach, outputs="pose")

    def residuals_of(self, arm: ParametricArm, i: int, many: FloatArray) -> FloatArray:
        """Return the residuals of one pose: (s, 6) [mm], [rad]."""
        return _pose_difference(self.tf[i], arm.poses_of(self.q[i], many, _row(self.approach, i)))


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances between positions of the tool point in pairs of configurations; the tracker's station is not needed.

    Attributes
    ----------
    q : (n, dof) array [rad]
        The commanded joints.
    pairs : (m, 2) int array
        The rows of q that form each pair.
    distance : (m,) array [mm]
        The measured distances.
    covariance : (m, 1, 1) array [mm²]
        The variances of the distances.
    approach : (n, dof) array of -1, 0, +1, optional
        The signs of the last motion of each joint.
    """

    q: FloatArray
    pairs: IntArray
    distance: FloatArray
    covariance: FloatArray
    approach: FloatArray | None = None

    kind = np.zeros(1, dtype=np.intp)

    def __len__(self) -> int:
        return len(self.pairs)

    def one(self, i: int) -> Self:
        """Return observation i alone."""
        approach = None if self.approach is None else self.approach[self.pairs[i]]
        return replace(
            self,
            q=self.q[self.pairs[i]],
            pairs=np.array([[0, 1]]),
            distance=self.distance[[i]],
            covariance=self.covariance[[i]],
            approach=approach,
        )

    def residual(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return measured minus predicted distances: (m, 1) [mm]."""
        p = arm.pose(self.q, x, self.approach)[:, :3, 3]
        length = np.linalg.norm(p[self.pairs[:, 0]] - p[self.pairs[:, 1]], axis=1)
        return np.asarray((self.distance - length)[:, None])

    def jacobian(self, arm: ParametricArm, x: FloatArray) -> FloatArray:
        """Return the derivative of the distances: (m, 1, p)."""
        p = arm.pose(self.q, x, self.approach)[:, :3, 3]
        between = p[self.pairs[:, 0]] - p[self.pairs[:, 1]]
        unit = between / np.linalg.norm(between, axis=1, keepdims=True)
        columns = arm.jacobian(self.q, x, self.approach)
        moved = columns[self.pairs[:, 0]] - columns[self.pairs[:, 1]]
        return np.asarray(np.einsum("mi,mip->mp", unit, moved)[:, None])

    def residuals_of(self, arm: ParametricArm, i: int, many: FloatArray) -> FloatArray:
        """Return the residuals of one distance: (s, 1) [mm]."""
        a, b = (arm.poses_of(self.q[j], many, _row(self.approach, j))[:, :3, 3] for j in self.pairs[i])
        return np.asarray((self.distance[i] - np.linalg.norm(a - b, axis=1))[:, None])


def _points(tf: FloatArray, r: FloatArray | None) -> FloatArray:
    """Return points r (n, 3) [mm] of the tool, or its point, at poses (n, 4, 4): (n, 3) [mm]."""
    p = tf[:, :3, 3]
    return np.asarray(p if r is None else p + np.einsum("nij,nj->ni", tf[:, :3, :3], r))


def _row(approach: FloatArray | None, i: int) -> FloatArray | None:
    return None if approach is None else approach[i]


def _pose_difference(measured: FloatArray, predicted: FloatArray) -> FloatArray:
    turn = measured[..., :3, :3] @ np.swapaxes(predicted[:, :3, :3], -1, -2)
    return np.concatenate([measured[..., :3, 3] - predicted[:, :3, 3], Rotation.from_matrix(turn).as_rotvec()], axis=1)
