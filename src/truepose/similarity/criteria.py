"""Criteria by which covariance parameters are judged: likelihood, restricted likelihood, leave-one-out.

For e = F β + Z + ε, Cov(Z + ε) = s K, K = ρ + t I (t = C0/C), the scale s is in closed form, and each criterion's
derivative by K is a symmetric matrix Q/2, so that the derivative by a parameter is ½ Σ Q_ij ∂K_ij. With
P = K⁻¹ − K⁻¹F(FᵀK⁻¹F)⁻¹FᵀK⁻¹ and w = P e, per component:

==== =============================================================== ==================================================
reml log|K| + log|FᵀK⁻¹F| + (n − p) log s, s = eᵀP e/(n − p)         P − w wᵀ/s
ml   log|K| + n log s, s = eᵀP e/n                                   K⁻¹ − w wᵀ/s
loo  −Σ log P_ii + n log s, s = Σ w_i²/P_ii / n                      P D P − (P v wᵀ + w vᵀP)/s, v = w/P_ii,
                                                                     D = 1/P_ii + w²/(s P_ii²)
==== =============================================================== ==================================================

(twice the negative logarithm each, without constants). Source: K. V. Mardia & R. J. Marshall, Biometrika 71 (1984);
P. K. Kitanidis, Water Resources Research 19 (1983); leave-one-out: S. Sundararajan & S. S. Keerthi, Neural Computation
13 (2001), with O. Dubrule's form for an unknown mean (Mathematical Geology 15, 1983).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from truepose._typing import FloatArray

METHODS: Final = ("reml", "ml", "loo")


class Judged(NamedTuple):
    """A criterion at one covariance matrix.

    Attributes
    ----------
    loss : float
        Half of the table's sums, over all components.
    Q : (n, n) array
        The derivative of 2 loss by K; its upper triangle alone is filled.
    scale : (c,) array [mm²]
        The scale s of each component.
    """

    loss: float
    Q: FloatArray
    scale: FloatArray


def judge(method: str, K: FloatArray, drift: FloatArray, e: FloatArray, common: bool) -> Judged | None:
    """Return a criterion at K (n, n), C order, overwritten; nothing where K is singular in 64 bits.

    Parameters
    ----------
    method : {"reml", "ml", "loo"}
        The criterion.
    K : (n, n) array
        The covariance matrix, overwritten.
    drift : (n, p) array
        The columns F of the drift; p may be 0.
    e : (n, c) array [mm]
        The errors.
    common : bool
        Whether the components share one scale.
    """
    n, c = e.shape
    p = drift.shape[1]
    factor, failed = lapack.dpotrf(K.T, lower=1, clean=0, overwrite_a=1)
    if failed:
        return None
    half_determinant = float(np.log(factor.diagonal()).sum())
    solved = lapack.dpotrs(factor, np.asfortranarray(np.hstack([drift, e])), lower=1)[0]
    KF, w = solved[:, :p], solved[:, p:]
    M = drift.T @ KF
    root = np.linalg.cholesky((M + M.T) / 2)
    Z = solve_triangular(root, KF.T, lower=True).T if p else KF  # P = K⁻¹ − Z Zᵀ
    w = w - Z @ (Z.T @ e)
    inverse = lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
    if method == "loo":
        return _leave_one_out(inverse, Z, w, common)
    freedom = n - p if method == "reml" else n
    scale = _shared(np.einsum("nc,nc->c", e, w) / freedom, common)
    loss = c * half_determinant + freedom * float(np.log(scale).sum()) / 2
    if method == "reml":
        loss += c * float(np.log(root.diagonal()).sum())
    taken = np.hstack([math.sqrt(c) * Z, w / np.sqrt(scale)]) if method == "reml" else w / np.sqrt(scale)
    Q = blas.dsyrk(-1.0, np.asfortranarray(taken), beta=float(c), c=inverse, lower=1, overwrite_c=1)
    return Judged(loss, Q.T, scale)


def _leave_one_out(inverse: FloatArray, Z: FloatArray, w: FloatArray, common: bool) -> Judged:
    n, c = w.shape
    lower = np.tril(inverse)
    P = lower + np.tril(lower, -1).T - Z @ Z.T
    diagonal = P.diagonal()
    v = w / diagonal[:, None]
    scale = _shared((w * v).mean(axis=0), common)
    loss = (n * float(np.log(scale).sum()) - c * float(np.log(diagonal).sum())) / 2
    Pv = P @ (v / scale)
    D = c / diagonal + (v**2 / scale).sum(axis=1)
    cross = Pv @ w.T
    return Judged(loss, np.ascontiguousarray((P * D) @ P - cross - cross.T), scale)


def _shared(scale: FloatArray, common: bool) -> FloatArray:
    return np.full_like(scale, scale.mean()) if common else scale
