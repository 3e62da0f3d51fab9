"""The elementary motions that links are made of: turns, shifts and tilts by parameters, and fixed transforms."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry.transforms import axis_rotation, axis_translation

Kind = Literal["turn", "shift", "tilt", "fixed"]


class Parameter(NamedTuple):
    """A parameter of an error model.

    Attributes
    ----------
    name : str
        The name, such as "theta2", "base rz", "sin1 q3".
    unit : str
        The unit: "mm", "rad", "rad/Nm", "1/K", or "1".
    group : str
        The kind without the joint: "theta", "base", "sin1".
    """

    name: str
    unit: str
    group: str


class Motion(NamedTuple):
    """An elementary motion of a link.

    It is a "turn" about, or a "shift" along, the coordinate axis `axis` by `factor` times a parameter; a "fixed"
    transform `tf`; or a "tilt", the smallest rotation that takes z to the unit vector b (Zhuang, Roth and Hamano 1992).
    Two components of b are parameters; component `axis`, with the sign of `factor`, depends on them.
    """

    kind: Kind
    axis: int = 0
    parameters: tuple[int, ...] = ()
    factor: float = 1.0
    tf: FloatArray | None = None


def tilt(b: FloatArray) -> FloatArray:
    """Return the smallest rotations that take z to unit vectors b (…, 3): (…, 4, 4); not defined at b = −z."""
    x, y, z = np.moveaxis(b, -1, 0)
    tf = np.zeros((*b.shape[:-1], 4, 4))
    tf[..., 0, 0], tf[..., 1, 1] = 1.0 - x * x / (1.0 + z), 1.0 - y * y / (1.0 + z)
    tf[..., 0, 1] = tf[..., 1, 0] = -x * y / (1.0 + z)
    tf[..., :3, 2] = b
    tf[..., 2, 0], tf[..., 2, 1] = -x, -y
    tf[..., 3, 3] = 1.0
    return tf


def transform(motion: Motion, values: FloatArray) -> FloatArray:
    """Return the transforms of a motion at values (…, p) of all parameters: (…, 4, 4) [mm]."""
    if motion.kind == "fixed":
        assert motion.tf is not None
        return motion.tf
    if motion.kind == "tilt":
        return tilt(_direction(motion, values))
    value = motion.factor * values[..., motion.parameters[0]]
    return axis_rotation(motion.axis, value) if motion.kind == "turn" else axis_translation(motion.axis, value)


def _direction(motion: Motion, values: FloatArray) -> FloatArray:
    free = [i for i in range(3) if i != motion.axis]
    b = np.zeros((*values.shape[:-1], 3))
    b[..., free] = values[..., list(motion.parameters)]
    b[..., motion.axis] = motion.factor * np.sqrt(1.0 - (b**2).sum(axis=-1))
    return b


def local_twists(motion: Motion, values: FloatArray) -> list[tuple[int, FloatArray, FloatArray]]:
    """Return index, v and ω of each parameter of a motion, in the frame before it."""
    zero = np.zeros(3)
    if motion.kind in ("turn", "shift"):
        unit = motion.factor * np.eye(3)[motion.axis]
        pair = (zero, unit) if motion.kind == "turn" else (unit, zero)
        return [(motion.parameters[0], *pair)]
    if motion.kind == "fixed":
        return []
    b = _direction(motion, values)
    free = [i for i in range(3) if i != motion.axis]
    found = []
    for parameter, i in zip(motion.parameters, free, strict=True):
        db = np.eye(3)[i] - b[i] / b[motion.axis] * np.eye(3)[motion.axis]
        moved = cross(b, db)
        # the smallest rotation to b does not turn about b on its way from z: ω·b = −z·(b × db) / (1 + b_z)
        found.append((parameter, zero, moved - b * moved[2] / (1.0 + b[2])))
    return found


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b of two vectors; for single vectors this is faster than `numpy.cross`."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])
