"""Controllers' orientation numbers and scipy's `Rotation`, both ways (conventions of each maker in `euler`)."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Final, Literal, overload

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry.arrays import as_rows, name_rows


@dataclass(frozen=True)
class AngleConvention:
    """The names of a controller's orientation numbers, and scipy's axes of its Euler angles [deg]."""

    names: tuple[str, ...]
    axes: Literal["xyz", "XYZ", "ZYX"] | None = None


ANGLES: Final = {
    "abb": AngleConvention(("q1", "q2", "q3", "q4")),
    "fanuc": AngleConvention(("W", "P", "R"), "xyz"),
    "kuka": AngleConvention(("A", "B", "C"), "ZYX"),
    "staubli": AngleConvention(("rx", "ry", "rz"), "XYZ"),
    "ur": AngleConvention(("rx", "ry", "rz")),
    "yaskawa": AngleConvention(("Rx", "Ry", "Rz"), "xyz"),
}
"""The orientation conventions by controller."""

_UNIT_TOLERANCE = 1e-3  # quaternions with three digits deviate by 1.5e-4


@overload
def euler(controller: str, value: Rotation) -> FloatArray: ...
@overload
def euler(controller: str, value: ArrayLike) -> Rotation: ...


def euler(controller: str, value: Rotation | ArrayLike) -> FloatArray | Rotation:
    """Convert a controller's orientation numbers to a Rotation, or a Rotation to the numbers.

    ==========  ================  ===========================================================================
    controller  numbers           meaning
    ==========  ================  ===========================================================================
    kuka        A, B, C [deg]     Rz(A)·Ry(B)·Rx(C)
    abb         q1, q2, q3, q4    unit quaternion w, x, y, z
    fanuc       W, P, R [deg]     Rz(R)·Ry(P)·Rx(W), fixed axes x, y, z
    ur          rx, ry, rz [rad]  rotation vector
    yaskawa     Rx, Ry, Rz [deg]  fixed axes x, y, z
    staubli     rx, ry, rz [deg]  Rx(rx)·Ry(ry)·Rz(rz); from one source only, not confirmed on a controller
    ==========  ================  ===========================================================================

    Parameters
    ----------
    controller : {"kuka", "abb", "fanuc", "ur", "yaskawa", "staubli"}
        The controller.
    value : (3,) or (n, 3) array, (4,) or (n, 4) for abb; or Rotation
        The orientation; its type decides the direction of the conversion.

    Returns
    -------
    Rotation, or array of shape (3,), (n, 3) (abb: 4)
        The other form. Quaternions have w >= 0, rotation vectors a length <= pi, and the middle angles of the others
        lie within ±90 deg.

    Raises
    ------
    DataError
        If the controller is unknown (the message suggests the nearest name), the number of columns is wrong, a value is
        NaN, a quaternion is not of unit length, or a rotation vector looks like degrees.

    Notes
    -----
    At a middle angle of ±90 deg only the sum or difference of the outer two is determined (gimbal lock). The third
    number is then set to zero and the first states the whole turn: the rotation is the same, but the numbers may differ
    from the original ones.

    Examples
    --------
    >>> rotation = euler("kuka", [90.0, 0.0, 180.0])
    >>> euler("abb", rotation).round(6) + 0.0
    array([0.      , 0.707107, 0.707107, 0.      ])
    """
    convention = ANGLES.get(controller)
    if convention is None:
        near = difflib.get_close_matches(str(controller).lower(), ANGLES, n=1, cutoff=0.0)
        raise DataError(f'unknown controller "{controller}"; did you mean "{near[0]}"? Known: {", ".join(ANGLES)}')
    if isinstance(value, Rotation):
        return _numbers(controller, convention, value)
    return _rotation(controller, convention, value)


def _numbers(controller: str, convention: AngleConvention, rotation: Rotation) -> FloatArray:
    if convention.axes:
        return np.asarray(rotation.as_euler(convention.axes, degrees=True, suppress_warnings=True))
    if controller == "ur":
        return np.asarray(rotation.as_rotvec())
    return np.asarray(rotation.as_quat(canonical=True, scalar_first=True))


def _rotation(controller: str, convention: AngleConvention, value: ArrayLike) -> Rotation:
    title = f"{controller} orientation ({', '.join(convention.names)})"
    numbers = as_rows(title, value, len(convention.names), single=True)
    if convention.axes:
        return Rotation.from_euler(convention.axes, numbers, degrees=True)
    length = np.atleast_1d(np.linalg.norm(numbers, axis=-1))
    if controller == "ur":
        if (length > 4 * np.pi).any():
            rows = name_rows(np.flatnonzero(length > 4 * np.pi))
            raise DataError(f"{title} has length {length.max():.4g} in {rows}: looks like degrees, expected rad")
        return Rotation.from_rotvec(numbers)
    wrong = np.abs(length - 1.0) > _UNIT_TOLERANCE
    if wrong.any():
        worst = length[np.argmax(np.abs(length - 1.0))]
        raise DataError(
            f"{title} has length {worst:.6g} in {name_rows(np.flatnonzero(wrong))}, expected 1; "
            "is the order w, x, y, z and no digit lost?"
        )
    return Rotation.from_quat(numbers, scalar_first=True)
