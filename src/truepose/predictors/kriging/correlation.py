"""The correlation of a variogram model between points: the one place where predictors meet the compiled kernels.

A correlation is a sum of structures; each sees its own scaled coordinates u, in which its range is 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.similarity import VariogramModel, as_variogram
from truepose.similarity.gstools_models import is_covmodel


@dataclass(frozen=True, eq=False)
class Structure:
    """One structure of a correlation.

    Attributes
    ----------
    code : int
        Family, as the kernels number it.
    shape : float
        Shape parameter of the family; 0 where it has none.
    share : float
        Share of the partial sill; the shares have the sum 1.
    axes : (d, d) array
        u = x · axes.
    """

    code: int
    shape: float
    share: float
    axes: FloatArray

    def scaled(self, x: FloatArray) -> FloatArray:
        """Return u of positions x (n, d)."""
        return np.ascontiguousarray(x @ self.axes)


@dataclass(frozen=True, eq=False)
class Correlation:
    """rho(x, x') of a variogram model: its signal's covariance over its partial sill.

    Attributes
    ----------
    structures : tuple of Structure
    """

    structures: tuple[Structure, ...]

    @classmethod
    def of(cls, model: VariogramModel, d: int) -> Self:
        """Return the correlation of a model that has a sill, in d coordinates."""
        total = model.partial_sill
        return cls(
            tuple(
                Structure(part.kind.code, part.shape or 0.0, part.sill / total, part.coordinates(np.eye(d)))
                for part in model.structures
            )
        )

    def at(self, points: FloatArray) -> Sums:
        """Return the sums over points (n, d) that predictions need."""
        from truepose.numerics.compiled import pack

        return Sums(self, len(points), tuple(pack(s.scaled(points)) for s in self.structures))

    def matrix(self, points: FloatArray) -> FloatArray:
        """Return rho between points (n, d), (n, n)."""
        return self.at(points).cross(points)

    def of_distances(self, scaled: Sequence[FloatArray]) -> FloatArray:
        """Return rho at distances in the scaled coordinates of each structure, arrays of any shape."""
        from truepose.similarity.covariance import correlation

        total = None
        for s, r in zip(self.structures, scaled, strict=True):
            rho = correlation(s.code, r, s.shape)
            if s.share != 1.0:
                rho *= s.share
            total = rho if total is None else np.add(total, rho, out=total)
        return np.zeros(()) if total is None else total


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over fixed points, for any targets.

    Attributes
    ----------
    correlation : Correlation
    n : int
        Points.
    samples : tuple of packed arrays
        The points as each structure sees them.
    """

    correlation: Correlation
    n: int
    samples: tuple[FloatArray, ...]

    def cross(self, x: FloatArray) -> FloatArray:
        """Return rho between targets x (m, d) and the points, (m, n), C order."""
        from truepose.similarity.covariance import cross_correlation

        total = None
        for s, samples in self._structures():
            rho = cross_correlation(s.code, s.scaled(x), samples, self.n, s.shape)
            if s.share != 1.0:
                rho *= s.share
            total = rho if total is None else np.add(total, rho, out=total)
        return np.zeros((len(x), self.n)) if total is None else total

    def weighted(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Return Σ_j rho(x_i, x_j) w_jc, (m, k), of weights (n, k) packed."""
        from truepose.similarity.covariance import weighted_sum

        total = np.zeros((len(x), weights.shape[1]))
        for s, samples in self._structures():
            total += s.share * weighted_sum(s.code, s.scaled(x), samples, weights, s.shape)
        return total

    def gradient(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the derivative of `weighted` by the coordinates, (m, k, d)."""
        from truepose.similarity.covariance import weighted_gradient

        total = np.zeros((len(x), weights.shape[1], x.shape[1]))
        for s, samples in self._structures():
            total += s.share * weighted_gradient(s.code, s.scaled(x), samples, weights, s.shape) @ s.axes.T
        return total

    def _structures(self) -> Iterator[tuple[Structure, FloatArray]]:
        return zip(self.correlation.structures, self.samples, strict=True)


def given_models(variogram: Any, k: int) -> tuple[VariogramModel, ...]:
    """Return the model of each of k components, or nothing when they are to be fitted."""
    if variogram is None or isinstance(variogram, str):
        return ()
    if isinstance(variogram, VariogramModel) or is_covmodel(variogram):
        return (as_variogram(variogram),) * k
    models = tuple(variogram)
    if models and all(isinstance(model, str) for model in models):
        return ()
    models = tuple(as_variogram(model) for model in models)
    if len(models) != k:
        raise KrigingError(f"{len(models)} variograms came for {k} components; give one for all, or one for each")
    return models


def check_models(models: Sequence[VariogramModel], d: int) -> None:
    """Raise KrigingError where models are not valid in d coordinates, or differ in more than nugget and sill."""
    models[0].check_dimensions(d)
    if any(_correlation_of(model) != _correlation_of(models[0]) for model in models[1:]):
        raise KrigingError(
            "the variograms of the components differ in family or range; give them one correlation, or fit one "
            "predictor for each component"
        )


def mean_model(models: Sequence[VariogramModel]) -> VariogramModel:
    """Return the mean over components of models that differ in nugget and sill alone."""
    if all(model == models[0] for model in models):
        return models[0]
    nugget, sill = np.mean([(model.nugget, model.partial_sill) for model in models], axis=0)
    own = max(models, key=lambda model: model.partial_sill)
    factor = float(sill) / own.partial_sill if own.partial_sill else 1.0
    return replace(own.scaled(factor), nugget=float(nugget), fit=None)


def with_pseudo_sill(model: VariogramModel, x: FloatArray) -> tuple[VariogramModel, float]:
    """Return a model with a sill whose covariance can stand for −γ at points x, and the factor on the partial sill."""
    if model.bounded:
        return model, 1.0
    pseudo = model.with_pseudo_sill(x)
    return pseudo, pseudo.partial_sill / model.partial_sill


def _correlation_of(model: VariogramModel) -> list[tuple[object, ...]]:
    return [
        (part.family, part.shape, part.range, part.rotation, round(part.sill / model.partial_sill, 9))
        for part in model.structures
    ]
