"""The correlation families as compiled formulas, and the sums over samples that Kriging needs of them.

All compiled code that contains a formula is in this one file, because numba's cache of a kernel is renewed when *its*
file changes. Distances are without unit: r = h/a, so the coordinates given to the kernels are already divided by the
range a (and turned into the axes of the anisotropy). To add a family: its formula and its slope here, an entry in both
switches, and an entry in `truepose.similarity.families.FAMILIES`.

Matérn's family is compiled where ν is half an odd number; for another ν the distances are compiled, and the Bessel
function is scipy's.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import prange, types
from numba.extending import intrinsic
from numpy.typing import ArrayLike, NDArray

from truepose.similarity.compiled import BLOCK, REORDER, compiled, pack

FloatArray = NDArray[np.float64]

SPHERICAL: Final = 0
EXPONENTIAL: Final = 1
GAUSSIAN: Final = 2
MATERN32: Final = 3
MATERN52: Final = 4
LINEAR: Final = 5
MATERN: Final = 6
STABLE: Final = 7
CUBIC: Final = 8
RATIONAL: Final = 9
HOLE: Final = 10
NUGGET: Final = 11
POWER: Final = 12
DISTANCE: Final = 13

ROOT3: Final = math.sqrt(3.0)
ROOT5: Final = math.sqrt(5.0)
LOG2_E: Final = 1 / math.log(2.0)
LN2_HIGH: Final = 6.93147180369123816490e-01
LN2_LOW: Final = 1.90821492927058770002e-10
ROUND: Final = 6755399441055744.0
TARGETS: Final = 16
ROWS: Final = 2**20
"""Bessel functions in memory at once: 8 MB."""


def correlation(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return the correlation rho(r) of a family at scaled distances r >= 0 of any shape."""
    if _needs_bessel(family, shape):
        return matern(shape, r)
    flat = np.array(r, dtype=np.float64).reshape(-1)
    _correlate(family, shape, flat)
    return flat.reshape(np.shape(r))


def slope_over_distance(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return rho'(r)/r of a family at scaled distances r of any shape; 0 at r = 0 where that is infinite."""
    if _needs_bessel(family, shape):
        return _matern_slope(shape, r)
    flat = np.array(r, dtype=np.float64).reshape(-1)
    _slope(family, shape, flat)
    return flat.reshape(np.shape(r))


def cross_correlation(family: int, u: FloatArray, samples: FloatArray, n: int, shape: float = 0.0) -> FloatArray:
    """Return rho(‖u_i − v_j‖), (m, n), C order, of scaled coordinates u (m, d) and n samples v as `pack` gives them."""
    out = np.empty((len(u), n))
    if _needs_bessel(family, shape):
        _cross_correlation(DISTANCE, 0.0, u, samples, out)
        return matern(shape, out)
    _cross_correlation(family, shape, u, samples, out)
    return out


def weighted_sum(
    family: int, u: FloatArray, samples: FloatArray, weights: FloatArray, shape: float = 0.0
) -> FloatArray:
    """Return Σ_j rho(‖u_i − v_j‖) w_jc, (m, c), of samples v and weights w (n, c) as `pack` gives them."""
    if not _needs_bessel(family, shape):
        return _weighted_sum(family, shape, u, samples, weights)
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
        return _weighted_gradient(family, shape, u, samples, weights)
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


# --- exp(-t), written so that it becomes vector instructions --------------------------------------------------------


def _double_to_int(context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), generate


def _int_to_double(context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), generate


_bits: Any = intrinsic(_double_to_int)
_from_bits: Any = intrinsic(_int_to_double)


@compiled(fastmath={"contract"}, forceinline=True)
def _decay(t: float) -> float:
    """exp(-t), t >= 0, to the last bit or two: 2^k exp(f) with |f| <= ln(2)/2, Taylor to f^13; ends at exp(-708)."""
    x = -min(t, 708.0)
    shifted = x * LOG2_E + ROUND
    k = shifted - ROUND
    f = x - k * LN2_HIGH - k * LN2_LOW
    p = 1 / 6227020800.0
    p = p * f + 1 / 479001600.0
    p = p * f + 1 / 39916800.0
    p = p * f + 1 / 3628800.0
    p = p * f + 1 / 362880.0
    p = p * f + 1 / 40320.0
    p = p * f + 1 / 5040.0
    p = p * f + 1 / 720.0
    p = p * f + 1 / 120.0
    p = p * f + 1 / 24.0
    p = p * f + 1 / 6.0
    p = p * f + 0.5
    p = p * f + 1.0
    p = p * f + 1.0
    power: float = _from_bits((_bits(shifted) + 1023) << 52)
    return p * power


# --- families: rho(r), and its slope rho'(r)/r ----------------------------------------------------------------------


@compiled(forceinline=True)
def _spherical(r: float) -> float:
    s = min(r, 1.0)
    return 1 - s * (1.5 - 0.5 * s * s)


@compiled(forceinline=True)
def _spherical_slope(r: float) -> float:
    return -1.5 / r + 1.5 * r if 0.0 < r < 1.0 else 0.0


@compiled(forceinline=True)
def _exponential_slope(r: float) -> float:
    return -_decay(r) / r if r > 0.0 else 0.0


@compiled(forceinline=True)
def _gaussian(r: float) -> float:
    return _decay(r * r)


@compiled(forceinline=True)
def _gaussian_slope(r: float) -> float:
    return -2 * _decay(r * r)


@compiled(forceinline=True)
def _matern32(r: float) -> float:
    return (1 + ROOT3 * r) * _decay(ROOT3 * r)


@compiled(forceinline=True)
def _matern32_slope(r: float) -> float:
    return -3 * _decay(ROOT3 * r)


@compiled(forceinline=True)
def _matern52(r: float) -> float:
    return (1 + ROOT5 * r * (1 + ROOT5 / 3 * r)) * _decay(ROOT5 * r)


@compiled(forceinline=True)
def _matern52_slope(r: float) -> float:
    return -5 / 3 * (1 + ROOT5 * r) * _decay(ROOT5 * r)


@compiled(forceinline=True)
def _linear_slope(r: float) -> float:
    return -1 / r if r > 0.0 else 0.0


@compiled(forceinline=True)
def _cubic(r: float) -> float:
    s = min(r, 1.0)
    q = s * s
    return 1 - q * (7 - s * (8.75 - q * (3.5 - 0.75 * q)))


@compiled(forceinline=True)
def _cubic_slope(r: float) -> float:
    s = min(r, 1.0)
    return -14 + s * (26.25 - s * s * (17.5 - 5.25 * s * s))


@compiled(forceinline=True)
def _stable(r: float, alpha: float) -> float:
    value: float = _decay(r**alpha) if r > 0.0 else 1.0
    return value


@compiled(forceinline=True)
def _stable_slope(r: float, alpha: float) -> float:
    if r == 0.0:
        return -2.0 if alpha == 2.0 else 0.0
    power = r**alpha
    value: float = -alpha * power * _decay(power) / (r * r)
    return value


@compiled(forceinline=True)
def _rational(r: float, alpha: float) -> float:
    return _decay(alpha * math.log1p(r * r / (2 * alpha)))


@compiled(forceinline=True)
def _rational_slope(r: float, alpha: float) -> float:
    return -_decay((alpha + 1) * math.log1p(r * r / (2 * alpha)))


@compiled(forceinline=True)
def _hole(r: float) -> float:
    return math.sin(r) / r if r > 0.0 else 1.0


@compiled(forceinline=True)
def _hole_slope(r: float) -> float:
    if r > 0.3:
        return (math.cos(r) - math.sin(r) / r) / (r * r)
    q = r * r
    return -(1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88 * (1 - q / 130))))) / 3


@compiled(forceinline=True)
def _power_slope(r: float, alpha: float) -> float:
    value: float = -alpha * r ** (alpha - 2) if r > 0.0 else 0.0
    return value


@compiled()
def _half_integer_matern(p: int, root: float, factor: float, r: FloatArray) -> None:
    """Replace r by factor exp(-t) p!/(2p)! Σ (p + i)!/(i! (p − i)!) (2t)^(p − i), t = root r: Matérn's ν = p + 1/2.

    Source: M. Abramowitz & I. Stegun, 10.2.15.
    """
    coefficient = np.empty(p + 1)  # of t^k, k = p − i
    coefficient[0] = factor
    for k in range(1, p + 1):
        coefficient[k] = coefficient[k - 1] * 2 * (p - k + 1) / (k * (2 * p - k + 1))
    for j in range(r.size):
        t = root * r[j]
        total = coefficient[p]
        for k in range(p - 1, -1, -1):
            total = total * t + coefficient[k]
        r[j] = total * _decay(t)


@compiled()
def _correlate(family: int, shape: float, r: FloatArray) -> None:
    """Replace r by rho(r)."""
    if family == SPHERICAL:
        for j in range(r.size):
            r[j] = _spherical(r[j])
    elif family == EXPONENTIAL:
        for j in range(r.size):
            r[j] = _decay(r[j])
    elif family == GAUSSIAN:
        for j in range(r.size):
            r[j] = _gaussian(r[j])
    elif family == MATERN32:
        for j in range(r.size):
            r[j] = _matern32(r[j])
    elif family == MATERN52:
        for j in range(r.size):
            r[j] = _matern52(r[j])
    elif family == LINEAR:
        for j in range(r.size):
            r[j] = 1 - r[j]
    elif family == MATERN:
        _half_integer_matern(int(shape), math.sqrt(2 * shape), 1.0, r)
    elif family == STABLE:
        for j in range(r.size):
            r[j] = _stable(r[j], shape)
    elif family == CUBIC:
        for j in range(r.size):
            r[j] = _cubic(r[j])
    elif family == RATIONAL:
        for j in range(r.size):
            r[j] = _rational(r[j], shape)
    elif family == HOLE:
        for j in range(r.size):
            r[j] = _hole(r[j])
    elif family == NUGGET:
        for j in range(r.size):
            r[j] = 1.0 if r[j] == 0.0 else 0.0
    elif family == POWER:
        for j in range(r.size):
            r[j] = 1 - r[j] ** shape


@compiled()
def _slope(family: int, shape: float, r: FloatArray) -> None:
    """Replace r by rho'(r)/r."""
    if family == SPHERICAL:
        for j in range(r.size):
            r[j] = _spherical_slope(r[j])
    elif family == EXPONENTIAL:
        for j in range(r.size):
            r[j] = _exponential_slope(r[j])
    elif family == GAUSSIAN:
        for j in range(r.size):
            r[j] = _gaussian_slope(r[j])
    elif family == MATERN32:
        for j in range(r.size):
            r[j] = _matern32_slope(r[j])
    elif family == MATERN52:
        for j in range(r.size):
            r[j] = _matern52_slope(r[j])
    elif family == LINEAR:
        for j in range(r.size):
            r[j] = _linear_slope(r[j])
    elif family == MATERN:
        if shape < 1.0:
            for j in range(r.size):
                r[j] = _exponential_slope(r[j])
        else:
            _half_integer_matern(int(shape) - 1, math.sqrt(2 * shape), -shape / (shape - 1), r)
    elif family == STABLE:
        for j in range(r.size):
            r[j] = _stable_slope(r[j], shape)
    elif family == CUBIC:
        for j in range(r.size):
            r[j] = _cubic_slope(r[j])
    elif family == RATIONAL:
        for j in range(r.size):
            r[j] = _rational_slope(r[j], shape)
    elif family == HOLE:
        for j in range(r.size):
            r[j] = _hole_slope(r[j])
    elif family == NUGGET:
        for j in range(r.size):
            r[j] = 0.0
    elif family == POWER:
        for j in range(r.size):
            r[j] = _power_slope(r[j], shape)


# --- kernels over (targets) x (packed samples) ----------------------------------------------------------------------


@compiled(fastmath=REORDER)
def _distances(x: FloatArray, block: FloatArray, out: FloatArray) -> None:
    out[:] = 0.0
    for a in range(x.size):
        row = block[a]
        for j in range(out.size):
            z = row[j] - x[a]
            out[j] += z * z
    for j in range(out.size):
        out[j] = math.sqrt(out[j])


@compiled(fastmath=REORDER)
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@compiled(fastmath=REORDER)
def _dot_offset(weight: FloatArray, slope: FloatArray, x: float, row: FloatArray) -> float:
    total = 0.0
    for j in range(weight.size):
        total += weight[j] * slope[j] * (x - row[j])
    return total


@compiled(parallel=True)
def _cross_correlation(family: int, shape: float, u: FloatArray, samples: FloatArray, out: FloatArray) -> None:
    n = out.shape[1]
    for i in prange(u.shape[0]):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            _distances(u[i], samples[b], r)
            _correlate(family, shape, r)
            stop = min(BLOCK, n - b * BLOCK)
            out[i, b * BLOCK : b * BLOCK + stop] = r[:stop]


@compiled(parallel=True)
def _weighted_sum(family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    m, columns = u.shape[0], weights.shape[1]
    out = np.zeros((m, columns))
    for tile in prange((m + TARGETS - 1) // TARGETS):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            for i in range(tile * TARGETS, min(m, (tile + 1) * TARGETS)):
                _distances(u[i], samples[b], r)
                _correlate(family, shape, r)
                for c in range(columns):
                    out[i, c] += _dot(weights[b, c], r)
    return out


@compiled(parallel=True)
def _weighted_gradient(
    family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray
) -> FloatArray:
    m, d, columns = u.shape[0], u.shape[1], weights.shape[1]
    out = np.zeros((m, columns, d))
    for i in prange(m):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            _distances(u[i], samples[b], r)
            _slope(family, shape, r)
            for c in range(columns):
                for a in range(d):
                    out[i, c, a] += _dot_offset(weights[b, c], r, u[i, a], samples[b, a])
    return out


def range_derivatives(family: int, u: FloatArray, weights: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return Σ_(j>i) W_ij ∂rho_ij/∂log a_k, (d,), of scaled points u (n, d) and the upper triangle of W (n, n).

    ∂rho/∂log a_k = −rho'(r)/r (u_ik − u_jk)²; the sum over k is the derivative by one common range.
    """
    samples = pack(u)
    if not _needs_bessel(family, shape):
        return np.asarray(_range_derivatives(family, shape, u, samples, weights).sum(axis=0))
    r = cross_correlation(DISTANCE, u, samples, len(u))
    product = np.triu(weights, 1) * -_matern_slope(shape, r)
    return np.array([(product * (a[:, None] - a) ** 2).sum() for a in u.T])


@compiled(fastmath=REORDER)
def _dot_square(
    weight: FloatArray, offset: int, slope: FloatArray, x: float, row: FloatArray, start: int, stop: int
) -> float:
    total = 0.0
    for j in range(start, stop):
        z = x - row[j]
        total -= weight[offset + j] * slope[j] * z * z
    return total


@compiled(parallel=True)
def _range_derivatives(
    family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray
) -> FloatArray:
    n, d = u.shape
    out = np.zeros((n, d))
    for i in prange(n):
        r = np.empty(BLOCK)
        for b in range(i // BLOCK, samples.shape[0]):
            start, stop = max(i + 1 - b * BLOCK, 0), min(BLOCK, n - b * BLOCK)
            _distances(u[i], samples[b], r)
            _slope(family, shape, r)
            for a in range(d):
                out[i, a] += _dot_square(weights[i], b * BLOCK, r, u[i, a], samples[b, a], start, stop)
    return out
