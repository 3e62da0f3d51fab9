"""One factorised covariance matrix, and the results of generalised least squares from it.

For e = F beta + Z with Cov(Z) = s² K: equations (7) and (8) in covariance form, with any drift F: a column of ones for
ordinary Kriging, none for simple Kriging. K = L Lᵀ, W = L⁻¹, and W F = Q R. The residuals of
the drift follow from P = Wᵀ(I − Q Qᵀ)W. Source: P. K. Kitanidis, Introduction to Geostatistics (1997),
chapter 6; leave-one-out: O. Dubrule, "Cross validation of kriging in a unique neighborhood", Mathematical Geology 15
(1983).
"""

from __future__ import annotations

import math
import warnings
from threading import Lock
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack
from scipy.spatial import KDTree

from truepose._typing import FloatArray, IntArray
from truepose.errors import IllConditionedWarning, KrigingError

WORST: Final = 1e-14
"""Smallest reciprocal condition number with which a solution still has digits."""

POOR: Final = 1e-11
"""A smaller one is warned of: fewer than five of 16 digits are left."""

WORST_DRIFT: Final = 1e-10
"""Smallest ratio of singular values with which the columns of a drift count as independent."""

REMEDY: Final = "give the variogram a nugget, use a rougher family (matern52 for gaussian), or drop near points"
PANEL: Final = 256
_INVERTING: Final = Lock()


class System:
    """A factorised covariance matrix of n points, with a drift of p columns.

    Attributes
    ----------
    q, r : (n, p) and (p, p) arrays
        The factors of W F = Q R.
    """

    def __init__(self, factor: FloatArray, q: FloatArray, r: FloatArray) -> None:
        self.q, self.r = q, r
        self._factor = factor  # L until `inverse` replaces it in place
        self._inverted = self._cleared = False
        self._narrow: NDArray[np.float32] | None = None

    @classmethod
    def factorise(cls, covariance: FloatArray, drift: FloatArray, x: FloatArray, noise: float = 0.0) -> Self:
        """Factorise a covariance matrix (n, n), which is overwritten.

        Parameters
        ----------
        covariance : (n, n) array, C order, symmetric
            The covariance matrix, overwritten.
        drift : (n, p) array
            The drift, or its columns.
        x : (u, d) array
            The points, to name the nearest two when the matrix is singular or nearly so.
        noise : float
            The part of the matrix that is this multiple of the unit matrix at least: no eigenvalue is below it.

        Raises
        ------
        KrigingError
            If the matrix is singular or not positive definite in 64 bits, or columns of the drift are not independent.

        Warns
        -----
        IllConditionedWarning
            If the condition number is above 1e11.
        """
        matrix = covariance.T  # the same numbers in Fortran order: factorised in place
        diagonal = matrix.diagonal().copy()
        regular = noise > POOR * len(x) * diagonal.sum()  # n tr(K)/noise is no less than the condition number
        norm = 0.0 if regular else _norm(matrix)
        factor, failed = lapack.dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
        if failed:
            restored = np.triu(factor, 1)  # the upper triangle is still K
            restored += restored.T + np.diag(diagonal)
            raise _singular(_reciprocal_condition(restored), x)
        reciprocal = 1.0 if regular else lapack.dpocon(factor, norm, uplo="L")[0]
        if reciprocal < WORST:
            raise _singular(reciprocal, x)
        if reciprocal < POOR:
            nearest, rows = _nearest(x)
            nearest = nearest.replace("{rows}", f"rows {', '.join(map(str, rows))} of the points")
            warnings.warn(
                f"the covariance matrix of {len(x)} points has the condition number {1 / reciprocal:.1e}, so that of "
                f"16 digits about {16 + math.log10(reciprocal):.0f} are left ({nearest}); {REMEDY}",
                IllConditionedWarning,
                stacklevel=2,
            )
        if not drift.shape[1]:
            return cls(factor, drift, np.zeros((0, 0)))
        q, r = _orthonormal(_solved(factor, drift, lower=True))
        if len(drift) < drift.shape[1] or dependent(r):
            raise KrigingError(
                f"the {drift.shape[1]} columns of the drift are not independent at {len(drift)} points; "
                "use a simpler drift, or measure points that differ in every coordinate of it"
            )
        return cls(factor, q, r)

    def solve(self, e: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return beta (p, k) and the weights K⁻¹(e − F beta) (n, k) of e (n, k) by GLS."""
        half, drift = self._separated(e)
        return _solved(self.r, drift) if len(drift) else drift, self.whiten(half, transposed=True)

    def scale(self, e: FloatArray) -> FloatArray:
        """Return s² (k, k): the restricted estimate of the covariance of the components of e (n, k) in units of K."""
        half, drift = self._separated(e)
        return half.T @ half / max(len(half) - len(drift), 1)

    def _separated(self, e: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (I − Q Qᵀ) W e (n, k) and Qᵀ W e (p, k)."""
        half = self.whiten(e)
        drift = self.q.T @ half
        return np.asarray(blas.dgemm(-1.0, self.q, drift, beta=1.0, c=half, overwrite_c=1)), drift

    def reduce(self, cross: FloatArray, drift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return W c (n, m) and the drift that it leaves unexplained, R⁻ᵀ f − Qᵀ W c (p, m).

        The unit covariance of two predictions is their prior covariance, less the product of the first, plus that of
        the second.

        Parameters
        ----------
        cross : (m, n) array, C order
            The covariance c of targets and points; overwritten.
        drift : (m, p) array
            The drift, or its columns.
        """
        half = blas.dtrmm(1.0, self._invert(), cross.T, lower=1, overwrite_b=1)
        if not drift.shape[1]:
            return half, np.zeros((0, half.shape[1]))
        return half, _solved(self.r, drift.T, transposed=True) - self.q.T @ half

    def variance(self, cross: FloatArray, drift: FloatArray, prior: float | FloatArray) -> FloatArray:
        """Return the unit variance of the best linear unbiased prediction at m targets, (m,).

        Parameters
        ----------
        cross, drift
            The arguments of `reduce`.
        prior : float or (m,) array
            The variance of the field at the targets.
        """
        half, spread = self.reduce(cross, drift)
        kept: FloatArray = prior - np.einsum("ij,ij->j", half, half) + np.einsum("ij,ij->j", spread, spread)
        return np.maximum(kept, 0.0)

    def single_variance(self, cross: FloatArray, drift: FloatArray, prior: float | FloatArray) -> FloatArray:
        """Return `variance` with the product W c in 32 bits, which takes half the time.

        Rounding moves the variance by about 1e-7 times the prior variance times the root of the condition number.
        """
        if self._narrow is None:
            self._narrow = self._invert().astype(np.float32, order="F")
        half = blas.strmm(1.0, self._narrow, cross.T.astype(np.float32, order="F"), lower=1, overwrite_b=1)
        kept: FloatArray = prior - np.einsum("ij,ij->j", half, half, dtype=np.float64)
        if drift.shape[1]:
            spread = _solved(self.r, drift.T, transposed=True) - self.q.T.astype(np.float32) @ half
            kept += np.einsum("ij,ij->j", spread, spread)
        return np.maximum(kept, 0.0)

    @property
    def inverse(self) -> FloatArray:
        """W = L⁻¹ (n, n), Fortran order, zero above the diagonal."""
        factor = self._invert()
        with _INVERTING:
            if not self._cleared:
                for start in range(0, len(factor), PANEL):
                    stop = start + PANEL
                    factor[:start, start:stop] = 0.0
                    factor[start:stop, start:stop] = np.tril(factor[start:stop, start:stop])
                self._cleared = True
        return factor

    def _invert(self) -> FloatArray:
        """Return W in the lower triangle; the first call computes it in the place of L."""
        with _INVERTING:
            if not self._inverted:
                self._factor, _ = lapack.dtrtri(self._factor, lower=1, overwrite_c=1)
                self._inverted = True
        return self._factor

    def left_out_variance(self) -> FloatArray:
        """Return 1/P_ii (n,): the unit variance of e_i given all others."""
        w = self.inverse
        influence = self.whiten(self.q, transposed=True)
        precision: FloatArray = np.einsum("ij,ij->j", w, w) - np.einsum("ij,ij->i", influence, influence)
        return 1 / precision

    def left_out_precision(self, rows: IntArray) -> FloatArray:
        """Return P_II: the inverse of the unit covariance of the points I given all others."""
        columns = self.inverse[rows.min() :, rows]  # W is zero above its diagonal
        influence = self.q[rows.min() :].T @ columns
        lower = blas.dsyrk(1.0, columns, trans=1, lower=1)  # half of the work of a product
        blas.dsyrk(-1.0, influence, trans=1, beta=1.0, c=lower, lower=1, overwrite_c=1)
        return symmetric(lower)

    def whiten(self, b: FloatArray, transposed: bool = False) -> FloatArray:
        """Return W b, or Wᵀ b."""
        if self._inverted:
            return np.asarray(blas.dtrmm(1.0, self._factor, b, lower=1, trans_a=transposed))
        return _solved(self._factor, b, lower=True, transposed=transposed)

    @property
    def condition(self) -> float:
        """The condition number of K in the 1-norm; O(n³)."""
        w = self.inverse
        factor = lapack.dtrtri(w, lower=1)[0]
        return _norm(factor @ factor.T) * _norm(w.T @ w)

    @property
    def log_determinant(self) -> float:
        """Logarithm of |K|."""
        sign = -2.0 if self._inverted else 2.0
        return sign * float(np.log(self._factor.diagonal()).sum())

    def __getstate__(self) -> dict[str, object]:
        with _INVERTING:
            return self.__dict__.copy()


def symmetric(lower: FloatArray) -> FloatArray:
    """Return the symmetric matrix with this lower triangle."""
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T)


def _solved(triangle: FloatArray, b: FloatArray, *, lower: bool = False, transposed: bool = False) -> FloatArray:
    """Return the solution of a triangular system, without the checks of `scipy.linalg.solve_triangular`."""
    return np.asarray(lapack.dtrtrs(triangle, b, lower=lower, trans=transposed)[0])


def _orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and R of columns = Q R."""
    length = math.sqrt(np.vdot(columns, columns))
    if columns.shape[1] > 1 or not length:
        q, r = np.linalg.qr(columns)
        return q, r
    return columns / length, np.array([[length]])


def dependent(r: FloatArray) -> bool:
    """Whether columns of a triangular factor (p, p) are linearly dependent, whatever their sizes."""
    if len(r) == 1:
        return bool(r[0, 0] == 0)
    size = np.linalg.norm(r, axis=0)
    return bool(size.min() == 0 or np.linalg.cond(r / size) > 1 / WORST_DRIFT)


def _norm(matrix: FloatArray) -> float:
    """Return the 1-norm of a matrix."""
    return float(lapack.dlange("1", matrix))  # type: ignore[call-arg]  # the stub asks for the work array


def _reciprocal_condition(matrix: FloatArray) -> float:
    """Return the reciprocal condition number of a symmetric matrix that may be indefinite."""
    factor, pivots, _ = lapack.dsytrf(matrix, lower=1)
    return float(lapack.dsycon(factor, pivots, _norm(matrix), lower=1)[0])


def _singular(reciprocal: float, x: FloatArray) -> KrigingError:
    size = f"condition number {1 / reciprocal:.1e}" if reciprocal > 0 else "infinite condition number"
    nearest, rows = _nearest(x)
    return KrigingError(
        f"the covariance matrix of {len(x)} points is singular to 64 bits ({size}; {nearest}); {REMEDY}", rows
    )


def _nearest(x: FloatArray) -> tuple[str, list[int]]:
    """Return how near the nearest two points are, with ``{rows}`` for their rows, and these rows."""
    if len(x) == 1:
        return "there is one point only", []
    distance, index = (np.asarray(found)[:, 1] for found in KDTree(x).query(x, k=2))
    i = int(np.argmin(distance))
    return f"the nearest two, {{rows}}, are {distance[i]:.3g} apart", [i, int(index[i])]


def draw(covariance: FloatArray, size: int, rng: np.random.Generator | int) -> FloatArray:
    """Return `size` draws of mean 0, (size, m, k), of k independent vectors with covariance (k, m, m).

    By pivoted Cholesky factors. Source: N. J. Higham, Analysis of the Cholesky decomposition of a semi-definite matrix
    (1990).
    """
    if size < 1:
        raise KrigingError(f"size is {size}; expected 1 field or more")
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
