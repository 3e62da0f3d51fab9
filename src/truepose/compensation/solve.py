"""The command whose predicted outcome is the target (method.md (15) and (16)), for positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Predict = Callable[[FloatArray, IntArray], FloatArray]
"""Positions (m, 3) [mm] of the targets of some rows (m,), to an array of m."""

TOLERANCE: Final = 1e-4
"""[mm] A solution reproduces its target to this; ten times finer than the 1 µm that (16) asks for."""


@dataclass(frozen=True)
class Solution:
    """Commands for targets; see `solve`.

    Attributes
    ----------
    p_command : (n, 3) array [mm], base frame
    e : (n, 3) array [mm], base frame
        Predicted error at the command.
    converged : (n,) array of bool
        Whether |p_command + e − p_target| is within the tolerance.
    iterations : int
    """

    p_command: FloatArray
    e: FloatArray
    converged: NDArray[np.bool_]
    iterations: int


def mirror(p_target: FloatArray, predict: Predict) -> FloatArray:
    """Return the commands of one step (15): P_c = P_t − ê(P_t).

    Parameters
    ----------
    p_target : (n, 3) array [mm], base frame
    predict : callable
        Positions and their rows to predicted errors (n, 3) [mm].
    """
    return p_target - predict(p_target, np.arange(len(p_target)))


def solve(
    p_target: FloatArray,
    predict: Predict,
    gradient: Predict | None = None,
    *,
    tolerance: float = TOLERANCE,
    max_iterations: int = 20,
) -> Solution:
    """Return the commands P_c with P_c + ê(P_c) = P_t (16).

    A fixed-point iteration, or Newton's where the predictor gives its derivative. Errors change by some 10⁻³ mm per mm,
    so either takes two or three steps; a target that does not settle is reported, never returned as if it had.

    Parameters
    ----------
    p_target : (n, 3) array [mm], base frame
    predict : callable
        Positions (m, 3) and their rows (m,) to predicted errors (m, 3) [mm].
    gradient : callable, optional
        The same to ∂ê/∂P (m, 3, 3), component by coordinate.
    tolerance : float [mm]
    max_iterations : int

    Returns
    -------
    Solution
    """
    p_command = p_target.copy()
    rows = np.arange(len(p_target))
    e = predict(p_command, rows)
    active = np.linalg.norm(e, axis=1) > tolerance
    iteration = 0
    while active.any() and iteration < max_iterations:
        iteration += 1
        miss = p_command[active] + e[active] - p_target[active]
        if gradient is not None:
            slope = np.eye(3) + gradient(p_command[active], rows[active])
            miss = np.linalg.solve(slope, miss[..., None])[..., 0]
        p_command[active] -= miss
        e[active] = predict(p_command[active], rows[active])
        active[active] = np.linalg.norm(p_command[active] + e[active] - p_target[active], axis=1) > tolerance
    return Solution(p_command, e, ~active, iteration)
