"""What effects of conditions are worth where a condition is not known: the sizes of their coefficients."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray

_GOES_ON: Final = 1.6


def effect_size(
    mean: FloatArray, covariance: FloatArray, counts: tuple[int, int, int, int], passed: FloatArray
) -> FloatArray:
    """Return the root mean squares of the coefficients of conditions, (c,), per prior standard deviation.

    Of warming, that of the sum over all steps stands at the last of them, times 1.6: from the mean arm of the samples
    to the last one is about half of it, and the arm goes on to warm up. Of a joint's offset, that of the way from its
    mean to its end stands at its last step.

    Parameters
    ----------
    mean, covariance : (c,), (c, c) arrays
        The coefficients of backlash, offsets, expansion and warming, per prior standard deviation.
    counts : tuple of int
        The number of each of them.
    passed : (s,) array
        The mean share of each step of the walk that samples have passed; s is 0 without time.
    """
    squares, steps = mean**2 + np.diag(covariance), len(passed)
    if not steps:
        return np.asarray(np.sqrt(squares))
    walks = [(slice(start, start + steps), 1.0 - passed) for start in range(counts[0], counts[0] + counts[1], steps)]
    walks.append((slice(len(mean) - steps, len(mean)), np.full(steps, _GOES_ON)))
    for own, weight in walks:
        squares[own] = 0.0
        squares[own.stop - 1] = (weight @ mean[own]) ** 2 + weight @ covariance[own, own] @ weight
    return np.asarray(np.sqrt(squares))
