"""Correlations of the families, and sums of them over samples: compiled where they can be.

Matérn's family is compiled where ν is half an odd number; for another ν the distances are compiled, and the Bessel
function is scipy's. The coordinates are already divided by the range.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.numerics import kernels
from truepose.numerics.kernels import DISTANCE, MATERN, pack

ROWS: Final = 2**20
"""Bessel functions in memory at once: 8 MB."""


def correlation(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return the correlation rho(r) of a family at scaled distances r >= 0 of any shape."""
    if _needs_bessel(family, shape):
        return matern(shape, r)
    flat = np.square(np.asarray(r, dtype=np.float64)).reshape(-1)
    kernels.correlate(family, shape, flat)
    return flat.reshape(np.shape(r))


def slope_over_distance(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return rho'(r)/r of a family at scaled distances r of any shape; 0 at r = 0 where that is infinite."""
    if _needs_bessel(family, shape):
        return _matern_slope(shape, r)
    flat = np.square(np.asarray(r, dtype=np.float64)).reshape(-1)
    kernels.slope(family, shape, flat)
    return flat.reshape(np.shape(r))


def cross_correlation(family: int, u: FloatArray, samples: FloatArray, n: int, shape: float = 0.0) -> FloatArray:
    """Return rho(‖u_i − v_j‖), (m, n), C order, of scaled coordinates u (m, d) and n samples v as `pack` gives them."""
    out = np.empty((len(u), n))
    if _needs_bessel(family, shape):
        kernels.cross_correlation(DISTANCE, 0.0, u, samples, out)
        return matern(shape, out)
    kernels.cross_correlation(family, shape, u, samples, out)
    return out


def weighted_sum(
    family: int, u: FloatArray, samples: FloatArray, weights: FloatArray, shape: float = 0.0
) -> FloatArray:
    """Return Σ_j rho(‖u_i − v_j‖) w_jc, (m, c), of samples v and weights w (n, c) as `pack` gives them."""
    if not _needs_bessel(family, shape):
        return kernels.weighted_sum(family, shape, u, samples, weights)
    w = _unpack(weights)
    out = np.empty((len(u), w.shape[1]))
    for part in _chunks(len(u), len(w)):
        out[part] = cross_correlation(family, u[part], samples, len(w), shape) @ w
    return out


def weighted_gradient(
    family: int, u: FloatArray, samples: FloatArray, weights: FloatArray, shape: float = 0.0
) -> FloatArray:
    """Return ∂/∂u of `weighted_sum`, (m, c, d)."""
    if not _needs_bessel(family, shape):
        return kernels.weighted_gradient(family, shape, u, samples, weights)
    v, w = _unpack(samples), _unpack(weights)
    out = np.empty((len(u), w.shape[1], u.shape[1]))
    moments = (w[:, :, None] * v[:, None, :]).reshape(len(v), -1)
    for part in _chunks(len(u), len(w)):
        slope = _matern_slope(shape, cross_correlation(DISTANCE, u[part], samples, len(w)))
        out[part] = (slope @ w)[:, :, None] * u[part, None, :] - (slope @ moments).reshape(-1, *out.shape[1:])
    return out


def matern(nu: float, r: ArrayLike) -> FloatArray:
    """Return 2^(1−ν)/Γ(ν) t^ν K_ν(t), t = √(2ν) r; 1 at r = 0. Source: M. L. Stein, Interpolation (1999), §2.7."""
    return _bessel(nu, math.sqrt(2 * nu) * np.asarray(r, dtype=np.float64))


def correlation_by_shape(family: str, r: FloatArray, shape: float) -> FloatArray:
    """Return ∂ρ/∂shape at scaled distances r; by Matérn's ν in central differences of fourth order."""
    safe = np.where(r > 0, r, 1.0)
    if family == "stable":
        power = safe**shape
        return np.where(r > 0, -power * np.log(safe) * np.exp(-power), 0.0)
    if family == "power":
        return np.where(r > 0, -(safe**shape) * np.log(safe), 0.0)
    if family == "rational":
        q = r * r / (2 * shape)
        return np.asarray((q / (1 + q) - np.log1p(q)) * (1 + q) ** -shape)
    step = 2e-3 * shape
    near = matern(shape + step, r) - matern(shape - step, r)
    far = matern(shape + 2 * step, r) - matern(shape - 2 * step, r)
    return np.asarray((8 * near - far) / (12 * step))


def _bessel(nu: float, t: FloatArray) -> FloatArray:
    from scipy.special import gammaln, kve

    tiny = t < 1e-8 * max(1.0, math.sqrt(nu))  # 1 − rho is below 1e-16 there where ν >= 1; a power of t below that
    safe = np.where(tiny, 1.0, t)
    value = np.exp((1 - nu) * math.log(2.0) - gammaln(nu) + nu * np.log(safe) - safe) * kve(nu, safe)
    if not tiny.any():
        return np.asarray(value, dtype=np.float64)
    near = 1.0 if nu > 0.9 else 1 - math.exp(gammaln(1 - nu) - gammaln(1 + nu)) * (t / 2) ** (2 * nu)
    return np.asarray(np.where(tiny, near, value), dtype=np.float64)


def _matern_slope(nu: float, r: FloatArray) -> FloatArray:
    """rho'(r)/r: −ν/(ν − 1) times the function of ν − 1 at the same t; below ν = 1 by K_(1−ν)."""
    from scipy.special import gammaln, kve

    t = math.sqrt(2 * nu) * r
    if nu > 1:
        return -nu / (nu - 1) * _bessel(nu - 1, t)
    safe = np.where(t > 0, t, 1.0)
    size = np.exp((2 - nu) * math.log(2.0) - gammaln(nu) + (nu - 1) * np.log(safe) - safe)
    return np.asarray(np.where(t > 0, -nu * size * kve(1 - nu, safe), 0.0))


def _needs_bessel(family: int, shape: float) -> bool:
    return family == MATERN and not (shape + 0.5).is_integer()


def _unpack(packed: FloatArray) -> FloatArray:
    """Return the rows that `pack` laid in blocks, (n, c), with the zeros that fill the last block."""
    return packed.transpose(0, 2, 1).reshape(-1, packed.shape[1])


def _chunks(m: int, n: int) -> list[slice]:
    rows = max(1, ROWS // n)
    return [slice(start, min(start + rows, m)) for start in range(0, m, rows)]


def slope_moments(
    family: int, u: FloatArray, weights: FloatArray, shape: float = 0.0, *, full: bool = False
) -> FloatArray:
    """Return Σ_(j>i) W_ij (−rho'(r)/r) Δu Δuᵀ, (d, d), of scaled points u (n, d) and the upper triangle of W (n, n).

    Its diagonal is Σ W_ij ∂rho_ij/∂log a_k, since ∂rho_ij/∂log a_k = −rho'(r)/r (u_ik − u_jk)²; the trace is the
    derivative by one common range. The other elements, zero unless `full`, are for rotations of the axes.
    """
    samples = pack(u)
    if _needs_bessel(family, shape):
        r = cross_correlation(DISTANCE, u, samples, len(u))
        product = np.triu(weights, 1) * -_matern_slope(shape, r)
        gaps = u[:, None] - u[None]
        return np.asarray(np.einsum("ij,ija,ijc->ac", product, gaps, gaps, optimize=True))
    lower: FloatArray = kernels.slope_moments(family, shape, u, samples, weights, full).sum(axis=0)
    return lower + np.tril(lower, -1).T
