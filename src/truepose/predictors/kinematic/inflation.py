"""Find the factor by which the predicted variances of a fit are too small.

Hyperparameters suit the samples from which they were estimated better than new ones, and leave-one-out with the same
hyperparameters does not show this. Therefore they are estimated again without each fifth of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.folds import random_folds
from truepose.predictors.kinematic.checks import FEWEST
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.design import Design, take
from truepose.predictors.kinematic.fitting import Start, search_near
from truepose.predictors.kinematic.terms import Terms
from truepose.predictors.reflectors import whole_poses

FOLDS: Final = 5
MOST: Final = 250
"""The largest number of samples used."""
SEARCHED: Final = 350
"""The largest number of samples in the search for hyperparameters."""
_SETTLED: Final = 0.02  # of the log likelihood; hyperparameters that far from the optimum predict alike


@dataclass(frozen=True, eq=False)
class Part:
    """Samples of a fit.

    Attributes
    ----------
    terms, design, joints
        The terms, columns and joints of the model at n samples.
    e, reading : (n, 3) arrays [mm]
        The errors, and the known standard deviations of their readings.
    weight : (n,) array
        The weights of the samples.
    """

    terms: Terms
    design: Design
    joints: IntArray
    e: FloatArray
    reading: FloatArray
    weight: FloatArray

    @property
    def pose(self) -> IntArray:
        """The pose of each row, (n,): those of several reflectors, and of position and orientation, stay together."""
        visit = np.arange(len(self.e), dtype=np.float64) if self.design.turn.any() else self.design.visit
        return np.unique(whole_poses(self.design.q, visit), return_inverse=True)[1].reshape(-1)

    def take(self, rows: IntArray) -> Part:
        """Return some of the samples."""
        design = take(self.design, rows)
        return Part(self.terms, design, self.joints, self.e[rows], self.reading[rows], self.weight[rows])


def inflation(samples: Part, residual: FloatArray, covariance: FloatArray, start: Start, random_state: int) -> float:
    """Return the factor of predicted variances that makes unseen readings standard.

    It is the larger of two estimates: from fits without a fifth of the samples each, with their own hyperparameters;
    and the mean squared standardised leave-one-out residual, at least 1, times 3n/(3n − k) for k hyperparameters. What
    estimated hyperparameters do to variances is proportional to the hyperparameters per sample, so that the excess over
    1 in fits with four fifths of the samples is four fifths as large with all.

    Parameters
    ----------
    samples : Part
        The n samples, without gross ones.
    residual, covariance : (n, 3) array [mm], (n, 3, 3) array [mm²]
        Their leave-one-out residuals with the covariances of these.
    start : Start
        The optimum of all samples.
    random_state : int
        The seed of the folds.
    """
    here = samples.design.turn == 0.0  # rows of orientation say nothing of the variance of positions
    residual, variance = residual[here], np.einsum("naa->na", covariance)[here]
    n, k = min(len(residual), SEARCHED), len(start.hyper.to_vector())
    alone = max(1.0, float(np.mean(residual**2 / variance))) * 3 * n / max(3 * n - k, n)
    if len(residual) < FEWEST:
        return alone
    some = samples.take(np.sort(np.random.default_rng(random_state).permutation(len(samples.e))[:MOST]))
    seen = fold_residuals(some, start, random_state)
    here = some.design.turn == 0.0
    excess = factor(seen[0][here], seen[1][here], some.reading[here]) - 1.0
    known = (
        (1.0 - 1.0 / FOLDS) * len(some.e) / min(len(samples.e), SEARCHED)
    )  # the share of the samples in a fold's fit
    return max(1.0 + excess * known, alone)


def fold_residuals(samples: Part, start: Start, random_state: int) -> tuple[FloatArray, FloatArray]:
    """Return the residual of each sample from a fit without its fold, and its predicted variance.

    Parameters
    ----------
    samples : Part
        The n samples.
    start : Start
        The start of each search: the optimum of all samples.
    random_state : int
        The seed of the folds.

    Returns
    -------
    residual : (n, 3) array [mm]
        The residuals.
    variance : (n, 3) array [mm²]
        The variances of field and nugget, without the known noise of the readings.
    """
    e = samples.e
    fold = random_folds(len(np.unique(samples.pose)), FOLDS, rng=random_state)[samples.pose]
    residual, variance = np.empty_like(e), np.empty_like(e)
    for k in range(FOLDS):
        rows, out = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        kept = samples.take(rows)
        likelihood = Likelihood(kept.terms, kept.design, kept.joints, kept.e, kept.reading, kept.weight)
        found = search_near(likelihood, start, settled=_SETTLED)[0].hyper
        noise = (found.noise**2 + kept.reading**2) / kept.weight[:, None]
        form = CovarianceForm.of(kept.terms, kept.design, kept.joints, found, kept.e, noise)
        mean, covariance = form.posterior(take(samples.design, out))
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
