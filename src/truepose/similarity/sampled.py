"""Variance and noise over the distances that were sampled: one set of figures, without an extrapolated sill."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.similarity.experimental import ExperimentalVariogram
from truepose.similarity.model import VariogramModel


@dataclass(frozen=True)
class Sampled:
    """What a model says of the distances that were sampled: nothing is extrapolated.

    Attributes
    ----------
    lag : float
        The largest lag of the semivariogram.
    variance : float [mm²]
        γ at that lag: sill and nugget where the sill is reached within it.
    nugget : float [mm²]
    sill : bool
        Whether the sill is reached within it.
    """

    lag: float
    variance: float
    nugget: float
    sill: bool

    @property
    def noise_share(self) -> float:
        """Nugget over variance."""
        return min(self.nugget / self.variance, 1.0) if self.variance > 0 else 1.0

    @property
    def structure_percent(self) -> float:
        """The rest, rounded to the digits in which noise is told, at least to whole percents."""
        noise = float(f"{100 * self.noise_share:.2g}")
        return round(100.0 - noise, max(0, 1 - math.floor(math.log10(noise))) if 0 < noise < 1 else 0)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, units in the names."""
        return {
            "largest_lag": self.lag,
            "variance_mm2": self.variance,
            "nugget_mm2": self.nugget,
            "noise_share": self.noise_share,
            "sill_within_samples": self.sill,
        }


def sampled(model: VariogramModel, variogram: ExperimentalVariogram, nugget: float | None = None) -> Sampled:
    """Return what a model says of the distances that a semivariogram holds.

    Parameters
    ----------
    model : VariogramModel
        Fitted to `variogram`. Of an anisotropic model the variance is the mean over the axes.
    variogram : ExperimentalVariogram
    nugget : float [mm²], optional
        Noise that is known better than the model tells it, as by `fit_likelihood`; the model's when not given.
    """
    lag = float(variogram.lag[variogram.pairs > 0].max())
    axes = [None] if model.isotropic else list(np.eye(variogram.dimensions))
    variance = float(np.mean([model.semivariance(lag, axis) for axis in axes]))
    return Sampled(lag, variance, model.nugget if nugget is None else nugget, model.practical_range <= lag)
