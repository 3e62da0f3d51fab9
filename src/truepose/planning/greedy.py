"""Greedy choice of candidates, followed by exchanges of single ones (theory, planning).

The prior of (10) makes every error linear in weights w ~ N(0, I) but for noise: e_i = A_i w + ε_i, ε_i ~ N(0, R_i). A
sample at candidate i then takes from the posterior covariance P of the weights

    P A_iᵀ S⁻¹ A_i P,    S = A_i P A_iᵀ + R_i,

and from the mean variance over the targets, tr(T P) with T the mean of their A_tᵀ A_t,

    tr[S⁻¹ A_i P T P A_iᵀ].

Kept are P, and of each candidate the blocks A_i P A_iᵀ and A_i P T P A_iᵀ: a sample at j changes them by products with
A_i P A_jᵀ and A_i P T P A_jᵀ, so that all A_i are read once for each change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray

_PASSES: Final = 3  # of exchanges
_LOST: Final = 1e-2
"""Share of the targets' variance below which the candidates' blocks are computed again."""

Progress = Callable[[int, int], object]


class Posterior:
    """The uncertainty of all candidates, and by how much each would lower that of the targets.

    Parameters
    ----------
    columns : (n, 3, p) array [mm]
        The matrices A_i of the candidates, for one standard deviation of each weight.
    noise : (n, 3, 3) array [mm²]
        The covariances R_i of the candidates' readings.
    aim : (p, p) array [mm²]
        The matrix T of the targets.
    chosen : sequence of int
        The candidates with a sample.
    """

    def __init__(self, columns: FloatArray, noise: FloatArray, aim: FloatArray, chosen: Sequence[int] = ()) -> None:
        self._columns, self._noise, self._aim = np.ascontiguousarray(columns), noise, aim
        rows = columns[list(chosen)]
        told = np.linalg.solve(noise[list(chosen)], rows)
        p = columns.shape[2]
        self._covariance = np.linalg.inv(np.eye(p) + rows.reshape(-1, p).T @ told.reshape(-1, p))
        self._compute_blocks()

    def _compute_blocks(self) -> None:
        """Compute A P Aᵀ and A P T P Aᵀ of each candidate, (n, 3, 3), from the covariance."""
        n, _, p = self._columns.shape
        across = np.swapaxes(self._columns, 1, 2)
        pulled = self._covariance @ self._aim @ self._covariance
        self._variance, self._aimed = (
            (self._columns.reshape(-1, p) @ matrix).reshape(n, 3, p) @ across for matrix in (self._covariance, pulled)
        )
        self._computed_at = self._of_targets()

    def _of_targets(self) -> float:
        return float(np.vdot(self._aim, self._covariance))

    def gains(self) -> FloatArray:
        """Return by how much each candidate would lower the targets' mean variance: (n,) [mm²]."""
        return np.asarray(np.einsum("nab,nba->n", np.linalg.inv(self._variance + self._noise), self._aimed))

    def variances(self) -> FloatArray:
        """Return the variance of each candidate's error, its three directions summed: (n,) [mm²]."""
        return np.asarray(np.trace(self._variance, axis1=1, axis2=2))

    def add(self, i: int) -> None:
        """Add a sample at candidate i."""
        self._change(i, 1.0)

    def remove(self, i: int) -> None:
        """Remove a sample at candidate i."""
        self._change(i, -1.0)

    def _change(self, i: int, sign: float) -> None:
        n, _, p = self._columns.shape
        rows = self._columns[i] @ self._covariance
        aimed = rows @ self._aim @ self._covariance
        both = (self._columns.reshape(-1, p) @ np.concatenate([rows, aimed]).T).reshape(n, 3, 6)
        inverse = np.linalg.inv(rows @ self._columns[i].T + sign * self._noise[i])
        toward = both[:, :, :3]  # A_i P A_jᵀ
        near = np.swapaxes(toward, 1, 2)
        share = (toward.reshape(-1, 3) @ inverse).reshape(n, 3, 3)
        half = share @ (0.5 * aimed @ self._columns[i].T @ inverse @ near - np.swapaxes(both[:, :, 3:], 1, 2))
        self._variance -= share @ near
        self._aimed += half + np.swapaxes(half, 1, 2)
        self._covariance -= rows.T @ inverse @ rows
        if self._of_targets() < _LOST * self._computed_at:  # differences of large numbers have lost digits
            self._compute_blocks()


def lowest_mean(
    columns: FloatArray, noise: FloatArray, aim: FloatArray, n: int, progress: Progress, *, passes: int = _PASSES
) -> IntArray:
    """Choose n candidates that leave the targets the lowest mean variance.

    Parameters
    ----------
    columns, noise, aim
        The arguments of `Posterior`.
    n : int
        The number of candidates to choose.
    progress : callable
        A function of the steps done and the total number of steps.
    passes : int
        The largest number of passes of exchanges.

    Returns
    -------
    (n,) array of int
        The candidates in the order of their choice; exchanged ones keep the place of their predecessor.
    """
    posterior = Posterior(columns, noise, aim)
    chosen: list[int] = []
    for step in range(n):
        chosen.append(_best(posterior.gains(), chosen))
        posterior.add(chosen[-1])
        progress(step + 1, n * (1 + passes))
    for turn in range(passes):
        before = list(chosen)
        posterior = Posterior(columns, noise, aim, chosen)  # a new one: rounding does not accumulate over the passes
        for place, i in enumerate(before):
            posterior.remove(i)
            chosen[place] = _best(posterior.gains(), [*chosen[:place], *chosen[place + 1 :]])
            posterior.add(chosen[place])
            progress((1 + turn) * n + place + 1, n * (1 + passes))
        if chosen == before:
            break
    return np.array(chosen)


def lowest_largest(columns: FloatArray, noise: FloatArray, n: int, progress: Progress) -> IntArray:
    """Choose n candidates, each with the largest remaining variance: the pivots of a Cholesky factorisation."""
    posterior = Posterior(columns, noise, np.zeros((columns.shape[2],) * 2))
    chosen: list[int] = []
    for step in range(n):
        chosen.append(_best(posterior.variances(), chosen))
        posterior.add(chosen[-1])
        progress(step + 1, n)
    return np.array(chosen)


def most_observable(
    columns: FloatArray, index: Callable[[FloatArray, int], FloatArray], n: int, progress: Progress
) -> IntArray:
    """Choose n candidates whose columns have the best observability index, greedy and exchanged.

    Parameters
    ----------
    columns : (m, 3, p) array
        The scaled columns of the parameters.
    index : callable
        A function of the ascending eigenvalues (m, p) of information matrices, and of the number of samples; larger is
        better.
    n : int
        The number of candidates to choose.
    progress : callable
        A function of the steps done and the total number of steps.
    """
    each = np.swapaxes(columns, 1, 2) @ columns
    floor = 1e-9 * np.trace(each.sum(axis=0)) * np.eye(columns.shape[2])  # until there are enough samples for full rank
    total, chosen = floor.copy(), list[int]()

    def best() -> int:
        return _best(index(np.linalg.eigvalsh(total + each), len(chosen) + 1), chosen)

    for step in range(n):
        chosen.append(best())
        total += each[chosen[-1]]
        progress(step + 1, 2 * n)
    for place in range(n):
        total -= each[chosen.pop(0)]
        chosen.append(best())
        total += each[chosen[-1]]
        progress(n + place + 1, 2 * n)
    return np.array(chosen)


def _best(value: FloatArray, taken: list[int]) -> int:
    value = value.copy()
    value[taken] = -np.inf
    return int(np.argmax(value))
