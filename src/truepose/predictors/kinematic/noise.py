"""The noise of rows: a variance for each component, or a covariance for each row."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray


def add_to_blocks(blocks: FloatArray, noise: FloatArray) -> None:
    """Add noise, (n, 3) variances or (n, 3, 3) covariances [mm²], to the covariances of rows (n, 3, 3), in place."""
    if noise.ndim == 3:
        blocks += noise
    else:
        blocks[:, np.arange(3), np.arange(3)] += noise


def add_to_diagonal(covariance: FloatArray, noise: FloatArray) -> None:
    """Add noise, (n, 3) variances or (n, 3, 3) covariances [mm²], to the covariance of all rows (3n, 3n), in place."""
    if noise.ndim == 2:
        covariance[np.diag_indices(len(covariance))] += noise.reshape(-1)
        return
    rows = 3 * np.arange(len(noise))[:, None] + np.arange(3)
    covariance[rows[:, :, None], rows[:, None, :]] += noise
