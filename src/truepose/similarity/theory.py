"""The semivariogram that parameter errors imply, theory (6): the part of the similarity that kinematics explains."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose.errors import DataError
from truepose.similarity.experimental import Direction, ExperimentalVariogram, experimental_variogram


def model_based_variogram(
    x: ArrayLike,
    jacobian: ArrayLike,
    covariance: ArrayLike,
    bins: int | ArrayLike = 20,
    max_lag: float | None = None,
    direction: Direction | ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
) -> ExperimentalVariogram:
    """Return γ_theory = ½ tr[(J − J') Σ (J − J')ᵀ], averaged over the pairs of each bin, theory (6).

    With Σ = L Lᵀ it is the semivariogram of the columns of J L, summed; so it is averaged over the same pairs as in
    `experimental_variogram` with the same x, bins and direction.

    Parameters
    ----------
    x : (n, d) array_like
        Positions (n, 3) [mm] or joints (n, dof) [rad].
    jacobian : (n, c, p) array_like
        J of the error's c components by p parameters at x, theory (3) [mm per unit of the parameter].
    covariance : (p, p) or (p,) array_like
        The covariance Σ of the parameters' errors, or its diagonal.
    bins, max_lag, direction, weights
        The arguments of `experimental_variogram`.

    Returns
    -------
    ExperimentalVariogram
        The expected semivariogram; its estimator is ``model``.

    Raises
    ------
    DataError
        If shapes disagree, a number is not finite, or Σ has a negative eigenvalue.

    Examples
    --------
    >>> x = np.arange(4.0)[:, None]
    >>> ramp = np.stack([x, 0 * x], axis=1)  # e = (x Δp, 0)
    >>> model_based_variogram(x, ramp, [0.04], bins=[0.0, 1.0, 2.0]).semivariance
    array([[0.02, 0.  ],
           [0.08, 0.  ]])
    """
    J, sigma = np.asarray(jacobian, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    if J.ndim != 3 or 0 in J.shape:
        raise DataError(f"jacobian has shape {J.shape}; expected (n, components, parameters)")
    n, c, p = J.shape
    if sigma.shape == (p,):
        sigma = np.diag(sigma)
    if sigma.shape != (p, p) or not np.isfinite(sigma).all():
        raise DataError(f"covariance has shape {sigma.shape}; expected ({p}, {p}) or ({p},) finite numbers, as J has")
    size = np.sqrt(np.maximum(np.diag(sigma), 0.0))
    size[size == 0] = 1.0
    eigenvalue, vector = np.linalg.eigh(sigma / size / size[:, None])
    if eigenvalue[0] < -1e-10 * max(eigenvalue[-1], 0.0) or not np.allclose(sigma, sigma.T, rtol=1e-9, atol=0):
        raise DataError("covariance is not a covariance: it must be symmetric, without negative eigenvalues")
    root = size[:, None] * vector * np.sqrt(np.maximum(eigenvalue, 0.0))
    columns = (J.reshape(n * c, p) @ root).reshape(n, c * p)
    found = experimental_variogram(x, columns, bins, max_lag, direction=direction, weights=weights)
    semivariance = found.semivariance.reshape(-1, c, p).sum(axis=2)
    return ExperimentalVariogram(
        lag=found.lag,
        semivariance=semivariance,
        vector=semivariance.sum(axis=1),
        pairs=found.pairs,
        edges=found.edges,
        repeats=found.repeats,
        repeat_semivariance=found.repeat_semivariance.reshape(c, p).sum(axis=1),
        dimensions=found.dimensions,
        estimator="model",
    )
