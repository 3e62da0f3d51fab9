"""Fits without gross readings, which the other readings contradict."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.base import Predictor

GROSS: Final = 10.0
"""Predicted standard deviations beyond which a reading is gross; a rough model of good readings reaches 8."""
FEWEST: Final = 10
"""The smallest number of samples; with fewer nothing is left out."""
_MEDIAN: Final = 1.538  # length of a standard normal vector in space, in the middle
_HEAVY: Final = 3.0  # tails of good readings beyond those of a normal distribution, at most


def fit_without_gross(
    model: Predictor, x: FloatArray, e: FloatArray, noise_std: FloatArray | None = None
) -> FloatArray:
    """Fit a predictor without the readings that the others contradict.

    A reading is gross if its leave-one-out residual exceeds 10 predicted standard deviations (norm over the
    components). Where gross readings have increased all standard deviations, the limit is 30 standard deviations as
    estimated from the median residual. The worst readings are removed first, because one gross reading spoils the
    predictions of its neighbours. Large errors alone are not gross: at the edge of a region they may be errors of the
    robot, and then its neighbours have them too.

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
        worst = surprise.max()
        if worst <= GROSS or len(kept) <= FEWEST:
            return gross
        out = surprise > max(GROSS, 0.7 * worst)
        gross[kept[out]] = surprise[out]
