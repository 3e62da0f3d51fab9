"""The correlation families as compiled formulas, and the sums over samples that Kriging needs of them.

All compiled code that contains a formula is in this one file, because numba's cache of a kernel is renewed when *its*
file changes. Distances are without unit: r = h/a, so the coordinates given to the kernels are already divided by the
range a. To add a family: its formula and its slope here, an entry in both switches, and an entry in
`truepose.similarity.models.FAMILIES`.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import prange, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from truepose.similarity.compiled import BLOCK, REORDER, compiled

FloatArray = NDArray[np.float64]

SPHERICAL: Final = 0
EXPONENTIAL: Final = 1
GAUSSIAN: Final = 2
MATERN32: Final = 3
MATERN52: Final = 4
LINEAR: Final = 5

ROOT3: Final = math.sqrt(3.0)
ROOT5: Final = math.sqrt(5.0)
LOG2_E: Final = 1 / math.log(2.0)
LN2_HIGH: Final = 6.93147180369123816490e-01
LN2_LOW: Final = 1.90821492927058770002e-10
ROUND: Final = 6755399441055744.0
TARGETS: Final = 16


def correlation(family: int, r: FloatArray) -> FloatArray:
    """Return the correlation rho(r) of a family at scaled distances r >= 0 of any shape."""
    flat = np.array(r, dtype=np.float64).reshape(-1)
    _correlate(family, flat)
    return flat.reshape(np.shape(r))


def slope_over_distance(family: int, r: FloatArray) -> FloatArray:
    """Return rho'(r)/r of a family at scaled distances r of any shape; 0 at r = 0 where rho has a cusp."""
    flat = np.array(r, dtype=np.float64).reshape(-1)
    _slope(family, flat)
    return flat.reshape(np.shape(r))


def cross_correlation(family: int, u: FloatArray, samples: FloatArray, n: int) -> FloatArray:
    """Return rho(‖u_i − v_j‖), (m, n), C order, of scaled coordinates u (m, d) and n samples v as `pack` gives them."""
    out = np.empty((len(u), n))
    _cross_correlation(family, u, samples, out)
    return out


def weighted_sum(family: int, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    """Return Σ_j rho(‖u_i − v_j‖) w_jc, (m, c), of samples v and weights w (n, c) as `pack` gives them."""
    return _weighted_sum(family, u, samples, weights)


def weighted_gradient(family: int, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    """Return ∂/∂u of `weighted_sum`, (m, c, d)."""
    return _weighted_gradient(family, u, samples, weights)


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


@compiled()
def _correlate(family: int, r: FloatArray) -> None:
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
    else:
        for j in range(r.size):
            r[j] = 1 - r[j]


@compiled()
def _slope(family: int, r: FloatArray) -> None:
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
    else:
        for j in range(r.size):
            r[j] = _linear_slope(r[j])


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
def _cross_correlation(family: int, u: FloatArray, samples: FloatArray, out: FloatArray) -> None:
    n = out.shape[1]
    for i in prange(u.shape[0]):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            _distances(u[i], samples[b], r)
            _correlate(family, r)
            stop = min(BLOCK, n - b * BLOCK)
            out[i, b * BLOCK : b * BLOCK + stop] = r[:stop]


@compiled(parallel=True)
def _weighted_sum(family: int, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    m, columns = u.shape[0], weights.shape[1]
    out = np.zeros((m, columns))
    for tile in prange((m + TARGETS - 1) // TARGETS):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            for i in range(tile * TARGETS, min(m, (tile + 1) * TARGETS)):
                _distances(u[i], samples[b], r)
                _correlate(family, r)
                for c in range(columns):
                    out[i, c] += _dot(weights[b, c], r)
    return out


@compiled(parallel=True)
def _weighted_gradient(family: int, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    m, d, columns = u.shape[0], u.shape[1], weights.shape[1]
    out = np.zeros((m, columns, d))
    for i in prange(m):
        r = np.empty(BLOCK)
        for b in range(samples.shape[0]):
            _distances(u[i], samples[b], r)
            _slope(family, r)
            for c in range(columns):
                for a in range(d):
                    out[i, c, a] += _dot_offset(weights[b, c], r, u[i, a], samples[b, a])
    return out
