"""Couplings between the joints that a controller shows: how a robot file states them.

A row (i, k, f) says that joint i of the model is joint i as shown plus f times joint k as shown. Joints are numbered
from 1; f counts in the controller's signs. Several rows may name one joint.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError

Coupling = tuple[tuple[int, int, float], ...]
"""Rows (joint, other joint, factor) of the key ``coupling`` of a robot file."""


def check_coupling(given: Iterable[Iterable[float]], dof: int) -> Coupling:
    """Return the rows of a coupling.

    Raises
    ------
    RobotError
        If a row does not name two joints of the arm and a finite factor that is not 0, a pair has two rows, or joints
        are coupled in a circle.

    Examples
    --------
    >>> check_coupling([[3, 2, 1.0]], dof=6)
    ((3, 2, 1.0),)
    """
    rows: list[tuple[int, int, float]] = []
    for row in given:
        values = np.atleast_1d(np.asarray(row, float))
        if values.shape != (3,):
            raise RobotError(f"coupling: expected rows [joint, other joint, factor], such as [3, 2, 1.0]; got {row}")
        joint, other, factor = values.tolist()
        for number in (joint, other):
            if number not in range(1, dof + 1):
                raise RobotError(f"coupling: there is no joint {number:g}; the arm has joints 1 to {dof}")
        if joint == other:
            raise RobotError(f"coupling: joint {joint:g} is coupled with itself; state its direction in sign")
        if not np.isfinite(factor) or factor == 0.0:
            raise RobotError(
                f"coupling: the factor of joints {joint:g} and {other:g} is {factor:g}; expected a finite number that "
                "is not 0; leave the row out if the joints are not coupled"
            )
        rows.append((int(joint), int(other), factor))
    pairs = [(joint, other) for joint, other, _ in rows]
    if twice := [pair for k, pair in enumerate(pairs) if pair in pairs[:k]]:
        joint, other = twice[0]
        raise RobotError(f"coupling: joints {joint} and {other} have two rows; keep one")
    if circle := _circle(pairs, dof):
        named = ", ".join(map(str, circle))
        raise RobotError(
            f"coupling: joints {named} depend on each other in a circle; state each joint of the model by joints as "
            "the controller shows them, in one direction"
        )
    return tuple(rows)


def coupling_matrix(coupling: Coupling, dof: int) -> FloatArray:
    """Return the matrix C of q = C s, (dof, dof), with q the joints of the model and s those shown.

    Couplings without a circle always have an inverse: the determinant is 1.

    Examples
    --------
    >>> coupling_matrix(((2, 1, 0.5),), 2)
    array([[1. , 0. ],
           [0.5, 1. ]])
    """
    matrix = np.eye(dof)
    for joint, other, factor in coupling:
        matrix[joint - 1, other - 1] = factor
    return matrix


def _circle(pairs: Iterable[tuple[int, int]], dof: int) -> list[int]:
    """Return the joints, from 1, that depend on themselves through others."""
    reached = np.zeros((dof, dof), np.bool_)
    for joint, other in pairs:
        reached[joint - 1, other - 1] = True
    for k in range(dof):
        reached |= reached[:, [k]] & reached[[k], :]
    return [int(j) + 1 for j in np.flatnonzero(reached.diagonal())]
