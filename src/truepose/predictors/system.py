"""One factorised covariance matrix, and all that generalised least squares takes from it.

For e = F beta + Z with Cov(Z) = s² K: equation (7) in covariance form, with any drift F (ordinary Kriging: a column of
ones). K = L Lᵀ, and L⁻¹F = Q R. Source: P. K. Kitanidis, Introduction to Geostatistics (1997), chapter 6;
leave-one-out: O. Dubrule, "Cross validation of kriging in a unique neighborhood", Mathematical Geology 15 (1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular
from scipy.spatial import KDTree

from truepose.errors import KrigingError

FloatArray = NDArray[np.float64]

WORST: Final = 1e-14
"""Smallest reciprocal condition number with which a solution still has digits."""

PANEL: Final = 256


@dataclass(frozen=True, eq=False)
class System:
    """A factorised covariance matrix of n points, with a drift of p columns.

    Attributes
    ----------
    factor : (n, n) array
        L, lower.
    q, r : (n, p) and (p, p) arrays
        L⁻¹F = Q R.
    condition : float
        Condition number of K in the 1-norm.
    """

    factor: FloatArray
    q: FloatArray
    r: FloatArray
    condition: float

    @classmethod
    def factorise(cls, covariance: FloatArray, drift: FloatArray, x: FloatArray) -> Self:
        """Factorise a covariance matrix (n, n), which is overwritten.

        Parameters
        ----------
        covariance : (n, n) array, C order, symmetric
        drift : (n, p) array
        x : (n, d) array
            The points, to name the nearest two when the matrix is singular.

        Raises
        ------
        KrigingError
            If the matrix is singular or not positive definite in 64 bits.
        """
        matrix = covariance.T  # the same numbers in Fortran order: factorised in place
        norm = lapack.dlange("1", matrix)  # type: ignore[call-arg]
        diagonal = matrix.diagonal().copy()
        factor, failed = lapack.dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
        if failed:
            restored = np.triu(factor, 1)  # the upper triangle is still K
            restored += restored.T + np.diag(diagonal)
            raise _singular(_reciprocal_condition(restored, norm), x)
        reciprocal = lapack.dpocon(factor, norm, uplo="L")[0]
        if reciprocal < WORST:
            raise _singular(reciprocal, x)
        q, r = np.linalg.qr(solve_triangular(factor, drift, lower=True, check_finite=False))
        return cls(factor, q, r, 1 / reciprocal)

    def solve(self, e: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return beta (p, k), the weights K⁻¹(e − F beta) (n, k), and the variance scale s² (k,) of e (n, k) by GLS."""
        half = solve_triangular(self.factor, e, lower=True, check_finite=False)
        beta = solve_triangular(self.r, self.q.T @ half, check_finite=False)
        half -= self.q @ (self.q.T @ half)
        n, p = self.q.shape
        weights = solve_triangular(self.factor, half, lower=True, trans="T", check_finite=False)
        return beta, weights, (half**2).sum(axis=0) / (n - p)

    def variance(self, cross: FloatArray, drift: FloatArray, prior: float | FloatArray) -> FloatArray:
        """Return the unit variance of the best linear unbiased prediction at m targets, (m,).

        Parameters
        ----------
        cross : (m, n) array, C order
            Covariance of targets and points; overwritten.
        drift : (m, p) array
        prior : float or (m,) array
            Variance of the field at the targets.
        """
        half = solve_triangular(self.factor, cross.T, lower=True, overwrite_b=True, check_finite=False)
        spread = solve_triangular(self.r, drift.T, trans="T", check_finite=False) - self.q.T @ half
        kept: FloatArray = prior - np.einsum("ij,ij->j", half, half) + np.einsum("ij,ij->j", spread, spread)
        return np.maximum(kept, 0.0)

    def left_out_variance(self) -> FloatArray:
        """Return 1/P_ii (n,), P = K⁻¹ − K⁻¹F(FᵀK⁻¹F)⁻¹FᵀK⁻¹: the unit variance of e_i given all others."""
        n = len(self.factor)
        diagonal = np.empty(n)
        for start in range(0, n, PANEL):  # columns of L⁻¹ are zero above the diagonal
            stop = min(start + PANEL, n)
            unit = np.zeros((n - start, stop - start), order="F")
            unit[: stop - start] = np.eye(stop - start)
            columns = solve_triangular(
                self.factor[start:, start:], unit, lower=True, overwrite_b=True, check_finite=False
            )
            diagonal[start:stop] = np.einsum("ij,ij->j", columns, columns)
        influence = solve_triangular(self.factor, self.q, lower=True, trans="T", check_finite=False)
        precision: FloatArray = diagonal - np.einsum("ij,ij->i", influence, influence)
        return 1 / precision


def _reciprocal_condition(matrix: FloatArray, norm: float) -> float:
    """Return the reciprocal condition number of a symmetric matrix that may be indefinite."""
    factor, pivots, _ = lapack.dsytrf(matrix, lower=1)
    return float(lapack.dsycon(factor, pivots, norm, lower=1)[0])


def _singular(reciprocal: float, x: FloatArray) -> KrigingError:
    near = "they are one point"
    if len(x) > 1:
        distance, index = (np.asarray(found)[:, 1] for found in KDTree(x).query(x, k=2))
        i = int(np.argmin(distance))
        near = f"the nearest two, rows {i} and {index[i]} of the points, are {distance[i]:.3g} apart"
    size = f"condition number {1 / reciprocal:.1e}" if reciprocal > 0 else "infinite condition number"
    return KrigingError(
        f"the covariance matrix of {len(x)} points is singular to 64 bits ({size}; {near}); "
        "give the variogram a nugget, use a rougher family (matern52 for gaussian), or drop near points"
    )
