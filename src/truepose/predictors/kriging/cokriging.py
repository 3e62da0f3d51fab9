"""Kriging of a vector in one system of nk equations: any covariance of components, any noise, any unmeasured (9)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.base import SMALLEST_SCALE
from truepose.predictors.kriging.correlation import Correlation
from truepose.predictors.kriging.system import System
from truepose.similarity.experimental import experimental_variogram
from truepose.similarity.model import VariogramModel
from truepose.similarity.trend import DriftBasis

CHUNK: Final = 2**22
"""Covariances of targets and samples in memory at once: 32 MB."""

ITERATIONS: Final = 500
SETTLED: Final = 1e-10
"""Of the fit of coregionalisation matrices."""


class Cokriging:
    """A fitted system of nk equations.

    Parameters
    ----------
    x : (n, d) array
        The points.
    e : (n, k) array
        The errors.
    models, matrices : sequence of VariogramModel, (s, k, k) array
        The models and matrices of Cov(e_a, e_b') = Σ_s B_s,ab (covariance of model s).
    drift : DriftBasis
        The drift, or its columns.
    shared : bool
        Whether the components share the coefficients of the drift.
    noise : (n, k, k) array
        The covariance of the readings; a component with infinite variance was not measured.
    exact : bool
        Whether the nuggets belong to the error.
    """

    def __init__(
        self,
        x: FloatArray,
        e: FloatArray,
        models: Sequence[VariogramModel],
        matrices: FloatArray,
        drift: DriftBasis,
        shared: bool,
        noise: FloatArray,
        exact: bool,
    ) -> None:
        from truepose.numerics.kernels import pack

        n, k = e.shape
        self._x, self._drift, self._shared, self._k = x, drift, shared, k
        points = drift.coordinates(x)
        self._tree = KDTree(x)
        self._matrices = matrices * np.array([m.partial_sill for m in models])[:, None, None]
        self._nugget = np.einsum("sab,s->ab", matrices, [m.nugget for m in models])
        self._micro = self._nugget if exact else np.zeros((k, k))
        self._correlations = [Correlation.of(m, points.shape[1]) for m in models]
        self._sums = [c.at(points) for c in self._correlations]

        measured = np.asarray(np.isfinite(noise[:, range(k), range(k)]))
        self._rows = np.flatnonzero(measured.reshape(-1))
        self._noise = np.where(measured[:, :, None] & measured[:, None], noise, 0.0)
        covariance = np.zeros((n, k, n, k))
        for sums, matrix in zip(self._sums, self._matrices, strict=True):
            covariance += sums.cross(points)[:, None, :, None] * matrix[None, :, None, :]
        covariance[range(n), :, range(n)] += self._nugget + self._noise
        flat = covariance.reshape(n * k, n * k)
        if len(self._rows) < n * k:
            flat = flat[np.ix_(self._rows, self._rows)]
        self.system = System.factorise(np.ascontiguousarray(flat), self._basis(x)[self._rows], x)

        self._e = e
        beta, alpha = self.system.solve(e.reshape(-1, 1)[self._rows])
        full = np.zeros(n * k)
        full[self._rows] = alpha[:, 0]
        self._alpha = full.reshape(n, k)
        self.beta = np.tile(beta, k) if shared else beta.reshape(k, -1).T
        self._weights = [pack(self._alpha @ matrix) for matrix in self._matrices]
        silent = np.asarray(measured.all(axis=1) & ~self._noise.any(axis=(1, 2)))
        self._silent: BoolArray = silent if exact or not self._nugget.any() else np.zeros(n, dtype=np.bool_)

    def mean(self, X: FloatArray) -> FloatArray:
        """Return the prediction (m, k)."""
        points = self._drift.coordinates(X)
        e = self._drift(X) @ self.beta
        for sums, weights in zip(self._sums, self._weights, strict=True):
            e += sums.weighted(points, weights)
        targets, samples = self._at_samples(X)
        e[targets] += self._alpha[samples] @ self._micro
        known = self._silent[samples]
        e[targets[known]] = self._e[samples[known]]
        return np.asarray(e)

    def gradient(self, X: FloatArray) -> FloatArray:
        """Return the derivative of `mean` by X, (m, k, d)."""
        points = self._drift.coordinates(X)
        slope = np.einsum("mpd,pk->mkd", self._drift.gradient(X), self.beta)
        columns = np.delete(np.arange(X.shape[1]), self._drift.columns)
        for sums, weights in zip(self._sums, self._weights, strict=True):
            slope[:, :, columns] += sums.gradient(points, weights)
        return np.asarray(slope)

    def covariance(self, X: FloatArray) -> FloatArray:
        """Return the covariance of the components' errors at each target, (m, k, k)."""
        out = np.empty((len(X), self._k, self._k))
        prior = self._matrices.sum(axis=0) + self._micro
        rows = max(1, CHUNK // (len(self._rows) * self._k))
        for start in range(0, len(X), rows):
            part = slice(start, min(start + rows, len(X)))
            half, spread = (h.reshape(len(h), -1, self._k) for h in self._reduce(X[part]))
            out[part] = prior - np.einsum("nma,nmb->mab", half, half) + np.einsum("pma,pmb->mab", spread, spread)
        targets, samples = self._at_samples(X)
        out[targets[self._silent[samples]]] = 0.0
        return out

    def joint_covariance(self, X: FloatArray) -> FloatArray:
        """Return the covariance of all components at all targets, (m k, m k)."""
        points, m, k = self._drift.coordinates(X), len(X), self._k
        prior = np.zeros((m, k, m, k))
        for correlation, matrix in zip(self._correlations, self._matrices, strict=True):
            prior += correlation.matrix(points)[:, None, :, None] * matrix[None, :, None, :]
        prior[range(m), :, range(m)] += self._micro
        half, spread = self._reduce(X)
        joint = prior.reshape(m * k, m * k) - half.T @ half + spread.T @ spread
        targets, samples = self._at_samples(X)
        known = (targets[self._silent[samples]][:, None] * k + np.arange(k)).reshape(-1)
        joint[known] = joint[:, known] = 0.0
        return np.asarray(joint)

    def left_out(self, groups: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return residual and variance of the reading's residual, (n, k), of each sample without its group.

        NaN for components that were not measured.
        """
        n, k = self._e.shape
        residual, variance = np.full((2, n * k), np.nan)
        of_row = np.repeat(groups, k)[self._rows]
        alpha = self._alpha.reshape(-1)
        for group in np.unique(groups):
            inside = np.flatnonzero(of_row == group)
            if not inside.size:
                continue
            try:
                factor = cho_factor(self.system.left_out_precision(inside), lower=True)
            except np.linalg.LinAlgError:
                raise KrigingError(
                    f"without group {group} the others do not determine the drift; use smaller groups"
                ) from None
            rows = self._rows[inside]
            covariance = cho_solve(factor, np.eye(len(rows)))
            residual[rows] = covariance @ alpha[rows]
            variance[rows] = covariance.diagonal()
        return residual.reshape(n, k), variance.reshape(n, k)

    def _reduce(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        points, k = self._drift.coordinates(X), self._k
        cross = np.zeros((len(X), k, len(self._x), k))
        for sums, matrix in zip(self._sums, self._matrices, strict=True):
            cross += sums.cross(points)[:, None, :, None] * matrix[None, :, None, :]
        targets, samples = self._at_samples(X)
        cross[targets, :, samples] += self._micro
        flat = np.ascontiguousarray(cross.reshape(len(X) * k, -1)[:, self._rows])
        return self.system.reduce(flat, self._basis(X))

    def _basis(self, X: FloatArray) -> FloatArray:
        """Return the drift of each component at each target, (m k, p) or (m k, k p)."""
        f = self._drift(X)
        return (
            np.repeat(f, self._k, axis=0)
            if self._shared
            else np.asarray(np.einsum("mp,ab->mabp", f, np.eye(self._k)).reshape(len(X) * self._k, -1))
        )

    def _at_samples(self, X: FloatArray) -> tuple[IntArray, IntArray]:
        if not (self._micro.any() or self._silent.any()):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        found = self._tree.query(X, distance_upper_bound=1e-150)
        targets = np.flatnonzero(np.asarray(found[0]) == 0)
        return targets, np.asarray(found[1])[targets]


def given_matrices(coregionalisation: Any, terms: int, k: int) -> FloatArray:
    """Return given matrices as (terms, k, k); raise KrigingError where one is not a covariance matrix."""
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
    """Return a covariance matrix in which every combination of the components has a positive variance."""
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
        The points.
    e : (n, k) array
        The errors.
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
