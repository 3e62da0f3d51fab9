"""Kriging of a vector in one system of nk equations: any covariance of components, any noise, any unmeasured (9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.correlation import Correlation
from truepose.predictors.kriging.drift import Drift
from truepose.predictors.kriging.system import System
from truepose.similarity import VariogramModel

CHUNK: Final = 2**22
"""Covariances of targets and samples in memory at once: 32 MB."""


class Cokriging:
    """A fitted system of nk equations.

    Parameters
    ----------
    x : (n, d) array
    e : (n, k) array
    models, matrices : sequence of VariogramModel, (s, k, k) array
        Cov(e_a, e_b') = Σ_s B_s,ab (covariance of model s).
    drift : Drift
    shared : bool
        Whether the components share the coefficients of the drift.
    noise : (n, k, k) array
        Covariance of the readings; a component with infinite variance was not measured.
    exact : bool
        Whether the nuggets belong to the error.
    """

    def __init__(
        self,
        x: FloatArray,
        e: FloatArray,
        models: Sequence[VariogramModel],
        matrices: FloatArray,
        drift: Drift,
        shared: bool,
        noise: FloatArray,
        exact: bool,
    ) -> None:
        from truepose.numerics.compiled import pack

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
        beta, alpha, _ = self.system.solve(e.reshape(-1, 1)[self._rows])
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

        NaN for what was not measured.
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
                    f"without group {group} the others cannot tell the drift; use smaller groups"
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
