"""Rigid transforms as arrays (…, 4, 4) [mm].

`tf_A_B` maps coordinates in frame B to frame A, so that inner letters cancel:
`tf_base_tool = tf_base_flange @ tf_flange_tool`; `p_base = apply_transform(tf_base_tool, p_tool)`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry.arrays import as_floats, check_finite, name_rows

_ROUNDING = 1e-4  # of rotation entries: poses with five digits pass, sheared or scaled ones do not


def make_transform(rotation: Rotation | ArrayLike | None = None, translation: ArrayLike | None = None) -> FloatArray:
    """Return the transforms of rotations and translations.

    Parameters
    ----------
    rotation : Rotation or (…, 3, 3) array, optional
        The rotations; the identity when not given.
    translation : (…, 3) array [mm], optional
        The translations; zero when not given.

    Returns
    -------
    (…, 4, 4) array [mm]

    Examples
    --------
    >>> make_transform(translation=[1.0, 2.0, 3.0])[:3, 3]
    array([1., 2., 3.])
    """
    if rotation is None:
        matrix = np.eye(3)
    else:
        matrix = as_floats("rotation", rotation.as_matrix() if isinstance(rotation, Rotation) else rotation)
    p = np.zeros(3) if translation is None else as_floats("translation", translation)
    if matrix.shape[-2:] != (3, 3) or p.shape[-1:] != (3,):
        raise DataError(f"expected rotation (…, 3, 3) and translation (…, 3), got {matrix.shape} and {p.shape}")
    tf = np.zeros((*np.broadcast_shapes(matrix.shape[:-2], p.shape[:-1]), 4, 4))
    tf[..., :3, :3] = matrix
    tf[..., :3, 3] = p
    tf[..., 3, 3] = 1.0
    return tf


def axis_rotation(axis: int, angle: ArrayLike) -> FloatArray:
    """Return the rotations by angles (…) [rad] about a coordinate axis (0, 1 or 2 for x, y or z): (…, 4, 4).

    Examples
    --------
    >>> axis_rotation(2, 0.5 * np.pi)[:3, 0].round(6) + 0.0
    array([0., 1., 0.])
    """
    angle = as_floats("angle", angle)
    tf = np.zeros((*angle.shape, 4, 4))
    tf[..., :, :] = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    tf[..., i, i] = tf[..., j, j] = np.cos(angle)
    tf[..., j, i] = np.sin(angle)
    tf[..., i, j] = -tf[..., j, i]
    return tf


def axis_translation(axis: int, length: ArrayLike) -> FloatArray:
    """Return the translations by lengths (…) [mm] along a coordinate axis (0, 1 or 2 for x, y or z): (…, 4, 4).

    Examples
    --------
    >>> axis_translation(1, 5.0)[:3, 3]
    array([0., 5., 0.])
    """
    length = as_floats("length", length)
    tf = np.zeros((*length.shape, 4, 4))
    tf[..., :, :] = np.eye(4)
    tf[..., axis, 3] = length
    return tf


def invert_transform(tf_a_b: FloatArray) -> FloatArray:
    """Return tf_b_a, by transposition of the rotation, for an array (…, 4, 4) [mm].

    Examples
    --------
    >>> invert_transform(make_transform(translation=[1.0, 2.0, 3.0]))[:3, 3]
    array([-1., -2., -3.])
    """
    tf_b_a = np.zeros_like(tf_a_b)
    rotation_b_a = np.swapaxes(tf_a_b[..., :3, :3], -1, -2)
    tf_b_a[..., :3, :3] = rotation_b_a
    tf_b_a[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation_b_a, tf_a_b[..., :3, 3])
    tf_b_a[..., 3, 3] = 1.0
    return tf_b_a


def apply_transform(tf_a_b: FloatArray, p_b: FloatArray) -> FloatArray:
    """Return points given in frame B as points in frame A: (…, 4, 4) and (…, 3) [mm] give (…, 3) [mm].

    Leading axes broadcast: one transform on n points, or n transforms on one point or on n points.

    Examples
    --------
    >>> import numpy as np
    >>> apply_transform(make_transform(translation=[1.0, 2.0, 3.0]), np.zeros((2, 3)))
    array([[1., 2., 3.],
           [1., 2., 3.]])
    """
    if tf_a_b.ndim == 2:
        rotated: FloatArray = p_b @ tf_a_b[:3, :3].T
    else:
        rotated = np.einsum("...ij,...j->...i", tf_a_b[..., :3, :3], p_b)
    return rotated + tf_a_b[..., :3, 3]


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return [v]×, with [v]× w = v × w: (…, 3) gives (…, 3, 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def check_transforms(name: str, value: ArrayLike, *, single: bool = True) -> FloatArray:
    """Return `value` as rigid transforms (n, 4, 4), or (4, 4) where `single` allows.

    Raises
    ------
    DataError
        If the shape is wrong, entries are NaN, the lower row is not 0 0 0 1, or the 3×3 part is not a rotation (the
        message names the rows).
    """
    tf = as_floats(name, value)
    if tf.shape[-2:] != (4, 4) or tf.ndim not in ((2, 3) if single else (3,)):
        raise DataError(f"{name} has shape {tf.shape}, expected {'(4, 4) or ' if single else ''}(n, 4, 4)")
    rows = tf.reshape(-1, 4, 4)
    if not len(rows):
        raise DataError(f"{name} is empty, expected at least one (4, 4) transform")
    check_finite(name, rows)
    lower = np.abs(rows[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > _ROUNDING
    if lower.any():
        raise DataError(
            f"{name}: the lower row is not 0 0 0 1 in {name_rows(np.flatnonzero(lower))}; is it transposed?"
        )
    x, y, z = rows[:, :3, 0], rows[:, :3, 1], rows[:, :3, 2]
    # columns of unit length, at right angles and right-handed; z = x × y tests the last two together
    crossed = x[:, [1, 2, 0]] * y[:, [2, 0, 1]] - x[:, [2, 0, 1]] * y[:, [1, 2, 0]]
    off = np.maximum(np.abs(crossed - z).max(axis=1), np.abs(np.einsum("ni,ni->n", x, x) - 1.0))
    off = np.maximum(off, np.abs(np.einsum("ni,ni->n", x, y))) > 4 * _ROUNDING
    if off.any():
        raise DataError(
            f"{name}: the 3×3 part is not a rotation in {name_rows(np.flatnonzero(off))}; "
            "expected orthonormal, right-handed columns"
        )
    return tf
