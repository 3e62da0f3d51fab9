"""Robust scale and weights for residuals that are 3-vectors."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import chdtri

from truepose._typing import FloatArray

OUTLIER_LIMIT: Final = 6.0
"""The number of robust standard deviations (of one axis) above which a residual is an outlier.

For normal residuals the squared norm over the variance is chi-square with 3 degrees of freedom: 6 is exceeded with
probability 4e-8. Ordinary robot errors, which are smooth but not normal, reach 4 to 5.
"""


def trusted_count(n: int, minimal: int) -> int:
    """Return the number of n residuals that a fit must explain; the rest may be outliers (Rousseeuw 1984)."""
    return min(n, (n + minimal + 1) // 2)


def robust_scale(norms: FloatArray, minimal: int, floor: float) -> float:
    """Return the standard deviation of one axis [unit of norms] from the norms of 3-vectors with up to half outliers.

    It is the quantile of the norms given by `trusted_count`, divided by the same quantile of the chi distribution with
    3 degrees of freedom, with the small-sample factor of Rousseeuw and Leroy (1987), 1 + 5 / (n - p).

    Parameters
    ----------
    norms : (n,) array
        The norms.
    minimal : int
        The minimum number of 3-vectors of a fit.
    floor : float
        The rounding of the data, which is the smallest result.
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
