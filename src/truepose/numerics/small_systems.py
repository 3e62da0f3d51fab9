"""Many small covariance matrices at once: the compiled core of local Kriging and of Vecchia's approximation.

Eight systems are worked on together, one in each lane of a vector, so that every step of the elimination is a vector
instruction. No formula of a correlation is compiled here: distances go out, correlations come in.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.numerics.kernels import compiled
from truepose.numerics.threads import in_threads

LANES: Final = 8


def pair_distances(u: FloatArray, targets: FloatArray, near: IntArray) -> FloatArray:
    """Return the distances among the neighbours of each target and to the target, (b, pairs, LANES).

    Parameters
    ----------
    u : (n, d) array
        The points.
    targets : (m, d) array
        The targets.
    near : (m, k) array of int
        The points near each target.

    Returns
    -------
    (b, k (k + 1)/2, LANES) array
        Of LANES targets in each of b batches, the last one filled up. First the pairs (0, 1), (0, 2) … (k−2, k−1) of
        neighbours, then the k distances to the target.
    """
    m, k = near.shape
    out = np.empty((-(-m // LANES), k * (k + 1) // 2, LANES))
    in_threads(
        _pair_distances, len(out), u, targets, np.ascontiguousarray(near), out
    )  # one memory layout: compiled once
    return out


def eliminate(
    rho: FloatArray, near: IntArray, signal: float, diagonal: FloatArray, at_target: FloatArray, right: FloatArray
) -> FloatArray:
    """Return [k0, B]ᵀ K⁻¹ [k0, B] of each target's neighbours, (m, s, s), s = 1 + columns of B.

    Parameters
    ----------
    rho : (b, pairs, LANES) array
        The correlations at the distances of `pair_distances`.
    near : (m, k) array of int
        The points near each target.
    signal : float
        The factor on rho.
    diagonal : (n,) array
        The diagonal of K at each point.
    at_target : (m,) array
        The addition to the covariance of a target with the first of its neighbours.
    right : (n, s − 1) array
        The rows of B at all points.

    Returns
    -------
    (m, s, s) array
        The products; NaN where K is not positive definite.
    """
    s = 1 + right.shape[1]
    out = np.empty((len(near), s, s))
    in_threads(_eliminate, len(rho), rho, np.ascontiguousarray(near), signal, diagonal, at_target, right, out)
    return out


@compiled(nogil=True)
def _pair_distances(start: int, stop: int, u: FloatArray, targets: FloatArray, near: IntArray, out: FloatArray) -> None:
    m, k = near.shape
    d = u.shape[1]
    x = np.empty((k + 1, d, LANES))
    for b in range(start, stop):
        for lane in range(LANES):
            row = min(b * LANES + lane, m - 1)
            for i in range(k):
                for a in range(d):
                    x[i, a, lane] = u[near[row, i], a]
            for a in range(d):
                x[k, a, lane] = targets[row, a]
        pair, to_target = 0, k * (k - 1) // 2
        for i in range(k):
            for j in range(i + 1, k + 1):
                here = pair if j < k else to_target + i
                for lane in range(LANES):
                    total = 0.0
                    for a in range(d):
                        z = x[i, a, lane] - x[j, a, lane]
                        total += z * z
                    out[b, here, lane] = math.sqrt(total)
                if j < k:
                    pair += 1


@compiled(fastmath={"contract"})
def _subtract(row: FloatArray, factor: FloatArray, other: FloatArray) -> None:
    """row[t] −= factor · other[t] in all lanes: loads before stores, so that they become one vector."""
    f0, f1, f2, f3 = factor[0], factor[1], factor[2], factor[3]
    f4, f5, f6, f7 = factor[4], factor[5], factor[6], factor[7]
    for t in range(row.shape[0]):
        r0, r1 = row[t, 0] - f0 * other[t, 0], row[t, 1] - f1 * other[t, 1]
        r2, r3 = row[t, 2] - f2 * other[t, 2], row[t, 3] - f3 * other[t, 3]
        r4, r5 = row[t, 4] - f4 * other[t, 4], row[t, 5] - f5 * other[t, 5]
        r6, r7 = row[t, 6] - f6 * other[t, 6], row[t, 7] - f7 * other[t, 7]
        row[t, 0], row[t, 1], row[t, 2], row[t, 3] = r0, r1, r2, r3
        row[t, 4], row[t, 5], row[t, 6], row[t, 7] = r4, r5, r6, r7


@compiled(nogil=True)
def _eliminate(
    start: int, stop: int, rho: FloatArray, near: IntArray, signal: float, diagonal: FloatArray, at_target: FloatArray,
    right: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    m, k = near.shape
    s = out.shape[1]
    for b in range(start, stop):
        a = np.zeros((k + s, k + s, LANES))  # rows of U, then minus the Schur complement
        pair, to_target = 0, k * (k - 1) // 2
        for i in range(k):
            for j in range(i + 1, k):
                for lane in range(LANES):
                    a[i, j, lane] = signal * rho[b, pair, lane]
                pair += 1
            for lane in range(LANES):
                a[i, k, lane] = signal * rho[b, to_target + i, lane]
        for lane in range(LANES):
            row = min(b * LANES + lane, m - 1)
            a[0, k, lane] += at_target[row]
            for i in range(k):
                a[i, i, lane] = diagonal[near[row, i]]
                for c in range(s - 1):
                    a[i, k + 1 + c, lane] = right[near[row, i], c]
        for i in range(k):
            for lane in range(LANES):
                pivot = a[i, i, lane]
                scale = 1 / math.sqrt(pivot) if pivot > 0.0 else math.nan
                for j in range(i, k + s):
                    a[i, j, lane] *= scale
            for j in range(i + 1, k + s):
                _subtract(a[j, j:], a[i, j], a[i, j:])
        for lane in range(min(LANES, m - b * LANES)):
            for p in range(s):
                for q in range(p, s):
                    out[b * LANES + lane, p, q] = -a[k + p, k + q, lane]
                    out[b * LANES + lane, q, p] = -a[k + p, k + q, lane]
