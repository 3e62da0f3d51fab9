"""Fit of a variogram model by restricted maximum likelihood (REML), for errors with an unknown constant mean.

The components share one correlation and have scales of their own (equation (9) with B diagonal), which the likelihood
has in closed form; so the search is over range and nugget ratio alone, with the analytic gradient. Unlike the bins of a
variogram this tells a small nugget from none under a smooth trend, on which a prediction's standard deviation hangs.
Source: K. V. Mardia & R. J. Marshall, Biometrika 71 (1984); P. K. Kitanidis, Water Resources Research 19 (1983).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack
from scipy.optimize import minimize
from scipy.spatial.distance import pdist, squareform

from truepose.errors import KrigingError
from truepose.similarity.experimental import check_points
from truepose.similarity.models import FAMILIES, VariogramModel
from truepose.similarity.threads import blas_threads

FloatArray = NDArray[np.float64]

ROUGH_TO_SMOOTH: Final = ("exponential", "matern32", "matern52")
"""Families tried by default: valid in any number of coordinates, and never as ill-conditioned as the gaussian."""

LEAST: Final = 5
STARTS: Final = ((0.5, 0.1), (4.0, 1e-3))
"""Practical range in units of the points' extent, and nugget ratio C0/C."""
RANGES: Final = (1e-3, 60.0)
RATIOS: Final = (1e-8, 1e4)


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """How a model was fitted by likelihood.

    Attributes
    ----------
    log_likelihood : float
        Restricted log-likelihood, without its constant.
    bounds_hit : dict of str to {"lower", "upper"}
        Parameters that ended at a bound.
    samples : int
        Samples used.
    candidates : dict of str to float
        The log-likelihood of every family tried.
    """

    log_likelihood: float
    bounds_hit: dict[str, str]
    samples: int
    candidates: dict[str, float]


def fit_likelihood(
    x: ArrayLike, e: ArrayLike, family: str | Sequence[str] = ROUGH_TO_SMOOTH, *, largest: int = 300
) -> VariogramModel:
    """Return the model with the largest restricted likelihood.

    Parameters
    ----------
    x : (n, d) array_like
        Positions [mm] or joints [rad].
    e : (n, c) or (n,) array_like [mm]
        Errors at x.
    family : str or sequence of str
        Families with a sill; the most likely one wins.
    largest : int
        Of more samples than this a random part is used, always the same one.

    Returns
    -------
    VariogramModel
        Of the mean over the components, with its `fit` record.

    Raises
    ------
    KrigingError
        With fewer than 5 samples, errors that do not vary, or points that are all the same.

    Examples
    --------
    >>> x = np.linspace(0, 1000, 60)[:, None]
    >>> fit_likelihood(x, np.sin(x / 100)).family
    'matern52'
    """
    points, errors = check_points(x, e)
    names = [family] if isinstance(family, str) else list(family)
    unknown = [name for name in names if name not in FAMILIES or not FAMILIES[name].bounded]
    if unknown or not names:
        raise KrigingError(
            f"variogram family {unknown} has no likelihood; use families with a sill: {', '.join(FAMILIES)}"
        )
    if len(points) < LEAST:
        raise KrigingError(
            f"{len(points)} samples are too few to fit a variogram; measure at least {LEAST}, or give a variogram"
        )
    errors = errors[:, np.ptp(errors, axis=0) > 0]
    if errors.shape[1] == 0:
        raise KrigingError("the errors do not vary, so no variogram can be fitted; check the column of e")
    components = np.shape(e)[1] if np.ndim(e) > 1 else 1
    if len(points) > largest:
        part = np.random.default_rng(0).choice(len(points), largest, replace=False)
        points, errors = points[part], errors[part]
    distance = squareform(pdist(points))
    if not distance.any():
        raise KrigingError(f"all {len(points)} points are the same; a variogram needs points that are apart")
    with blas_threads(len(points)):
        fits = {name: _most_likely(name, distance, errors) for name in names}
    best = max(fits, key=lambda name: fits[name].log_likelihood)
    found = fits[best]
    hit = _bounds_hit(found.range * FAMILIES[best].practical_range() / distance.max(), found.ratio)
    record = LikelihoodFit(found.log_likelihood, hit, len(points), {name: f.log_likelihood for name, f in fits.items()})
    sill = float(found.scale.sum()) / components
    return VariogramModel(best, nugget=found.ratio * sill, sill=sill, range=found.range, fit=record)


@dataclass(frozen=True, eq=False)
class _Optimum:
    log_likelihood: float
    range: float
    ratio: float
    scale: FloatArray


def _most_likely(name: str, distance: FloatArray, e: FloatArray) -> _Optimum:
    """Return the best optimum over the starts, in log range and log nugget ratio."""
    unit = distance.max() / FAMILIES[name].practical_range()

    def loss(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient, _ = restricted_loss(name, unit * math.exp(theta[0]), math.exp(theta[1]), distance, e)
        return value, gradient

    bounds = [tuple(np.log(RANGES)), tuple(np.log(RATIOS))]
    results = [minimize(loss, np.log(start), jac=True, method="L-BFGS-B", bounds=bounds) for start in STARTS]
    best = min(results, key=lambda result: float(result.fun))
    length, ratio = unit * math.exp(best.x[0]), math.exp(best.x[1])
    return _Optimum(-float(best.fun), length, ratio, restricted_loss(name, length, ratio, distance, e)[2])


def restricted_loss(
    name: str, length: float, ratio: float, distance: FloatArray, e: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Return −log restricted likelihood, its gradient by (log range, log ratio), and the scale of each component.

    With K = rho(h/a) + ratio I, P = K⁻¹ − K⁻¹1(1ᵀK⁻¹1)⁻¹1ᵀK⁻¹ and s_c = e_cᵀP e_c/(n − 1), profiled out:
    2 loss = c (log|K| + log 1ᵀK⁻¹1) + (n − 1) Σ log s_c.

    Parameters
    ----------
    name : str
    length : float
        a.
    ratio : float
        C0/C, above 0.
    distance : (n, n) array
    e : (n, c) array [mm]
    """
    from truepose.similarity.covariance import correlation, slope_over_distance

    n, c = e.shape
    code = FAMILIES[name].code
    r = distance / length
    factor, failed = lapack.dpotrf(correlation(code, r) + ratio * np.eye(n), lower=1, clean=1)
    if failed:  # no model in 64 bits: as unlikely as can be
        return 1e300, np.zeros(2), np.ones(c)
    lower = lapack.dpotri(factor, lower=1)[0]
    inverse = np.tril(lower) + np.tril(lower, -1).T
    ones = inverse.sum(axis=0)
    total = ones.sum()
    weights = inverse @ e
    weights -= np.outer(ones, weights.sum(axis=0) / total)
    scale = np.einsum("nc,nc->c", e, weights) / (n - 1)
    log_determinant = 2 * np.log(factor.diagonal()).sum() + math.log(total)
    value = (c * log_determinant + (n - 1) * np.log(scale).sum()) / 2
    projected = c * (inverse - np.outer(ones, ones / total)) - (weights / scale) @ weights.T
    by_range = -slope_over_distance(code, r) * r * r
    gradient = np.array([np.vdot(projected, by_range), ratio * np.trace(projected)]) / 2
    return float(value), gradient, scale


def _bounds_hit(practical: float, ratio: float) -> dict[str, str]:
    """Name the parameters at a bound; `practical` range in units of the points' extent."""
    hit = {}
    for name, value, bounds in (("range", practical, RANGES), ("nugget", ratio, RATIOS)):
        if value <= bounds[0] * 1.001:
            hit[name] = "lower"
        elif value >= bounds[1] * 0.999:
            hit[name] = "upper"
    if hit.pop("nugget", "") == "upper":
        return {"sill": "lower"}
    return hit | ({"nugget": "lower"} if ratio <= RATIOS[0] * 1.001 else {})
