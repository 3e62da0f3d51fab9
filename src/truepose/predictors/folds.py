"""Folds for cross-validation: by random points, and by blocks of space (method.md §5, (14))."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.cluster.vq import kmeans2

from truepose.errors import DataError

IntArray = NDArray[np.int64]


def random_folds(n: int, folds: int = 5, *, rng: np.random.Generator | int = 0) -> IntArray:
    """Return the fold of each of n samples, sizes equal to within one.

    Returns
    -------
    (n,) array of int, 0 … folds − 1
    """
    _check(n, folds)
    return np.random.default_rng(rng).permutation(np.arange(n) % folds)


def block_folds(x: ArrayLike, folds: int = 5, *, rng: np.random.Generator | int = 0) -> IntArray:
    """Return the fold of each sample when folds are compact blocks of space.

    Samples near each other resemble each other, so random folds flatter an interpolator; blocks ask it for a region
    that it has not seen. Blocks are clusters (k-means on the coordinates, each scaled by its spread).

    Parameters
    ----------
    x : (n, d) array
        Positions [mm] or joints [rad].

    Returns
    -------
    (n,) array of int, 0 … folds − 1
    """
    points = np.asarray(x, float)
    _check(len(points), folds)
    spread = points.std(axis=0)
    scaled = points / np.where(spread > 0, spread, 1.0)
    if len(np.unique(scaled, axis=0)) < 2 * folds:
        return random_folds(len(points), folds, rng=rng)  # samples at a few places only have no blocks
    _, cluster = kmeans2(scaled, folds, minit="++", rng=np.random.default_rng(rng))
    return np.unique(cluster, return_inverse=True)[1].astype(np.int64)  # an empty cluster leaves no gap


def _check(n: int, folds: int) -> None:
    if not 2 <= folds <= n:
        raise DataError(f"{folds} folds of {n} samples: at least 2 folds and as many samples as folds are needed")
