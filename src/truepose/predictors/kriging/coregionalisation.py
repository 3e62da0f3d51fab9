"""The matrices B of vector Kriging (9): how the components vary together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.variogram_estimation import SMALLEST_SCALE
from truepose.similarity import VariogramModel, experimental_variogram

ITERATIONS: Final = 500
SETTLED: Final = 1e-10


def given_matrices(coregionalisation: Any, terms: int, k: int) -> FloatArray:
    """Return what the user gave as (terms, k, k); raise KrigingError where one is no covariance matrix."""
    matrices = np.asarray(coregionalisation, dtype=np.float64)
    matrices = matrices[None] if matrices.ndim == 2 else matrices
    if matrices.shape != (terms, k, k):
        raise KrigingError(
            f"coregionalisation has shape {np.shape(coregionalisation)}; expected ({terms}, {k}, {k}), a matrix for "
            "each structure"
        )
    for i, matrix in enumerate(matrices):
        size = np.abs(matrix).max()
        if (
            not np.allclose(matrix, matrix.T, rtol=0, atol=1e-12 * size)
            or np.linalg.eigvalsh(matrix)[0] < -1e-10 * size
        ):
            raise KrigingError(
                f"coregionalisation matrix {i} is not symmetric and positive semi-definite; fit it, or give B = A Aᵀ"
            )
    return matrices


def floored(matrix: FloatArray) -> FloatArray:
    """Return a covariance matrix in which every combination of the components varies, if ever so little."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    floor = SMALLEST_SCALE * max(float(values[-1]), 1.0)
    return np.asarray((vectors * np.maximum(values, floor)) @ vectors.T)


def fit_coregionalisation(x: FloatArray, e: FloatArray, models: Sequence[VariogramModel], bins: int = 20) -> FloatArray:
    """Fit the matrices of a linear model of coregionalisation, (terms, k, k), to the cross-variograms of e.

    Weighted least squares in which every matrix stays positive semi-definite. Source: M. Goulard & M. Voltz, "Linear
    coregionalization model: tools for estimation and choice of cross-variogram matrix", Mathematical Geology 24 (1992).

    Parameters
    ----------
    x : (n, d) array
    e : (n, k) array
    models : sequence of VariogramModel
        The structures, as units of variance.
    """
    k = e.shape[1]
    pairs = list(combinations(range(k), 2))
    sums = [e[:, a] + e[:, b] for a, b in pairs]
    ev = experimental_variogram(x, np.column_stack([e, *sums]), bins=bins)
    used = (ev.pairs > 0) & (ev.lag > 0)
    own = ev.semivariance[used]
    gamma = np.zeros((int(used.sum()), k, k))
    gamma[:, range(k), range(k)] = own[:, :k]
    for (a, b), together in zip(pairs, own[:, k:].T, strict=True):
        gamma[:, a, b] = gamma[:, b, a] = (together - own[:, a] - own[:, b]) / 2
    if len(gamma) < len(models):
        raise KrigingError(
            f"{len(gamma)} bins hold pairs, but there are {len(models)} structures; give fewer structures"
        )
    size = np.trace(gamma, axis1=1, axis2=2)
    weight = ev.pairs[used] / np.maximum(size, 1e-6 * max(size.max(), np.finfo(float).tiny)) ** 2
    g = np.array([model.semivariance(ev.lag[used]) for model in models])
    matrices = np.zeros((len(models), k, k))
    for _ in range(ITERATIONS):
        before = matrices.copy()
        for s in range(len(models)):
            rest = gamma - np.einsum("sb,sij->bij", g, matrices) + g[s][:, None, None] * matrices[s]
            best = np.einsum("b,bij->ij", weight * g[s], rest) / (weight @ g[s] ** 2)
            values, vectors = np.linalg.eigh(best)
            matrices[s] = (vectors * np.maximum(values, 0.0)) @ vectors.T
        if np.abs(matrices - before).max() <= SETTLED * np.abs(matrices).max():
            break
    return matrices
