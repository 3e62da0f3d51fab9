"""Draws from normal distributions whose covariance may be singular, as it is at samples without noise."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from truepose._typing import FloatArray
from truepose.errors import KrigingError


def draw(covariance: FloatArray, size: int, rng: np.random.Generator | int) -> FloatArray:
    """Return `size` draws of mean 0, (size, m, k), of k independent vectors with covariance (k, m, m).

    By pivoted Cholesky factors. Source: N. J. Higham, Analysis of the Cholesky decomposition of a semi-definite matrix
    (1990).
    """
    if size < 1:
        raise KrigingError(f"{size} fields were asked for; expected 1 or more")
    generator = np.random.default_rng(rng)
    k, m, _ = covariance.shape
    normal = generator.standard_normal((size, m, k))
    out = np.empty((size, m, k))
    for c in range(k):
        out[:, :, c] = normal[:, :, c] @ root(covariance[c]).T
    return out


def root(covariance: FloatArray) -> FloatArray:
    """Return A (m, m) with A Aᵀ = covariance, which may be singular."""
    factor, pivots, rank, _ = lapack.dpstrf(covariance, lower=1, tol=-1.0)
    factor = np.tril(np.asarray(factor, dtype=np.float64))
    factor[:, rank:] = 0.0
    out: FloatArray = np.empty_like(factor)
    out[pivots - 1] = factor
    return out
