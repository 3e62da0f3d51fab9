"""Smooth the corrections along a path, as far as their own uncertainty allows.

The smoothed corrections x minimise Σ |x_i − c_i|²/σ_i² + λ Σ |b_k(x)|², where c are the corrections of the map, σ the
lengths of their standard deviations and b the bends of the path; with the smallest λ for which no bend is beyond its
limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from truepose._typing import BoolArray, FloatArray, IntArray

_FIRST: Final = 1e-2  # λ of the first trial, in units of 1/σ²
_LAST: Final = 1e4
_FACTOR: Final = 4.0  # from one trial to the next
_HALVINGS: Final = 4  # of the last step
_SMALLEST: Final = 1e-6  # mm
_INSIDE: Final = 0.98  # of the limits: digits are rounded afterwards


@dataclass(frozen=True, eq=False)
class Bends:
    """The bends of a path as linear functions of its n corrections.

    Attributes
    ----------
    at, before, after : (k,) arrays of int
        The target of each bend, and its neighbours.
    share : (k,) array
        The place of the target between its neighbours, from 0 to 1.
    limit : (k,) array [mm]
        The largest allowed bend.
    """

    at: IntArray
    before: IntArray
    after: IntArray
    share: FloatArray
    limit: FloatArray

    def matrix(self, n: int) -> csc_array:
        """Return the matrix (k, n) whose product with the corrections is the bends."""
        k = len(self.at)
        rows = np.tile(np.arange(k), 3)
        columns = np.concatenate([self.at, self.before, self.after])
        values = np.concatenate([np.ones(k), self.share - 1.0, -self.share])
        return csc_array((values, (rows, columns)), shape=(k, n))


def smoothed(change: FloatArray, free: BoolArray, std: FloatArray, bends: Bends) -> FloatArray | None:
    """Return corrections whose bends are within their limits; None where the uncertainty does not allow it.

    Parameters
    ----------
    change : (n, 3) array [mm]
        The corrections.
    free : (n,) array of bool
        Whether a correction may move; by at most its standard deviation.
    std : (n,) array [mm]
        The lengths of the standard deviations.
    bends : Bends
        The bends.

    Returns
    -------
    (n, 3) array [mm], or None
        The smoothed corrections.

    Examples
    --------
    >>> rough = np.zeros((5, 3))
    >>> rough[2, 0] = 0.1
    >>> three = np.arange(3)
    >>> bends = Bends(three + 1, three, three + 2, np.full(3, 0.5), np.full(3, 0.06))
    >>> smoothed(rough, np.ones(5, bool), np.full(5, 0.03), bends)[:, 0].round(3)
    array([-0.003,  0.016,  0.074,  0.016, -0.003])
    >>> smoothed(rough, np.ones(5, bool), np.full(5, 0.01), bends) is None
    True
    """
    std = np.maximum(std[free], _SMALLEST)
    if not len(std) or not np.isfinite(std).all():
        return None
    matrix = bends.matrix(len(change))
    of_free, held = matrix[:, free], matrix[:, ~free] @ change[~free]
    square = (of_free.T @ of_free).tocsc()
    weight = 1.0 / std**2

    def at(strength: float) -> FloatArray:
        system = (diags_array(weight) + strength * square).tocsc()
        out = change.copy()
        out[free] = splu(system).solve(weight[:, None] * change[free] - strength * (of_free.T @ held))
        return out

    def fits(out: FloatArray) -> bool:
        return bool((np.linalg.norm(matrix @ out, axis=1) <= _INSIDE * bends.limit).all())

    weak = strong = _FIRST / float(np.median(std) ** 2)
    while not fits(at(strong)):
        weak, strong = strong, _FACTOR * strong
        if strong > _LAST * weight.max():
            return None
    for _ in range(_HALVINGS):
        middle = math.sqrt(weak * strong)
        weak, strong = (weak, middle) if fits(at(middle)) else (middle, strong)
    out = at(strong)
    return out if (np.linalg.norm(out[free] - change[free], axis=1) <= std).all() else None
