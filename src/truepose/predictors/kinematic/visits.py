"""The noise that readings of several reflectors share: the arm stands still while they are read."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray

SHARED: Final = (1.0, 0.5)
"""The share of the fitted noise that readings of one visit have in common: noise of the readings known, or not."""


def pairs_of(visit: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the pairs of rows of one visit, the later and the earlier row of each; none for NaN.

    Examples
    --------
    >>> pairs_of(np.array([0.0, 0.0, 1.0, 1.0, 1.0]))
    (array([1, 3, 4, 4]), array([0, 2, 2, 3]))
    """
    later: list[int] = []
    earlier: list[int] = []
    if not np.isnan(visit).all():
        for number in np.unique(visit[~np.isnan(visit)]):
            rows = np.flatnonzero(visit == number)
            for i, row in enumerate(rows.tolist()):
                later += [row] * i
                earlier += rows[:i].tolist()
    return np.array(later, np.int64), np.array(earlier, np.int64)


def add_shared(covariance: FloatArray, pairs: tuple[IntArray, IntArray], variance: float) -> None:
    """Add the shared variance [mm²] of pairs of rows to the lower triangle of a covariance (3n, 3n), in place."""
    for axis in range(3):
        covariance[3 * pairs[0] + axis, 3 * pairs[1] + axis] += variance


def with_shared(noise: FloatArray, visit: FloatArray, variance: float) -> FloatArray:
    """Return the noise covariances of blocks of rows with what visits share, (g, 3m, 3m) [mm²].

    Parameters
    ----------
    noise : (g, m, 3, 3) array [mm²]
        The noise covariance of each row.
    visit : (g, m) array
        The visits; NaN for a row of its own.
    variance : float [mm²]
        The variance that rows of one visit share in each direction.
    """
    g, m = visit.shape
    full = np.zeros((g, m, 3, m, 3))
    full[:, np.arange(m), :, np.arange(m)] = np.swapaxes(noise, 0, 1)
    same = (visit[:, :, None] == visit[:, None, :]) & ~np.eye(m, dtype=np.bool_)
    for axis in range(3):
        full[:, :, axis, :, axis] += variance * same
    return full.reshape(g, 3 * m, 3 * m)
