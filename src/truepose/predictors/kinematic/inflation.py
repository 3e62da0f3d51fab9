"""By how much a fit is too sure: its samples predicted by fits of their own, which have not seen them.

Hyperparameters that are found from the samples suit these better than new ones, and leave-one-out with the same
hyperparameters does not show it. So they are found again without each fifth of the samples.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.folds import random_folds
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.fitting import search
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.terms import Design, Terms, take

FOLDS: Final = 5
MOST: Final = 250
"""Samples that tell enough of it: fewer are all taken."""
_ITERATIONS: Final = 15  # from the hyperparameters of all samples: nearly where the search ends


def held_out(
    terms: Terms,
    design: Design,
    joints: IntArray,
    hyper: Hyperparameters,
    e: FloatArray,
    reading: FloatArray,
    weight: FloatArray,
    random_state: int,
) -> tuple[FloatArray, FloatArray]:
    """Return what is left of each sample by a fit without its fold, and the variance predicted for it.

    Parameters
    ----------
    terms, design, joints
        Of the model, at n samples.
    hyper : Hyperparameters
        Where each search starts.
    e, reading : (n, 3) arrays [mm]
        Errors, and the known noise of their readings.
    weight : (n,) array
        Of the samples in the fits.
    random_state : int
        Of the folds.

    Returns
    -------
    residual : (n, 3) array [mm]
    variance : (n, 3) array [mm²]
        Of field and nugget, without the known noise of the readings.
    """
    fold = random_folds(len(e), FOLDS, rng=random_state)
    residual, variance = np.empty_like(e), np.empty_like(e)
    for k in range(FOLDS):
        rows, out = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        kept = take(design, rows)
        likelihood = Likelihood(terms, kept, joints, e[rows], reading[rows], weight[rows])
        found = search(likelihood, [hyper], iterations=_ITERATIONS).hyper
        noise = (found.noise**2 + reading[rows] ** 2) / weight[rows, None]
        form = CovarianceForm.of(terms, kept, joints, found, e[rows], noise)
        mean, covariance = form.posterior(take(design, out))
        residual[out] = e[out] - mean
        variance[out] = np.maximum(np.einsum("maa->ma", covariance), 0.0) + found.noise**2
    return residual, variance


def factor(residual: FloatArray, variance: FloatArray, reading: FloatArray) -> float:
    """Return the factor of predicted variances that makes residuals standard in the mean.

    The known noise of the readings is not at fault: what residuals have too much is put down to the rest of the
    predicted variance.

    Parameters
    ----------
    residual : (n, 3) array [mm]
    variance : (n, 3) array [mm²]
        Predicted, without the noise of the readings.
    reading : (n, 3) array [mm]
        Standard deviation of the readings.

    Examples
    --------
    >>> residual = np.sqrt([[5.0, 5.0, 5.0]])
    >>> round(factor(residual, np.full((1, 3), 2.0), np.ones((1, 3))), 9)
    2.0
    """
    total = variance + reading**2
    return float(np.mean((residual**2 - reading**2) / total) / np.mean(variance / total))
