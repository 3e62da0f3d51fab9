"""The parameters of an arm that a predictor estimated: joint posterior and prior, and what the samples alone say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import FloatArray

_NONE: Final = 1e-12


@dataclass(frozen=True, eq=False)
class ParameterEstimates:
    """Estimated changes of p parameters with normal priors.

    Attributes
    ----------
    names, kinds, units : tuple of str
        The name of each parameter, its kind (``theta``, ``a``, ``d``, ``base``, ``backlash`` …), and its unit.
    mean, covariance : (p,), (p, p) arrays
        The posterior, in the units of the parameters.
    prior_mean, prior_std : (p,) arrays
        The prior; a parameter without one has an infinite standard deviation.
    inflation : float
        The factor by which the posterior variances of the model are too small.
    rise : (dof, p) array [mm], optional
        The mean rise of the tool point at the samples because each joint turns under the largest payload, per
        coefficient; where no payload is modelled, zero.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    units: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    prior_mean: FloatArray
    prior_std: FloatArray
    inflation: float = 1.0
    rise: FloatArray | None = None

    @property
    def std(self) -> FloatArray:
        """The posterior standard deviations, (p,)."""
        return np.sqrt(self.inflation * np.maximum(np.diag(self.covariance), 0.0))

    def information(self, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the samples alone say: precision (p, p), and precision times the change, over `scale` (p,)."""
        prior = np.where(np.isfinite(self.prior_std), (scale / self.prior_std) ** 2, 0.0)
        covariance = self.covariance / (scale[:, None] * scale)
        value, vector = np.linalg.eigh(covariance)
        inverse = (vector / np.maximum(value, _NONE * value.max())) @ vector.T
        own, axes = np.linalg.eigh(inverse - np.diag(prior))
        precision = (axes * np.maximum(own, 0.0)) @ axes.T
        told = inverse @ ((self.mean - self.prior_mean) / scale) + precision @ (self.prior_mean / scale)
        return precision / self.inflation, told / self.inflation
