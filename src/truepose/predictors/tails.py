"""Find out whether the readings have heavier tails than normal noise: noise of Student's t with the stated size.

A fit with normal noise takes the far readings of a tracker for errors of the arm that differ from pose to pose, and its
nugget is too large. Far readings are those of the tracker if they are better explained by

    r_i ~ N(0, F_i + f s² I + R_i / w_i),   w_i ~ Gamma(ν/2, ν/2),

than with ν = ∞: r are leave-one-out residuals, F the variances of the predicted field, s² the nugget, and R the stated
variances of the readings. The mean prediction stays as it is; gross readings have small weights already.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.special import logsumexp

from truepose._typing import FloatArray

PAYS: Final = 2.0
"""The gain of the log likelihood from which tails are heavy."""
_FREEDOMS: Final = (3.0, 5.0, 10.0)
_SHARES: Final = np.arange(1, 13) / 10.0
_LOG_WEIGHTS: Final = np.linspace(-4.0, 3.0, 41)


class Tails(NamedTuple):
    """The tails of the noise of readings.

    Attributes
    ----------
    freedom : float
        The degrees of freedom ν of Student's t; infinite for normal noise.
    share : float
        The share of the fitted nugget that is left beside them.
    """

    freedom: float = np.inf
    share: float = 1.0

    @property
    def factor(self) -> float:
        """The variance of readings over their stated one.

        Examples
        --------
        >>> Tails(3.0, 0.5).factor, Tails().factor
        (3.0, 1.0)
        """
        return 1.0 if np.isinf(self.freedom) else self.freedom / (self.freedom - 2.0)


def tails(residual: FloatArray, field: FloatArray, nugget: float, reading: FloatArray) -> Tails:
    """Return the tails of the noise of readings; normal ones unless heavier ones raise the likelihood by `PAYS`.

    Parameters
    ----------
    residual : (n, 3) array [mm]
        The leave-one-out residuals.
    field : (n, 3, 3) array [mm²]
        The covariances of the predicted field there.
    nugget : float [mm²]
        The fitted nugget in each direction.
    reading : (n,) array [mm]
        The stated standard deviations of the readings in each direction.
    """
    variance, axes = np.linalg.eigh(field)
    squared = np.einsum("nab,na->nb", axes, residual) ** 2
    fixed = np.maximum(variance, 0.0) + nugget * _SHARES[:, None, None]  # (s, n, 3)
    weight = np.exp(_LOG_WEIGHTS)
    noise = reading[:, None] ** 2 / weight  # (n, w)
    of_weight = _log_density(squared[:, None], fixed[:, :, None] + noise[..., None])
    best, found = _log_density(squared, fixed + reading[:, None] ** 2).sum(axis=1).max() + PAYS, Tails()
    for freedom in _FREEDOMS:
        prior = 0.5 * freedom * (_LOG_WEIGHTS - weight)  # Gamma, times w for steps of the logarithm
        value = logsumexp(of_weight + prior - logsumexp(prior), axis=2).sum(axis=1)
        if value.max() > best:
            best, found = value.max(), Tails(freedom, min(1.0, float(_SHARES[value.argmax()])))
    return found


def _log_density(squared: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the normal log density of vectors with squared components along their axes, without its constant."""
    return np.asarray(-0.5 * np.sum(squared / variance + np.log(variance), axis=-1))
