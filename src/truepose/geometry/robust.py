"""Robust scale and weights for residuals that are 3-vectors."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import chdtri

from truepose._typing import FloatArray

OUTLIER_LIMIT: Final = 6.0
"""A residual longer than this many robust standard deviations (of one axis) is gross.

For normal residuals the squared norm over the variance is chi-square with 3 degrees of freedom: 6 is exceeded with
probability 4e-8. Ordinary robot errors, which are smooth but not normal, reach 4 to 5.
"""


def trusted_count(n: int, minimal: int) -> int:
    """Return how many of n residuals must be small for a fit to count, the rest may be gross (Rousseeuw 1984)."""
    return min(n, (n + minimal + 1) // 2)


def robust_scale(norms: FloatArray, minimal: int, floor: float) -> float:
    """Return the standard deviation of one axis [unit of norms] from the norms of 3-vectors, up to half of them gross.

    The quantile of the norms that `trusted_count` names, divided by the same quantile of the chi distribution with 3
    degrees of freedom, with the small-sample factor of Rousseeuw and Leroy (1987), 1 + 5 / (n - p).

    Parameters
    ----------
    norms : (n,) array
    minimal : int
        Number of 3-vectors that a fit needs at least.
    floor : float
        Rounding of the data: a smaller scale is not returned.
    """
    n = len(norms)
    h = trusted_count(n, minimal)
    expected = np.sqrt(chdtri(3, 1.0 - (h - 0.5) / n))
    small_sample = 1.0 + 5.0 / max(n - minimal, 1)
    return max(float(np.partition(norms, h - 1)[h - 1] / expected) * small_sample, floor)


def tukey_weights(norms: FloatArray, scale: float) -> FloatArray:
    """Return Tukey's biweight, (1 - u²)² with u = norm / (OUTLIER_LIMIT scale), zero beyond: (n,).

    Examples
    --------
    >>> import numpy as np
    >>> tukey_weights(np.array([0.0, 3.0, 6.0, 100.0]), scale=1.0)
    array([1.    , 0.5625, 0.    , 0.    ])
    """
    u = np.minimum(norms / (OUTLIER_LIMIT * scale), 1.0)
    return np.asarray((1.0 - u**2) ** 2)
