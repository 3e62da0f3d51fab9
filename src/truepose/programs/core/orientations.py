"""Turn orientations in a controller's own numbers, staying as near to the old numbers as possible.

One orientation has many names: Euler angles come in pairs and repeat every 360°, a quaternion has two signs, a rotation
vector repeats every 2π along itself. The name nearest to the one in the program is written.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.geometry import ANGLES, euler

AXES: Final = {"apt z": 1.0, "apt -z": -1.0}
"""A tool axis i, j, k in place of angles: the tool's z lies along it, or against it."""
STEPS: Final = {"abb": 1e-7, "ur": 1e-6, "fanuc": 1e-3, **dict.fromkeys(AXES, 1e-7)}
"""Steps of written orientation numbers, unless a number is finer already; degrees elsewhere."""
DEGREES: Final = 1e-4
_LOCKED: Final = 1e-6  # [deg] from ±90: only the sum or difference of the outer angles is determined


def count(controller: str) -> int:
    """Return how many numbers an orientation has."""
    return 3 if controller in AXES else len(ANGLES[controller].names)


def rotation(controller: str, numbers: FloatArray) -> Rotation:
    """Return the orientations that numbers (k,) or (n, k) mean.

    A tool axis leaves the turn about itself open: the tool's x is taken as near to the frame's x as it can be.
    """
    if controller not in AXES:
        return euler(controller, numbers)
    z = AXES[controller] * np.atleast_2d(numbers) / np.linalg.norm(np.atleast_2d(numbers), axis=1)[:, None]
    along = np.abs(z[:, :1]) >= 1.0 - 1e-9
    near = np.where(along, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    x = near - z * np.einsum("ij,ij->i", near, z)[:, None]
    x /= np.linalg.norm(x, axis=1)[:, None]
    found = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2))
    return found if numbers.ndim > 1 else found[0]


def turned(controller: str, before: FloatArray, turn: Rotation) -> FloatArray:
    """Return orientation numbers after a turn, (n, k).

    Parameters
    ----------
    controller : str
        The convention of the numbers: a name of `truepose.geometry.euler`, or of `AXES`.
    before : (n, k) array
        The controller's numbers.
    turn : Rotation of length n
        The turn in the frame of the numbers: R_after = turn · R_before. Numbers with an identity turn do not change.

    Examples
    --------
    >>> turned("kuka", np.array([[190.0, 0.0, 0.0]]), Rotation.from_euler("Z", [1.0], degrees=True)).round(9)
    array([[191.,   0.,   0.]])
    """
    if controller in AXES:
        after = turn.apply(before / np.linalg.norm(before, axis=1)[:, None])
    elif ANGLES[controller].axes is not None:
        after = _angles(controller, before, turn * euler(controller, before))
    elif controller == "ur":
        after = _rotation_vector(before, turn * euler(controller, before))
    else:
        after = euler(controller, turn * euler(controller, before))
        after *= np.where(np.einsum("ij,ij->i", after, before) < 0.0, -1.0, 1.0)[:, None]
    return np.where((np.atleast_1d(turn.magnitude()) > 0.0)[:, None], after, before)


def _angles(controller: str, before: FloatArray, rotation: Rotation) -> FloatArray:
    """Return Euler angles [deg] next to those before."""
    # angles about fixed axes x, y, z are angles about moving axes z, y, x in the other order
    fixed = ANGLES[controller].axes == "xyz"
    order = slice(None, None, -1) if fixed else slice(None)
    axes = "ZYX" if fixed else ANGLES[controller].axes
    assert axes is not None
    near = before[:, order]
    first = rotation.as_euler(axes, degrees=True, suppress_warnings=True)
    locked = np.abs(np.abs(first[:, 1]) - 90.0) < _LOCKED
    if locked.any():  # keep the last angle, the first takes the whole turn
        last = Rotation.from_euler(axes[2], near[locked, 2:], degrees=True)
        first[locked] = (rotation[locked] * last.inv()).as_euler(axes, degrees=True, suppress_warnings=True)
        first[locked, 2] += near[locked, 2]
    second = np.column_stack([first[:, 0] + 180.0, 180.0 - first[:, 1], first[:, 2] + 180.0])
    names = [angles + 360.0 * np.round((near - angles) / 360.0) for angles in (first, second)]
    distance = [np.abs(angles - near).sum(axis=1) for angles in names]
    after: FloatArray = np.where((distance[0] <= distance[1])[:, None], *names)
    return after[:, order]


def _rotation_vector(before: FloatArray, rotation: Rotation) -> FloatArray:
    """Return rotation vectors [rad] next to those before."""
    vector = rotation.as_rotvec()
    length = np.linalg.norm(vector, axis=1)
    small = length < 1e-12
    along = np.where(small[:, None], before, vector)
    size = np.linalg.norm(along, axis=1)
    axis = along / np.where(size > 0.0, size, 1.0)[:, None]
    turns = np.round((np.einsum("ij,ij->i", before, axis) - length) / (2 * np.pi))
    after: FloatArray = (length + 2 * np.pi * turns)[:, None] * axis
    return after
