"""Find the factor by which the predicted variances of a fit are too small.

Hyperparameters suit the samples from which they were estimated better than new ones, and leave-one-out with the same
hyperparameters does not show this. Therefore they are estimated again without each fifth of the samples.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.folds import random_folds
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.fitting import Start, search_near
from truepose.predictors.kinematic.terms import Design, Terms, take

FOLDS: Final = 5
MOST: Final = 250
"""The largest number of samples used."""
_SETTLED: Final = 0.02  # of the log likelihood; hyperparameters that far from the optimum predict alike


def fold_residuals(
    terms: Terms,
    design: Design,
    joints: IntArray,
    start: Start,
    e: FloatArray,
    reading: FloatArray,
    weight: FloatArray,
    random_state: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the residual of each sample from a fit without its fold, and its predicted variance.

    Parameters
    ----------
    terms, design, joints
        The terms, columns and joints of the model at n samples.
    start : Start
        The start of each search: the optimum of all samples.
    e, reading : (n, 3) arrays [mm]
        The errors, and the known standard deviations of their readings.
    weight : (n,) array
        The weights of the samples.
    random_state : int
        The seed of the folds.

    Returns
    -------
    residual : (n, 3) array [mm]
        The residuals.
    variance : (n, 3) array [mm²]
        The variances of field and nugget, without the known noise of the readings.
    """
    fold = random_folds(len(e), FOLDS, rng=random_state)
    residual, variance = np.empty_like(e), np.empty_like(e)
    for k in range(FOLDS):
        rows, out = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        kept = take(design, rows)
        likelihood = Likelihood(terms, kept, joints, e[rows], reading[rows], weight[rows])
        found = search_near(likelihood, start, settled=_SETTLED)[0].hyper
        noise = (found.noise**2 + reading[rows] ** 2) / weight[rows, None]
        form = CovarianceForm.of(terms, kept, joints, found, e[rows], noise)
        mean, covariance = form.posterior(take(design, out))
        residual[out] = e[out] - mean
        variance[out] = np.maximum(np.einsum("maa->ma", covariance), 0.0) + found.noise**2
    return residual, variance


def factor(residual: FloatArray, variance: FloatArray, reading: FloatArray) -> float:
    """Return the factor of the predicted variances that makes the residuals standard in the mean.

    The factor applies to the predicted variances only, not to the known noise of the readings.

    Parameters
    ----------
    residual : (n, 3) array [mm]
        The residuals.
    variance : (n, 3) array [mm²]
        The predicted variances, without the noise of the readings.
    reading : (n, 3) array [mm]
        The standard deviations of the readings.

    Examples
    --------
    >>> residual = np.sqrt([[5.0, 5.0, 5.0]])
    >>> round(factor(residual, np.full((1, 3), 2.0), np.ones((1, 3))), 9)
    2.0
    """
    total = variance + reading**2
    return float(np.mean((residual**2 - reading**2) / total) / np.mean(variance / total))
