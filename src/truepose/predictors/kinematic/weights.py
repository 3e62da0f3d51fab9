"""Weigh down readings that the others contradict."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray

GROSS: Final = 0.1
"""The weight below which a reading is gross."""
ROUNDS: Final = 4
"""The largest number of rounds of robust weights."""
SETTLED: Final = 0.1
"""The change of the roots of robust weights that ends them."""

_SURPRISE: Final = 11.34  # squared standardised length above which a reading is weighed down; 1 % of good readings
_FAR: Final = 6.0  # times the typical length that the drift leaves
_MEDIAN: Final = 1.538  # median length of a standard normal vector in 3-D
_NOISE: Final = 0.2  # mm
_FIRST_ROUNDS: Final = 10


def first_weights(drift: FloatArray, e: FloatArray) -> FloatArray:
    """Return the weights for the first search: 0.0001 for readings that the drift does not explain, else 1.

    Parameters
    ----------
    drift : (n, 3, p) array [mm]
        The drift columns per prior standard deviation.
    e : (n, 3) array [mm]
        The positional errors.

    Returns
    -------
    (n,) array
        The weights.
    """
    phi, y, weight = drift.reshape(3 * len(e), -1), e.reshape(-1), np.ones(len(e))
    for _ in range(_FIRST_ROUNDS):
        root = np.repeat(np.sqrt(weight), 3)
        scaled = phi * root[:, None]
        matrix = scaled.T @ scaled / _NOISE**2 + np.eye(phi.shape[1])
        estimate = np.linalg.solve(matrix, scaled.T @ (y * root) / _NOISE**2)
        size = np.linalg.norm((y - phi @ estimate).reshape(-1, 3), axis=1)
        weight = np.where(size > _FAR * np.median(size) / _MEDIAN, 1e-4, 1.0)
    return weight


def robust_weights(residual: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the weights min(1, c²/z²), (n,), from left-out residuals (n, 3) and their covariances (n, 3, 3)."""
    z_squared = np.einsum("na,na->n", residual, np.linalg.solve(covariance, residual[..., None])[..., 0])
    return np.asarray(np.minimum(_SURPRISE / np.maximum(z_squared, np.finfo(float).tiny), 1.0))
