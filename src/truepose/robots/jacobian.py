"""Derivatives of forward kinematics by parameters and joints, on arrays, theory (3).

A parameter that translates along the unit axis u of its frame gives the column u; one that rotates about the unit axis
w through o gives w × (P − o). In the orientation rows these are 0 and w. All comes from one walk along the chain.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.robots.chain import cos_sin

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
    told = np.abs(twists).sum(axis=2) > 0.0  # most twists have few parts
    parts, used = twists[told], np.argwhere(told).tolist()
    turns = [(k, i - 3) for k, i in used if i >= 3]
    turned = twists[:, 3:][told[:, 3:]]
    out = np.empty((len(theta), rows, twists.shape[2]))
    buffers = _Buffers(len(fixed) - 1, len(used))
    for start in range(0, len(theta), _CHUNK):
        frames, moved, arm = buffers.of(len(theta[start : start + _CHUNK]))
        _walk(theta[start : start + _CHUNK], fixed, frames)
        for k in {k for k, _ in turns}:
            np.subtract(frames[-1, 3], frames[k, 3], out=arm[k])
        for row, (k, i) in zip(moved, used, strict=True):
            if i < 3:
                row[:] = frames[k, i]
            else:
                _cross(frames[k, i - 3], arm[k], row)
        part = out[start : start + _CHUNK]
        for c in range(3):  # one product for each component: it lands where it belongs
            np.matmul(moved[:, c].T, parts, out=part[:, c])
            if rows == 6:
                spun = np.array([frames[k, i, c] for k, i in turns]).reshape(len(turns), len(part))
                np.matmul(spun.T, turned, out=part[:, 3 + c])
    return out


class _Buffers:
    """Memory for one chunk after the other: frames (dof + 2, x y z origin, 3, n), columns (used, 3, n), arms."""

    def __init__(self, dof: int, used: int) -> None:
        self._shapes = (dof + 2, 4, 3), (used, 3), (dof + 2, 3)
        self._n = -1

    def of(self, n: int) -> tuple[FloatArray, ...]:
        if n != self._n:
            self._n, self._arrays = n, tuple(np.empty((*shape, n)) for shape in self._shapes)
        return self._arrays


def joint_columns(theta: FloatArray, fixed: FloatArray, sign: FloatArray, outputs: Outputs = "position") -> FloatArray:
    """Return the derivative of the last frame by each joint: (n, 3 or 6, dof) [mm/rad] (and [rad/rad]), base frame."""
    twists = np.zeros((len(fixed), 6, len(sign)))
    for j, s in enumerate(sign):
        twists[j + 1, 5, j] = s  # about z, which the joint's own turn does not move
    return columns(theta, fixed, twists, outputs)


def count_rows(outputs: Outputs) -> int:
    """Return 3 or 6; raise `DataError` for other outputs."""
    if outputs not in _ROWS:
        raise DataError(f'outputs "{outputs}" are not known; expected "position" or "pose"')
    return _ROWS[outputs]


def _walk(theta: FloatArray, fixed: FloatArray, out: FloatArray) -> None:
    """Write the frames of the base, of each joint after its turn, and the last one; as `walk`, into given memory."""
    n = len(theta)
    out[0, :3] = np.eye(3)[..., None]
    out[0, 3] = 0.0
    cos, sin = cos_sin(np.ascontiguousarray(theta.T))
    for k, link in enumerate(fixed):
        frame = out[k + 1]
        np.matmul(link[:3].T, out[k, :3].reshape(3, 3 * n), out=frame.reshape(4, 3 * n))
        frame[3] += out[k, 3]
        if k < len(cos):
            x, y = frame[0], frame[1]
            turned = cos[k] * x
            turned += sin[k] * y
            y *= cos[k]
            y -= sin[k] * x
            x[:] = turned


def _cross(axis: FloatArray, arm: FloatArray, out: FloatArray) -> None:
    """Write axis × arm of (3, n) arrays into another."""
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(axis[j], arm[k], out=out[i])
        out[i] -= axis[k] * arm[j]
