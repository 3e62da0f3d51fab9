"""Fits without gross readings, which the other readings contradict."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.abilities import RobustlyJudging
from truepose.predictors.base import Predictor

GROSS: Final = 10.0
"""Predicted standard deviations beyond which a reading is gross; a rough model of good readings reaches 8."""
FEWEST: Final = 10
"""The smallest number of samples; with fewer nothing is left out."""
_DOUBTFUL: Final = 5.0  # predicted standard deviations; 1 of 60,000 normal readings is beyond
_MEDIAN: Final = 1.538  # length of a standard normal vector in space, in the middle
_HEAVY: Final = 3.0  # tails of good readings beyond those of a normal distribution, at most


def fit_without_gross(
    model: Predictor, x: FloatArray, e: FloatArray, noise_std: FloatArray | None = None
) -> FloatArray:
    """Fit a predictor without the readings that the others contradict.

    A reading is gross if its leave-one-out residual exceeds 10 predicted standard deviations (norm over the
    components). Where gross readings have increased all standard deviations, the limit is 30 standard deviations as
    estimated from the median residual. The worst readings are removed first, because one gross reading spoils the
    predictions of its neighbours. A predictor whose parameters a single reading can pull far, such as calibration,
    judges doubtful ones by a robust fit as well (`RobustlyJudging`). Large errors alone are not gross: at the edge of a
    region they may be errors of the robot, and then its neighbours have them too.

    Parameters
    ----------
    model : Predictor
        The predictor, which is fitted.
    x, e, noise_std : (n, d), (n, k), (n, k) arrays
        The arguments of `Predictor.fit`.

    Returns
    -------
    (n,) array
        The contradiction of each reading in standard deviations; 0 for those kept.
    """
    gross = np.zeros(len(e))
    while True:
        kept = np.flatnonzero(gross == 0)
        try:
            model.fit(x[kept], e[kept], None if noise_std is None else noise_std[kept])
        except KrigingError as error:
            raise error.of_rows(kept.tolist()) from None
        residual, std = model.leave_one_out()
        surprise = np.linalg.norm(residual / np.maximum(std, np.finfo(float).tiny), axis=1)
        middle = np.median(surprise)
        if middle > 0:  # 0: an interpolator that meets most of its samples
            surprise = surprise * max(1.0, _MEDIAN / (_HEAVY * middle))
        if surprise.max() > _DOUBTFUL and isinstance(model, RobustlyJudging):
            surprise = np.maximum(surprise, model.robust_surprise())
        worst = surprise.max()
        if worst <= GROSS or len(kept) <= FEWEST:
            return gross
        out = surprise > max(GROSS, 0.7 * worst)
        gross[kept[out]] = surprise[out]


def robust_factor(middle: float) -> float:
    """Return by what a predicted standard deviation is multiplied before it judges readings of which some are gross.

    It is larger than 1 where most residuals are larger than predicted, and smaller where they are so much smaller that
    gross readings must have increased the standard deviation.

    Parameters
    ----------
    middle : float
        The median length of residuals in predicted standard deviations.

    Examples
    --------
    >>> robust_factor(1.538), robust_factor(3.076), round(robust_factor(0.01), 3)
    (1.0, 2.0, 0.02)
    """
    ratio = middle / _MEDIAN
    return max(ratio, min(1.0, _HEAVY * ratio) or 1.0)  # 0: an interpolator that meets most of its samples
