"""Derivatives of forward kinematics by parameters and joints, on arrays, method.md (3).

A parameter that translates along the unit axis u of its frame gives the column u; one that rotates about the unit axis
w through o gives w × (P − o). In the orientation rows these are 0 and w. All comes from one walk along the chain.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from truepose.errors import DataError
from truepose.robots.chain import walk

FloatArray = NDArray[np.float64]

Outputs = Literal["position", "pose"]
_ROWS: Final = {"position": 3, "pose": 6}
_CHUNK: Final = 2048  # poses worked on at once: frames and columns stay in the cache


def columns(theta: FloatArray, fixed: FloatArray, twists: FloatArray, outputs: Outputs = "position") -> FloatArray:
    """Return what twists of the links do to the last frame.

    Parameters
    ----------
    theta : (n, dof) array [rad]
        Angles of Rz, in fixed_0 Rz(theta_1) fixed_1 … Rz(theta_dof) fixed_dof.
    fixed : (dof + 1, 4, 4) array [mm]
    twists : (dof + 1, 6, p) array
        For each parameter (v, ω) in the frame of each link: after its joint has turned, the base for link 0.
    outputs : {"position", "pose"}

    Returns
    -------
    (n, 3 or 6, p) array
        Rows [mm] and [rad] over the parameter's unit, base frame.
    """
    rows = count_rows(outputs)
    # only links that a parameter moves, with those parameters: most twists are zero
    moving = [(k, np.flatnonzero(np.abs(link).sum(axis=0))) for k, link in enumerate(twists)]
    moving = [(k, own) for k, own in moving if len(own)]
    out = np.empty((len(theta), rows, twists.shape[2]))
    for start in range(0, len(theta), _CHUNK):
        part = theta[start : start + _CHUNK]
        frames = _frames(part, fixed)
        p_end = frames[-1][1]
        n = len(part)
        made = np.zeros((twists.shape[2], rows, n))
        for k, own in moving:
            axes, p = frames[k]
            arm = _cross(axes, p_end - p)
            link = twists[k][:, own].T
            made[own, :3] += (link @ np.concatenate([axes, arm]).reshape(6, 3 * n)).reshape(-1, 3, n)
            if rows == 6:
                made[own, 3:] += (link[:, 3:] @ axes.reshape(3, 3 * n)).reshape(-1, 3, n)
        out[start : start + n] = made.transpose(2, 1, 0)
    return out


def joint_columns(theta: FloatArray, fixed: FloatArray, sign: FloatArray, outputs: Outputs = "position") -> FloatArray:
    """Return the derivative of the last frame by each joint: (n, 3 or 6, dof) [mm/rad] (and [rad/rad]), base frame."""
    twists = np.zeros((len(fixed), 6, len(sign)))
    for j, s in enumerate(sign):
        twists[j + 1, 5, j] = s  # about z, which the joint's own turn does not move
    return columns(theta, fixed, twists, outputs)


def end_poses(theta: FloatArray, fixed: FloatArray) -> FloatArray:
    """Return the last frame: (n, 4, 4) [mm], base frame."""
    tf = np.zeros((len(theta), 4, 4))
    tf[:, 3, 3] = 1.0
    for start in range(0, len(theta), _CHUNK):
        part = tf[start : start + _CHUNK]
        *_, (axes, p) = walk(theta[start : start + _CHUNK], fixed)
        part[:, :3, :3], part[:, :3, 3] = axes.transpose(2, 1, 0), p.T
    return tf


def count_rows(outputs: Outputs) -> int:
    """Return 3 or 6; raise `DataError` for other outputs."""
    if outputs not in _ROWS:
        raise DataError(f'outputs "{outputs}" are not known; expected "position" or "pose"')
    return _ROWS[outputs]


def _frames(theta: FloatArray, fixed: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return axes (3 axes, 3 components, n) and origin (3, n) of base, each link's frame, and the last frame."""
    n = len(theta)
    base = np.broadcast_to(np.eye(3)[..., None], (3, 3, n)), np.zeros((3, n))
    return [base, *walk(theta, fixed)]


def _cross(axes: FloatArray, arm: FloatArray) -> FloatArray:
    """Return axis × arm for (3 axes, 3, n) and (3, n)."""
    x, y, z = arm
    out = np.empty(axes.shape)
    out[:, 0] = axes[:, 1] * z - axes[:, 2] * y
    out[:, 1] = axes[:, 2] * x - axes[:, 0] * z
    out[:, 2] = axes[:, 0] * y - axes[:, 1] * x
    return out
