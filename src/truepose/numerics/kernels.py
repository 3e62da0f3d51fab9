"""The correlation families as compiled formulas, and the sums over samples that Kriging needs of them.

All compiled code that contains a formula is in this one file, because numba's cache of a kernel is renewed when *its*
file changes. Distances are without unit: r = h/a, so the coordinates given to the kernels are already divided by the
range a (and turned into the axes of the anisotropy). Squared distances q = r² come in: the root is taken in the loop of
the formula, where the processor does it beside the exponential. To add a family: its formula and its slope here, an
entry in both switches, and an entry in `truepose.similarity.structure.FAMILIES`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np

from truepose._typing import FloatArray
from truepose.numerics.first_use import register
from truepose.numerics.threads import in_threads

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
POLYNOMIAL: Final = (
    2.5100375929185925e-08,
    2.762007600563138e-07,
    2.7557268480106926e-06,
    2.480152132210459e-05,
    0.00019841269863040675,
    0.001388888891719689,
    0.008333333333330065,
    0.041666666666624164,
    0.16666666666666669,
    0.5000000000000001,
)
"""(exp(f) − 1 − f)/f² for |f| <= ln(2)/2 from f^9 down: Chebyshev's fit, which leaves 1.3e-17 of exp(f)."""
TARGETS: Final = 16


# --- how kernels are compiled -----------------------------------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])

_NOT_KEPT: Final = (
    "compiled loops cannot be kept: each start compiles them anew; set NUMBA_CACHE_DIR to a folder that may be written"
)

REORDER: Final = {"reassoc", "contract", "nsz"}
"""Fast-math flags that let a sum be vectorised; NaN and infinity keep their meaning."""

BLOCK: Final = 256
"""Largest number of points in one block of `pack`: a distance buffer of 2 kB fits into the first-level cache."""


def compiled(**options: Any) -> Callable[[F], F]:
    """Return numba's `njit` with this project's options, typed; `truepose.numerics.warm_up` calls each kernel."""

    def decorated(function: F) -> Any:
        try:
            return register(numba.njit(cache=True, error_model="numpy", **options)(function))
        except RuntimeError:  # there is no folder that it may write
            warnings.warn(_NOT_KEPT, stacklevel=1)  # once for all kernels
            return register(numba.njit(error_model="numpy", **options)(function))

    return cast("Callable[[F], F]", decorated)


def pack(columns: FloatArray) -> FloatArray:
    """Return the rows of an (n, c) array in blocks (b, c, width) padded with zeros: inner loops run over points.

    The width is `BLOCK`, or less where all rows fit into one block.

    Examples
    --------
    >>> pack(np.ones((300, 3))).shape, pack(np.ones((100, 3))).shape
    ((2, 3, 256), (1, 3, 112))
    """
    n, c = columns.shape
    width = min(BLOCK, -(-max(n, 1) // 16) * 16)
    blocks = -(-n // width)
    padded = np.zeros((blocks * width, c))
    padded[:n] = columns
    return np.ascontiguousarray(padded.reshape(blocks, width, c).transpose(0, 2, 1))


# --- exp(-t) as vector instructions -----------------------------------------------------------------------------------


@compiled(fastmath={"contract"}, forceinline=True)
def _decay(t: float) -> float:
    """Return exp(-t), t >= 0, to the last bit or two: 2^k exp(f) with |f| <= ln(2)/2; at least exp(-708).

    LLVM vectorises the loops around it, which it cannot do with a call of the C library's exp.
    """
    x = -min(t, 708.0)
    shifted = x * LOG2_E + ROUND
    k = shifted - ROUND
    f = x - k * LN2_HIGH - k * LN2_LOW
    p = POLYNOMIAL[0]
    p = p * f + POLYNOMIAL[1]
    p = p * f + POLYNOMIAL[2]
    p = p * f + POLYNOMIAL[3]
    p = p * f + POLYNOMIAL[4]
    p = p * f + POLYNOMIAL[5]
    p = p * f + POLYNOMIAL[6]
    p = p * f + POLYNOMIAL[7]
    p = p * f + POLYNOMIAL[8]
    p = p * f + POLYNOMIAL[9]
    p = p * f + 1.0
    p = p * f + 1.0
    bits = (np.float64(shifted).view(np.int64) + 1023) << 52
    power: float = np.int64(bits).view(np.float64)
    return p * power


# --- families: rho(r), and its slope rho'(r)/r ------------------------------------------------------------------------


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
def _matern32(r: float) -> float:
    return (1 + ROOT3 * r) * _decay(ROOT3 * r)


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
def _half_integer_matern(p: int, root: float, factor: float, q: FloatArray) -> None:
    """Replace q by factor exp(-t) p!/(2p)! Σ (p + i)!/(i! (p − i)!) (2t)^(p − i), t = root r: Matérn's ν = p + 1/2.

    Source: M. Abramowitz & I. Stegun, 10.2.15.
    """
    coefficient = np.empty(p + 1)  # of t^k, k = p − i
    coefficient[0] = factor
    for k in range(1, p + 1):
        coefficient[k] = coefficient[k - 1] * 2 * (p - k + 1) / (k * (2 * p - k + 1))
    for j in range(q.size):
        t = root * math.sqrt(q[j])
        total = coefficient[p]
        for k in range(p - 1, -1, -1):
            total = total * t + coefficient[k]
        q[j] = total * _decay(t)


@compiled()
def correlate(family: int, shape: float, q: FloatArray) -> None:
    """Replace squared distances q by rho(r)."""
    if family == SPHERICAL:
        for j in range(q.size):
            q[j] = _spherical(math.sqrt(q[j]))
    elif family == EXPONENTIAL:
        for j in range(q.size):
            q[j] = _decay(math.sqrt(q[j]))
    elif family == GAUSSIAN:
        for j in range(q.size):
            q[j] = _decay(q[j])
    elif family == MATERN32:
        for j in range(q.size):
            q[j] = _matern32(math.sqrt(q[j]))
    elif family == MATERN52:
        for j in range(q.size):
            q[j] = _matern52(math.sqrt(q[j]))
    elif family == LINEAR:
        for j in range(q.size):
            q[j] = 1 - math.sqrt(q[j])
    elif family == MATERN:
        _half_integer_matern(int(shape), math.sqrt(2 * shape), 1.0, q)
    elif family == STABLE:
        for j in range(q.size):
            q[j] = _stable(math.sqrt(q[j]), shape)
    elif family == CUBIC:
        for j in range(q.size):
            q[j] = _cubic(math.sqrt(q[j]))
    elif family == RATIONAL:
        for j in range(q.size):
            q[j] = _decay(shape * math.log1p(q[j] / (2 * shape)))
    elif family == HOLE:
        for j in range(q.size):
            q[j] = _hole(math.sqrt(q[j]))
    elif family == NUGGET:
        for j in range(q.size):
            q[j] = 1.0 if q[j] == 0.0 else 0.0
    elif family == POWER:
        for j in range(q.size):
            q[j] = 1 - math.sqrt(q[j]) ** shape
    elif family == DISTANCE:
        for j in range(q.size):
            q[j] = math.sqrt(q[j])


@compiled()
def slope(family: int, shape: float, q: FloatArray) -> None:
    """Replace squared distances q by rho'(r)/r."""
    if family == SPHERICAL:
        for j in range(q.size):
            q[j] = _spherical_slope(math.sqrt(q[j]))
    elif family == EXPONENTIAL:
        for j in range(q.size):
            q[j] = _exponential_slope(math.sqrt(q[j]))
    elif family == GAUSSIAN:
        for j in range(q.size):
            q[j] = -2 * _decay(q[j])
    elif family == MATERN32:
        for j in range(q.size):
            q[j] = -3 * _decay(ROOT3 * math.sqrt(q[j]))
    elif family == MATERN52:
        for j in range(q.size):
            q[j] = _matern52_slope(math.sqrt(q[j]))
    elif family == LINEAR:
        for j in range(q.size):
            q[j] = _linear_slope(math.sqrt(q[j]))
    elif family == MATERN:
        if shape < 1.0:
            for j in range(q.size):
                q[j] = _exponential_slope(math.sqrt(q[j]))
        else:
            _half_integer_matern(int(shape) - 1, math.sqrt(2 * shape), -shape / (shape - 1), q)
    elif family == STABLE:
        for j in range(q.size):
            q[j] = _stable_slope(math.sqrt(q[j]), shape)
    elif family == CUBIC:
        for j in range(q.size):
            q[j] = _cubic_slope(math.sqrt(q[j]))
    elif family == RATIONAL:
        for j in range(q.size):
            q[j] = -_decay((shape + 1) * math.log1p(q[j] / (2 * shape)))
    elif family == HOLE:
        for j in range(q.size):
            q[j] = _hole_slope(math.sqrt(q[j]))
    elif family == NUGGET:
        for j in range(q.size):
            q[j] = 0.0
    elif family == POWER:
        for j in range(q.size):
            q[j] = _power_slope(math.sqrt(q[j]), shape)


# --- kernels over (targets) x (packed samples) ------------------------------------------------------------------------


@compiled(fastmath=REORDER)
def squared_distances(x: FloatArray, block: FloatArray, out: FloatArray) -> None:
    """Set out (width,) to the squared distances of x (d,) and one block of packed points; three coordinates at once."""
    if x.size == 3:
        x0, x1, x2 = x[0], x[1], x[2]
        row0, row1, row2 = block[0], block[1], block[2]
        for j in range(out.size):
            z0, z1, z2 = row0[j] - x0, row1[j] - x1, row2[j] - x2
            out[j] = z0 * z0 + z1 * z1 + z2 * z2
        return
    out[:] = 0.0
    for a in range(x.size):
        row = block[a]
        for j in range(out.size):
            z = row[j] - x[a]
            out[j] += z * z


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


def cross_correlation(family: int, shape: float, u: FloatArray, samples: FloatArray, out: FloatArray) -> None:
    """Set out (m, n) to rho of targets and points."""
    in_threads(_cross_correlation, len(u), family, shape, u, samples, out)


@compiled(nogil=True)
def _cross_correlation(
    start: int, stop: int, family: int, shape: float, u: FloatArray, samples: FloatArray, out: FloatArray
) -> None:
    n, width = out.shape[1], samples.shape[2]
    for i in range(start, stop):
        for b in range(samples.shape[0]):
            row = out[i, b * width : min(n, (b + 1) * width)]
            squared_distances(u[i], samples[b], row)
            correlate(family, shape, row)


def weighted_sum(family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    """Return Σ_j rho_ij w_jc, (m, c)."""
    out = np.zeros((len(u), weights.shape[1]))
    in_threads(_weighted_sum, -(-len(u) // TARGETS), family, shape, u, samples, weights, out)
    return out


@compiled(nogil=True)
def _weighted_sum(
    start: int,
    stop: int,
    family: int,
    shape: float,
    u: FloatArray,
    samples: FloatArray,
    weights: FloatArray,
    out: FloatArray,
) -> None:
    m, columns = out.shape
    r = np.empty(samples.shape[2])
    for tile in range(start, stop):
        for b in range(samples.shape[0]):
            for i in range(tile * TARGETS, min(m, (tile + 1) * TARGETS)):
                squared_distances(u[i], samples[b], r)
                correlate(family, shape, r)
                for c in range(columns):
                    out[i, c] += _dot(weights[b, c], r)


def weighted_gradient(family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray) -> FloatArray:
    """Return ∂/∂u of `weighted_sum`, (m, c, d)."""
    out = np.zeros((len(u), weights.shape[1], u.shape[1]))
    in_threads(_weighted_gradient, len(u), family, shape, u, samples, weights, out)
    return out


@compiled(nogil=True)
def _weighted_gradient(
    start: int,
    stop: int,
    family: int,
    shape: float,
    u: FloatArray,
    samples: FloatArray,
    weights: FloatArray,
    out: FloatArray,
) -> None:
    d, columns = u.shape[1], weights.shape[1]
    r = np.empty(samples.shape[2])
    for i in range(start, stop):
        for b in range(samples.shape[0]):
            squared_distances(u[i], samples[b], r)
            slope(family, shape, r)
            for c in range(columns):
                for a in range(d):
                    out[i, c, a] += _dot_offset(weights[b, c], r, u[i, a], samples[b, a])


@compiled(fastmath=REORDER)
def _dot_product(
    weight: FloatArray,
    slope: FloatArray,
    x: float,
    row: FloatArray,
    y: float,
    other: FloatArray,
    span: tuple[int, int, int],
) -> float:
    total = 0.0
    offset, start, stop = span
    for j in range(start, stop):
        total -= weight[offset + j] * slope[j] * (x - row[j]) * (y - other[j])
    return total


def slope_moments(
    family: int, shape: float, u: FloatArray, samples: FloatArray, weights: FloatArray, full: bool
) -> FloatArray:
    """Return Σ_(j>i) W_ij (−rho'/r) Δu Δuᵀ for each i, (n, d, d): its lower triangle if `full`, else its diagonal."""
    n, d = u.shape
    out = np.zeros((n, d, d))
    in_threads(_slope_moments, n, family, shape, u, samples, weights, full, out)
    return out


@compiled(nogil=True)
def _slope_moments(
    first: int,
    last: int,
    family: int,
    shape: float,
    u: FloatArray,
    samples: FloatArray,
    weights: FloatArray,
    full: bool,
    out: FloatArray,
) -> None:
    (n, d), width = u.shape, samples.shape[2]
    r = np.empty(width)
    for i in range(first, last):
        for b in range(i // width, samples.shape[0]):
            start, stop = max(i + 1 - b * width, 0), min(width, n - b * width)
            squared_distances(u[i], samples[b], r)
            slope(family, shape, r)
            for a in range(d):
                for c in range(0 if full else a, a + 1):
                    out[i, a, c] += _dot_product(
                        weights[i], r, u[i, a], samples[b, a], u[i, c], samples[b, c], (b * width, start, stop)
                    )
