"""Measured orientations of samples as rows of their own.

A sample with a measured orientation has three further rows: the rotation vector of R_meas R_cmdᵀ times a length L, with
the noise of the orientation times L. That is the same information in millimetres, for any noise of each axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.conditions import width
from truepose.predictors.kinematic.terms import Terms


def with_turns(
    terms: Terms, X: FloatArray, e: FloatArray, noise_std: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return the rows of a fit: those of the positions, then those of the measured orientations.

    Parameters
    ----------
    terms : Terms
        The terms at the nominal arm.
    X : (n, d) array [rad, …]
        The joints and conditions.
    e : (n, 3) array [mm], base frame
        The positional errors.
    noise_std : (n, 3) array [mm], optional
        The standard deviations of their readings.

    Returns
    -------
    X : (m, d) array
        The joints and conditions of each row; only rows of orientation have one.
    e, noise_std : (m, 3) arrays [mm]
        The errors, and the standard deviations of readings.
    own : (m,) array of int
        The sample of each row.
    """
    reading, n, dof = np.zeros_like(e) if noise_std is None else noise_std, len(e), terms.robot.dof
    turned = turned_rows(X, terms.conditions, dof)
    if not len(turned):
        return unseen(X, terms.conditions, dof), e, reading, np.arange(n)
    rows = X[turned]
    length = terms.at(rows).turn[:, None]
    vector, std = np.split(rows[:, dof:][:, place_of(terms.conditions, dof)], 2, axis=1)
    return (
        np.concatenate([unseen(X, terms.conditions, dof), rows]),
        np.concatenate([e, length * vector]),
        np.concatenate([reading, length * std]),
        np.concatenate([np.arange(n), turned]),
    )


def place_of(conditions: Sequence[str], dof: int) -> slice:
    """Return the columns of measured orientations after the joints: rotation vector and standard deviation [rad]."""
    before = sum(width(name, dof) for name in conditions[: list(conditions).index("orientation")])
    return slice(before, before + width("orientation", dof))


def unseen(X: FloatArray, conditions: Sequence[str], dof: int) -> FloatArray:
    """Return joints and conditions (n, d) without measured orientations: NaN, as for a row of position."""
    if "orientation" not in conditions or X.shape[1] == dof:
        return X
    hidden = X.copy()
    hidden[:, dof:][:, place_of(conditions, dof)] = np.nan
    return hidden


def turned_rows(X: FloatArray, conditions: Sequence[str], dof: int) -> IntArray:
    """Return the samples (n, d) with a measured orientation, (k,)."""
    if "orientation" not in conditions:
        return np.empty(0, np.int64)
    return np.flatnonzero(np.isfinite(X[:, dof:][:, place_of(conditions, dof)]).all(axis=1))
