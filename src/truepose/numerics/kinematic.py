"""Loops over pairs of samples of (10), compiled: the covariances of joint errors and Z, and their derivatives.

The formulas are those of `truepose.predictors.kinematic.kernels`, which explains them.
"""

from __future__ import annotations

import math

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.numerics.kernels import compiled


@compiled(nogil=True)
def add_joints_and_rest(
    covariance: FloatArray,
    half: FloatArray,
    lever: FloatArray,
    other_half: FloatArray,
    other_lever: FloatArray,
    std: FloatArray,
    length: FloatArray,
    place: FloatArray,
    other_place: FloatArray,
    rest_std: float,
    lower: bool,
) -> None:
    """Add Σ_j s_j² ρ(q_j, q'_j) l_j l'_jᵀ + b² ρ_Z I between m and n configurations to a matrix (r m, 3n) [mm²].

    Parameters
    ----------
    covariance : (r m, 3 n) array [mm²]
        The matrix, changed in place.
    half, other_half : (m, k, 2), (n, k, 2) arrays
        The cosine and sine of half of each joint's angle.
    lever, other_lever : (m, k, r), (n, k, 3) arrays [mm/rad]
        The levers of the joints.
    std, length : (k,) arrays [rad]
        The standard deviation and the range of each joint's error.
    place, other_place : (m, d), (n, d) arrays
        The coordinates of Z over their ranges.
    rest_std : float [mm]
        The standard deviation b of Z.
    lower : bool
        Whether only the lower triangle of blocks is added, for samples with themselves.
    """
    root3, root5 = math.sqrt(3.0), math.sqrt(5.0)
    k, rows, d = lever.shape[1], lever.shape[2], place.shape[1]
    for i in range(len(lever)):
        for j in range(i + 1 if lower else len(other_lever)):
            for t in range(k):
                sine = half[i, t, 1] * other_half[j, t, 0] - half[i, t, 0] * other_half[j, t, 1]
                a = 2.0 * abs(sine) * root3 / length[t]
                rho = std[t] * std[t] * (1.0 + a) * math.exp(-a)
                for x in range(rows):
                    left = rho * lever[i, t, x]
                    for y in range(3):
                        covariance[rows * i + x, 3 * j + y] += left * other_lever[j, t, y]
            if d:
                squared = 0.0
                for c in range(d):
                    squared += (place[i, c] - other_place[j, c]) ** 2
                a = root5 * math.sqrt(squared)
                rho = rest_std * rest_std * (1.0 + a + a * a / 3.0) * math.exp(-a)
                for x in range(3):
                    covariance[rows * i + x, 3 * j + x] += rho


@compiled(nogil=True)
def slopes(
    inverse: FloatArray,
    alpha: FloatArray,
    half: FloatArray,
    lever: FloatArray,
    std: FloatArray,
    length: FloatArray,
    place: FloatArray,
    range_of: IntArray,
    rest_std: float,
    ranges: int,
) -> FloatArray:
    """Return the derivatives of the negative log likelihood by log s_j, log l_j, log b and the log ranges of Z.

    ½ tr[(K⁻¹ − ααᵀ) ∂K], over the lower triangle of samples' blocks of K⁻¹ (3n, 3n); the others as above.
    """
    root3, root5 = math.sqrt(3.0), math.sqrt(5.0)
    k, d = lever.shape[1], place.shape[1]
    out = np.zeros(2 * k + (1 + ranges if d else 0))
    w = np.empty((3, 3))
    apart = np.empty(max(ranges, 1))
    for i in range(len(lever)):
        for j in range(i + 1):
            pairs = 1.0 if i == j else 2.0
            for x in range(3):
                for y in range(3):
                    row, column = 3 * i + x, 3 * j + y
                    stored = inverse[row, column] if row >= column else inverse[column, row]
                    w[x, y] = pairs * (stored - alpha[row] * alpha[column])
            for t in range(k):
                seen = 0.0
                for x in range(3):
                    for y in range(3):
                        seen += w[x, y] * lever[i, t, x] * lever[j, t, y]
                a = 2.0 * abs(half[i, t, 1] * half[j, t, 0] - half[i, t, 0] * half[j, t, 1]) * root3 / length[t]
                scaled = seen * std[t] * std[t] * math.exp(-a)
                out[t] += scaled * (1.0 + a)
                out[k + t] += 0.5 * scaled * a * a
            if d:
                apart[:] = 0.0
                squared = 0.0
                for c in range(d):
                    one = (place[i, c] - place[j, c]) ** 2
                    squared += one
                    apart[range_of[c]] += one
                a = root5 * math.sqrt(squared)
                scaled = (w[0, 0] + w[1, 1] + w[2, 2]) * rest_std * rest_std * math.exp(-a)
                out[2 * k] += scaled * (1.0 + a + a * a / 3.0)
                for g in range(ranges):
                    out[2 * k + 1 + g] += 0.5 * scaled * (5.0 / 3.0) * (1.0 + a) * apart[g]
    return out
