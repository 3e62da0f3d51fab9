"""Plain numpy, scipy and numba versions of compiled code: the tests' oracles, and what the benchmarks compare with."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist, pdist

ROOT3 = math.sqrt(3.0)


def matern32(u: Any, v: Any) -> Any:
    """Return the correlations of scaled points u (m, d) and v (n, d) by numpy."""
    t = ROOT3 * cdist(u, v)
    return (1 + t) * np.exp(-t)


@numba.njit(error_model="numpy")
def matern32_by_loops(u: Any, v: Any) -> Any:
    """Return the same by numba, with the C library's exponential."""
    out = np.empty((len(u), len(v)))
    for i in range(len(u)):
        for j in range(len(v)):
            square = 0.0
            for a in range(u.shape[1]):
                square += (u[i, a] - v[j, a]) ** 2
            t = ROOT3 * math.sqrt(square)
            out[i, j] = (1 + t) * math.exp(-t)
    return out


class Kriging:
    """Ordinary Kriging with a Matérn 3/2 variogram of sill 1, by numpy."""

    def __init__(self, nugget: float, reach: float) -> None:
        self.nugget, self.reach = nugget, reach

    def fit(self, x: Any, e: Any) -> Kriging:
        """Factorise the covariance matrix of samples at x (n, d)."""
        self.x = x / self.reach
        self.L = np.linalg.cholesky(matern32(self.x, self.x) + self.nugget * np.eye(len(x)))
        self.one, white = (solve_triangular(self.L, b, lower=True) for b in (np.ones((len(x), 1)), e))
        self.q = float((self.one**2).sum())
        self.mean = self.one.T @ white / self.q
        self.alpha = solve_triangular(self.L.T, white - self.one * self.mean)
        return self

    def predict(self, x: Any) -> tuple[Any, Any]:
        """Return mean (m, k) and standard deviation (m,) at targets."""
        cross = matern32(x / self.reach, self.x)
        half = solve_triangular(self.L, cross.T, lower=True)
        spread = 1 - self.one[:, 0] @ half
        return self.mean + cross @ self.alpha, np.sqrt(1 - (half**2).sum(axis=0) + spread**2 / self.q)


def semivariance(x: Any, e: Any, edges: Any) -> tuple[Any, Any]:
    """Return pairs (k,) and semivariance (k, c) of each bin edges[b] < h <= edges[b + 1], from all pairs at once."""
    i, j = np.triu_indices(len(x), 1)
    bins = np.searchsorted(edges, pdist(x), side="left")
    pairs = np.bincount(bins, minlength=len(edges) + 1)
    squares = [np.bincount(bins, (e[i, c] - e[j, c]) ** 2, minlength=len(edges) + 1) for c in range(e.shape[1])]
    with np.errstate(invalid="ignore"):
        return pairs[1 : len(edges)], (np.array(squares).T / pairs[:, None] / 2)[1 : len(edges)]


def eliminate(rho: Any, near: Any, signal: float, diagonal: Any, at_target: Any, right: Any) -> Any:
    """Return what `truepose.numerics.small_systems.eliminate` does, by numpy's stacked matrices."""
    m, k = near.shape
    pairs = rho.transpose(0, 2, 1).reshape(-1, rho.shape[1])[:m]
    i, j = np.triu_indices(k, 1)
    K = np.zeros((m, k, k))
    K[:, i, j] = K[:, j, i] = signal * pairs[:, : len(i)]
    K[:, range(k), range(k)] = diagonal[near]
    k0 = signal * pairs[:, len(i) :]
    k0[:, 0] += at_target
    B = np.concatenate([k0[:, :, None], right[near]], axis=2)
    return B.transpose(0, 2, 1) @ np.linalg.solve(K, B)


def reduce(factor: Any, cross: Any) -> Any:
    """Return L⁻¹ c (n, m) of covariances c (m, n) by substitution."""
    return solve_triangular(factor, cross.T, lower=True)
