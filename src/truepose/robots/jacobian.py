"""Derivatives of forward kinematics by parameters and joints, on arrays, theory (3).

A parameter that translates along the unit axis u of its frame gives the column u; one that rotates about the unit axis
w through o gives w × (P − o). The orientation rows are 0 and w. All columns follow from one walk along the chain.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.robots.chain import walk

Outputs = Literal["position", "pose"]
_ROWS: Final = {"position": 3, "pose": 6}
_FEW: Final = 64  # poses, below which the number of operations costs more than their arrays
_CHUNK: Final = 2048  # poses at once, so that frames and columns stay in the cache


def columns(theta: FloatArray, fixed: FloatArray, twists: FloatArray, outputs: Outputs = "position") -> FloatArray:
    """Return the derivative of the last frame by twists of the links.

    Parameters
    ----------
    theta : (n, dof) array [rad]
        The angles of Rz, in fixed_0 Rz(theta_1) fixed_1 … Rz(theta_dof) fixed_dof.
    fixed : (dof + 1, 4, 4) array [mm]
        The transforms between the rotations.
    twists : (dof + 1, 6, p) array
        The twist (v, ω) of each parameter in the frame of each link: after its joint has turned, the base for link 0.
    outputs : {"position", "pose"}
        The rows: position, or position and rotation vector.

    Returns
    -------
    (n, 3 or 6, p) array
        The derivative [mm] and [rad] per unit of the parameter, base frame.
    """
    rows = count_rows(outputs)
    present = np.abs(twists).sum(axis=2) > 0.0  # most twists have few components
    parts, used = twists[present], np.argwhere(present).tolist()
    rotations = [(k, i - 3) for k, i in used if i >= 3]
    turns = [row for row, (_, i) in enumerate(used) if i >= 3]
    rotated = twists[:, 3:][present[:, 3:]]
    out = np.empty((len(theta), rows, twists.shape[2]))
    memory = np.empty((len(used), 3, min(len(theta), _CHUNK)))
    for start in range(0, len(theta), _CHUNK):
        part = out[start : start + _CHUNK]
        n = len(part)
        base = np.broadcast_to(np.eye(3)[..., None], (3, 3, n)), np.zeros((3, n))
        frames = [base, *walk(theta[start : start + _CHUNK], fixed)]
        moved = memory[..., :n]
        arms = {k: frames[-1][1] - frames[k][1] for k, _ in rotations}
        moved = memory[..., :n]
        if rotations and n < _FEW:  # one product of all instead of one of each
            axes = np.stack([frames[k][0][i] for k, i in rotations], axis=1)
            moved[turns] = _cross(axes, np.stack([arms[k] for k, _ in rotations], axis=1)).transpose(1, 0, 2)
        for row, (k, i) in zip(moved, used, strict=True):
            if i < 3:
                row[:] = frames[k][0][i]
            elif n >= _FEW:
                _cross(frames[k][0][i - 3], arms[k], row)
        for c in range(3):
            np.matmul(moved[:, c].T, parts, out=part[:, c])
            if rows == 6:
                axes = np.array([frames[k][0][i, c] for k, i in rotations]).reshape(len(rotations), n)
                np.matmul(axes.T, rotated, out=part[:, 3 + c])
    return out


def joint_columns(theta: FloatArray, fixed: FloatArray, sign: FloatArray, outputs: Outputs = "position") -> FloatArray:
    """Return the derivative of the last frame by each joint: (n, 3 or 6, dof) [mm/rad] (and [rad/rad]), base frame."""
    return columns(theta, fixed, joint_twists(sign), outputs)


def joint_twists(sign: FloatArray) -> FloatArray:
    """Return the twists of the joints in the frame of each link, (dof + 1, 6, dof)."""
    dof = len(sign)
    twists = np.zeros((dof + 1, 6, dof))
    twists[np.arange(1, dof + 1), 5, np.arange(dof)] = sign  # about z, which the joint's own rotation does not move
    return twists


def count_rows(outputs: Outputs) -> int:
    """Return 3 or 6; raise `DataError` for other outputs."""
    if outputs not in _ROWS:
        raise DataError(f'unknown outputs "{outputs}"; expected "position" or "pose"')
    return _ROWS[outputs]


def _cross(axis: FloatArray, arm: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """Return axis × arm of (3, …) arrays, in `out` where it is given."""
    out = np.empty_like(axis) if out is None else out
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(axis[j], arm[k], out=out[i])
        out[i] -= axis[k] * arm[j]
    return out
