"""Solve for the command whose predicted outcome is the target (theory (15), (16)), for positions and poses.

A command is a position, or a pose as a position and the rotation vector ω by which it differs from the target,
R_c = exp(ω) R_t. Its outcome is exp(ŵ) R_c, so that R_c = exp(−ŵ) R_t is ω + ŵ = 0: the same equation as for positions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray

Predict = Callable[[FloatArray, IntArray], FloatArray]
"""A function of commands (m, 3) [mm] or (m, 6) [mm, rad] and the rows (m,) of their targets."""

TOLERANCE: Final = 1e-4
"""The tolerance of a solution [mm, mrad]: ten times finer than 1 µm and 1 µrad."""

_UNITS: Final = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])


@dataclass(frozen=True)
class Solution:
    """Commands for targets; see `solve`.

    Attributes
    ----------
    command : (n, 3) array [mm] or (n, 6) array [mm, rad], base frame
        The commands of (16).
    mirror : array like command
        The commands of one step (15): P_c = P_t − ê(P_t), ω = −ŵ.
    error : array like command
        The predicted errors at the commands.
    converged : (n,) array of bool
        Whether ‖command + error − target‖ is within the tolerance.
    iterations : int
        The number of iterations.
    """

    command: FloatArray
    mirror: FloatArray
    error: FloatArray
    converged: BoolArray
    iterations: int


def solve(
    target: FloatArray,
    predict: Predict,
    gradient: Predict | None = None,
    *,
    tolerance: float = TOLERANCE,
    max_iterations: int = 20,
) -> Solution:
    """Return the commands P_c with P_c + ê(P_c) = P_t (16), and those of one step (15).

    The iteration is Newton's if the gradient is given, otherwise a fixed-point iteration. Errors change by about 10⁻³
    mm per mm, so both take two or three steps. `Solution.converged` marks targets without a solution.

    Parameters
    ----------
    target : (n, 3) array [mm] or (n, 6) array [mm, rad], base frame
        The positions; or the poses, each as its position and a rotation vector of zero.
    predict : callable
        A function of commands and their rows (m,) that returns the predicted errors, like the commands.
    gradient : callable, optional
        A function of positions and their rows that returns ∂ê/∂P (m, 3, 3), component by coordinate.
    tolerance : float [mm, mrad]
        The largest distance between outcome and target.
    max_iterations : int
        The largest number of iterations.

    Returns
    -------
    Solution
    """
    command, rows, unit = target.copy(), np.arange(len(target)), _UNITS[: target.shape[1]]

    def misses(which: IntArray | BoolArray | slice) -> FloatArray:
        return np.asarray(command[which] + error[which] - target[which])

    error = predict(command, rows)
    first = target - error
    active = np.linalg.norm(misses(slice(None)) * unit, axis=1) > tolerance
    iteration = 0
    while active.any() and iteration < max_iterations:
        iteration += 1
        step = misses(active)
        if gradient is not None:
            slope = np.eye(target.shape[1]) + gradient(command[active], rows[active])
            step = np.asarray(np.linalg.solve(slope, step[..., None])[..., 0], np.float64)
        command[active] -= step
        error[active] = predict(command[active], rows[active])
        active[active] = np.linalg.norm(misses(active) * unit, axis=1) > tolerance
    return Solution(command, first, error, ~active, iteration)
