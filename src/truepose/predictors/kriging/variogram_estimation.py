"""The variogram of a predictor that was given none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.kriging.repeats import Points
from truepose.similarity import VariogramModel, experimental_variogram, fit_likelihood, fit_variogram
from truepose.similarity.fit_record import without_warning

SMALLEST_SCALE: Final = 1e-12
"""Variance of a component that does not vary, in units of the fitted model's."""


def estimate_model(
    variogram: Any, x: FloatArray, e: FloatArray, drift: FloatArray, noise: FloatArray, points: Points, exact: bool
) -> VariogramModel:
    """Fit the variogram of the components' mean; what noise explains is no nugget, what repeats scatter is.

    Parameters
    ----------
    variogram : None, str or sequence of str
        None for restricted likelihood; families for weighted least squares.
    x : (n, d) array
        Coordinates.
    e : (n, k) array
    drift : (n, p) array
        Taken out of e by least squares first, where it is more than a constant.
    noise : (n, k) array
        Variance of the readings.
    points : Points
    exact : bool
    """
    n, k = e.shape
    if drift.shape[1] > 1:
        e = e - drift @ np.linalg.lstsq(drift, e)[0]
    with without_warning():  # a predictor is fitted many times; its variogram keeps the remarks
        if variogram is None:
            model = fit_likelihood(x, e)
        else:
            bins = max(4, min(20, n * (n - 1) // 60))
            families = cast("str | Sequence[str]", variogram)
            model = fit_variogram(experimental_variogram(x, e / np.sqrt(k), bins=bins), families)
    nugget = model.nugget if exact else max(model.nugget, float(points.scatter(e).mean()))
    least = 1e-6 * model.nugget if model.partial_sill == 0 else 0.0  # something must vary
    return replace(model, nugget=max(nugget - float(noise.mean()), least))


def own_scales(model: VariogramModel, scale: FloatArray) -> tuple[VariogramModel, ...]:
    """Return the model of each component, of variance `scale` (k,) in units of the mean's."""
    scale = np.maximum(scale, SMALLEST_SCALE)
    return tuple(model.scaled(float(s)) for s in scale)
