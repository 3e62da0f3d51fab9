"""Damped Newton from given starts, for arrays of poses: the inverse of arms without a closed form.

With r the residual in position [m] and orientation [rad] and J the geometric Jacobian, each row takes the step of
Levenberg and Marquardt, with the damping of Sugihara (2011), "Solvability-unconcerned inverse kinematics by the
Levenberg–Marquardt method", IEEE Transactions on Robotics 27:

    (Jᵀ J + |r|² I) dq = Jᵀ r,

and turns no joint by more than 0.2 rad. Steps are short where the arm is nearly singular and far from the pose, and
Newton's near the solution. |r| may grow in a step, because a nearly singular arm has to follow a curved valley.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose._io.units import MM_PER
from truepose._typing import BoolArray, FloatArray
from truepose.robots.chain import Chain, walk

REACHED_MM = 1e-9
_REACHED_RAD = 1e-11
_CONVERGED = 1e-13  # m and rad: |r| at the level of rounding
_STEP = 0.2  # rad
_STEPS = 60
_CHUNK = 4096
_TINY = np.finfo(float).tiny
_METRE = MM_PER["m"]


@dataclass(frozen=True)
class Newton:
    """The result of the iteration: joints (n, dof) [rad] and residuals (n,) [mm], [rad]."""

    q: FloatArray
    miss_mm: FloatArray
    miss_rad: FloatArray

    @property
    def reached(self) -> BoolArray:
        """Whether the pose is reached, to 1e-9 mm and 1e-11 rad: (n,)."""
        return np.asarray((self.miss_mm <= REACHED_MM) & (self.miss_rad <= _REACHED_RAD))


def damped_newton(robot: Chain, tf_base_flange: FloatArray, q_start: FloatArray, *, steps: int = _STEPS) -> Newton:
    """Return the joints near `q_start` (n, dof) [rad] of flange poses (n, 4, 4) [mm]; one start for each pose."""
    q = np.empty_like(q_start)
    miss = np.empty((len(q), 6))
    for start in range(0, len(q), _CHUNK):
        part = slice(start, start + _CHUNK)
        q[part], miss[part] = _solve(robot, tf_base_flange[part], q_start[part], steps)
    return Newton(q, _METRE * np.linalg.norm(miss[:, :3], axis=1), np.linalg.norm(miss[:, 3:], axis=1))


def _solve(robot: Chain, pose: FloatArray, start: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return the best joints found, and their residuals."""
    now, diagonal = start, np.arange(robot.dof)
    r, J = linearised(robot, pose, now)
    cost = np.einsum("ni,ni->n", r, r)
    q, miss, least = now.copy(), r.copy(), cost.copy()
    going = np.arange(len(now))
    for _ in range(steps):
        open_ = cost > _CONVERGED**2
        going, now, r, J, cost = going[open_], now[open_], r[open_], J[open_], cost[open_]
        if not len(going):
            break
        Jt = np.swapaxes(J, 1, 2)
        H = Jt @ J
        H[:, diagonal, diagonal] += np.maximum(cost, 1e-24)[:, None]
        dq = np.linalg.solve(H, Jt @ r[..., None])[..., 0]
        now = now + dq * np.minimum(1.0, _STEP / np.maximum(np.abs(dq).max(axis=1), _TINY))[:, None]
        r, J = linearised(robot, pose[going], now)
        cost = np.einsum("ni,ni->n", r, r)
        better = cost < least[going]
        rows = going[better]
        q[rows], miss[rows], least[rows] = now[better], r[better], cost[better]
    return q, miss


def linearised(robot: Chain, pose: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the residuals to flange poses, (n, 6) [m, rad] in the base frame, and the Jacobian (n, 6, dof).

    Joint j turns about z_j, the unit vector of its axis through p_j: columns z_j × (P - p_j) and z_j, theory (3).
    """
    *joints, (axes, p) = walk(robot.theta(q), robot.fixed)
    J = np.empty((len(q), 6, robot.dof))
    for j, (sign, (turned, origin)) in enumerate(zip(robot.sign, joints, strict=True)):
        z, arm = sign * turned[2], (p - origin) / _METRE
        J[:, 0, j] = z[1] * arm[2] - z[2] * arm[1]
        J[:, 1, j] = z[2] * arm[0] - z[0] * arm[2]
        J[:, 2, j] = z[0] * arm[1] - z[1] * arm[0]
        J[:, 3:, j] = z.T
    missing = np.empty((len(q), 6))
    missing[:, :3] = (pose[:, :3, 3] - p.T) / _METRE
    missing[:, 3:] = _turn_between(axes.transpose(2, 1, 0), pose[:, :3, :3])
    return missing, J


def smallest_singular(robot: Chain, q: FloatArray) -> FloatArray:
    """Return the Jacobian's smallest singular value (lengths in m) at joints (n, dof): (n,) [m/rad]; NaN at NaN."""
    sigma = np.full(len(q), np.nan)
    there = ~np.isnan(q).any(axis=1)
    if there.any():
        _, J = linearised(robot, np.broadcast_to(np.eye(4), (there.sum(), 4, 4)), q[there])
        sigma[there] = np.linalg.svd(J, compute_uv=False)[:, -1]
    return sigma


def smallest_direction(robot: Chain, q: FloatArray) -> FloatArray:
    """Return the joint motion that moves the flange least, largest entry 1, at joints (n, dof): (n, dof)."""
    _, J = linearised(robot, np.broadcast_to(np.eye(4), (len(q), 4, 4)), q)
    direction = np.linalg.svd(J)[2][:, -1]
    return np.asarray(direction / np.abs(direction).max(axis=1, keepdims=True))


def _turn_between(R: FloatArray, R_wanted: FloatArray) -> FloatArray:
    """Return the rotation vector of R_wanted Rᵀ: (n, 3) [rad]."""
    D = R_wanted @ np.swapaxes(R, 1, 2)
    sine = 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1)
    length = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(length, 0.5 * (np.einsum("nii->n", D) - 1.0))
    known = length > 1e-6  # below it the angle is 0, where sin x = x, or pi, where any axis serves for a step
    factor = np.where(known, angle / np.where(known, length, 1.0), 1.0)
    turn = factor[:, None] * sine
    turn[~known & (angle > 1.0), 0] = np.pi
    return np.asarray(turn)
