"""The base of Kriging predictors: their variogram, given or fitted, their drift, noise and groups of components."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np
from scipy.spatial import KDTree

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.base import Predictor
from truepose.predictors.kriging.correlation import Correlation
from truepose.predictors.repeats import Points
from truepose.similarity.experimental import experimental_variogram
from truepose.similarity.fit import fit_variogram
from truepose.similarity.gstools_models import as_variogram, is_covmodel
from truepose.similarity.likelihood import LikelihoodFit, fit_likelihood
from truepose.similarity.model import VariogramModel, without_warning
from truepose.similarity.trend import DriftBasis, DriftLike

VariogramLike = VariogramModel | Sequence[VariogramModel] | str | Sequence[str] | None

SMALLEST_SCALE: Final = 1e-12
"""Variance of a component that does not vary, in units of the fitted model's."""

NEAR: Final = 0.01
"""Points are near when they are apart by less than this share of the usual distance to the nearest point; the errors
of near points differ when they do so by more than this share of the standard deviation of all."""

CONTRADICTION: Final = 30.0
"""Near points contradict each other when their errors differ by this many standard deviations of the variogram."""


class Kriging(Predictor):
    """Base of Kriging: a subclass states the drift, and how the systems of equations are solved.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        The variogram, as for `OrdinaryKriging`.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    """

    variogram: VariogramLike
    exact: bool
    _known: LikelihoodFit | None = None

    # --- methods of a subclass ----------------------------------------------------------------------------------------

    @abstractmethod
    def _drift_kind(self) -> DriftLike | None:
        """Return the drift, or None for a known mean."""

    @abstractmethod
    def _check_parameters(self, u: int, k: int) -> None:
        """Raise KrigingError where a parameter does not suit u points with k components."""

    @abstractmethod
    def _check_sill(self, model: VariogramModel) -> None:
        """Raise KrigingError where the predictor needs a sill, and the model has none."""

    @abstractmethod
    def _solve(self, x: FloatArray, signal: FloatArray, micro: FloatArray) -> None:
        """Prepare predictions from points (u, d), given the shares of the unit variance of each component, (k,)."""

    @abstractmethod
    def _scale(self) -> FloatArray:
        """Return the variance of each component in units of its model's, (k,)."""

    def _refined(self, model: VariogramModel, noise: FloatArray) -> VariogramModel:
        """Return a fitted variogram, refined where a subclass can."""
        return model

    # --- fit ----------------------------------------------------------------------------------------------------------

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e, self._points = e, Points.of(X)
        u, k = len(self._points.x), e.shape[1]
        if u < 2:
            count = "is 1 sample" if len(e) == 1 else f"are {len(e)} samples, all at one"
            raise KrigingError(f"Kriging needs samples at 2 points or more, but there {count}; measure more")
        noise = np.zeros(e.shape) if noise_std is None else noise_std**2
        if self.exact and noise_std is None:
            self._points.refuse_contradictions(e)
        kind = self._drift_kind()
        self._drift = None if kind is None else DriftBasis.of(kind, self._points.x)
        self._check_parameters(u, k)
        given = given_models(self.variogram, k)
        self._optimum: LikelihoodFit | None = None
        if given:
            self._assemble(given, noise)
            self.variogram_ = mean_model(given)
            return
        x, drift = self._coordinates(X), self._basis(X)
        found = estimate_model(self.variogram, x, e, drift, noise, self._points, self.exact, self._known)
        self._optimum = found.fit if isinstance(found.fit, LikelihoodFit) else None
        self.variogram_ = self._refined(found, noise)
        self._assemble((self.variogram_,) * k, noise)
        self._assemble(own_scales(self.variogram_, self._scale()), noise)

    def optimum(self) -> LikelihoodFit | None:
        """Return the record of the fitted variogram for `start_from`; None where it was not fitted by likelihood."""
        self._check_fitted()
        return self._optimum

    def start_from(self, optimum: LikelihoodFit | None) -> None:
        """Let searches for the variogram start at the `optimum` of a model of similar samples and equal parameters."""
        self._known = optimum

    def _assemble(self, models: tuple[VariogramModel, ...], noise: FloatArray) -> None:
        """Store what a prediction needs, given the models of all components and the variance of the readings."""
        points, k = self._points, len(models)
        x = self._coordinates(points.x)
        check_models(models, x.shape[1])
        self._check_sill(models[0])
        nugget, sill = np.array([(m.nugget, m.partial_sill) for m in models]).T
        self.variograms_ = models
        self._nugget = np.zeros(k) if self.exact else nugget
        if not (self.exact or nugget.any() or noise.any()):
            self._nugget = points.scatter(self._e)
        self._reading = noise + self._nugget
        self._mean_e, self._mean_noise = points.average(self._e, self._reading)
        if not self._mean_noise.any():
            _refuse_near_contradictions(points, self._mean_e, models, x)
        model, rise = with_pseudo_sill(models[0], x)
        signal = rise * sill
        self._total = signal + nugget
        self._correlation = Correlation.of(model, x.shape[1])
        try:
            self._solve(x, signal / self._total, nugget / self._total if self.exact else np.zeros(k))
        except KrigingError as error:
            raise error.of_rows(points.first.tolist()) from None

    def _alike(self, signal: FloatArray, micro: FloatArray) -> tuple[list[list[int]], FloatArray]:
        """Return the components with the same unit covariance matrix, and the unit variance of the noise, (u, k)."""
        noise = self._mean_noise / self._total
        if len(set(signal)) == len(set(micro)) == 1 and (noise == noise[:, :1]).all():
            return [list(range(len(signal)))], noise
        shares = np.vstack([signal, micro, noise])
        groups: list[list[int]] = []
        for c in range(len(signal)):
            for group in groups:
                if np.allclose(shares[:, group[0]], shares[:, c], rtol=1e-9, atol=1e-15):
                    group.append(c)
                    break
            else:
                groups.append([c])
        return groups, noise

    @classmethod
    def _parameter(cls, name: str, value: Any) -> Any:
        return models_from_plain(value) if name == "variogram" else super()._parameter(name, value)

    # --- parts of predictions -----------------------------------------------------------------------------------------

    def _nugget_variance(self) -> FloatArray:
        return self._nugget

    def _fitted_parameters(self) -> dict[str, Any]:
        models = tuple(replace(model, fit=None) for model in self.variograms_)
        return {"variogram": models[0] if all(model == models[0] for model in models) else models}

    def _coordinates(self, X: FloatArray) -> FloatArray:
        return X if self._drift is None else self._drift.coordinates(X)

    def _basis(self, X: FloatArray) -> FloatArray:
        return np.empty((len(X), 0)) if self._drift is None else self._drift(X)


def given_models(variogram: Any, k: int) -> tuple[VariogramModel, ...]:
    """Return the model of each of k components; an empty tuple when they have to be fitted."""
    if variogram is None or isinstance(variogram, str):
        return ()
    if isinstance(variogram, VariogramModel) or is_covmodel(variogram):
        return (as_variogram(variogram),) * k
    models = tuple(variogram)
    if models and all(isinstance(model, str) for model in models):
        return ()
    models = tuple(as_variogram(model) for model in models)
    if len(models) != k:
        raise KrigingError(f"expected one variogram for all of {k} components or one for each, got {len(models)}")
    return models


def models_from_plain(value: Any) -> Any:
    """Return the variogram parameter of a predictor from the plain value of `to_dict`."""
    if isinstance(value, Mapping):
        return VariogramModel.from_dict(dict(value))
    return tuple(models_from_plain(item) for item in value) if isinstance(value, list | tuple) else value


def check_models(models: Sequence[VariogramModel], d: int) -> None:
    """Raise KrigingError where models are not valid in d coordinates, or differ in more than nugget and sill."""
    models[0].check_dimensions(d)
    others = [model for model in models[1:] if model is not models[0]]
    if any(_correlation_of(model) != _correlation_of(models[0]) for model in others):
        raise KrigingError(
            "the variograms of the components differ in family or range; give them one correlation, or fit one "
            "predictor for each component"
        )


def mean_model(models: Sequence[VariogramModel]) -> VariogramModel:
    """Return the mean over components of models that differ in nugget and sill alone."""
    if all(model is models[0] or model == models[0] for model in models):
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


def estimate_model(
    variogram: Any,
    x: FloatArray,
    e: FloatArray,
    drift: FloatArray,
    noise: FloatArray,
    points: Points,
    exact: bool,
    start: LikelihoodFit | None = None,
) -> VariogramModel:
    """Fit the variogram of the components' mean.

    The nugget is at least the scatter of repeats, and the known noise is subtracted from it.

    Parameters
    ----------
    variogram : None, str or sequence of str
        The families for weighted least squares; None for restricted likelihood.
    x : (n, d) array
        The coordinates.
    e : (n, k) array
        The errors.
    drift : (n, p) array
        The columns of the drift, removed from e by least squares first if there is more than a constant.
    noise : (n, k) array
        The variance of the readings.
    points : Points
        The distinct points of the samples.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    start : LikelihoodFit, optional
        The `start` of the fit by likelihood.
    """
    n, k = e.shape
    if drift.shape[1] > 1:
        e = e - drift @ np.linalg.lstsq(drift, e)[0]
    with without_warning():  # a predictor is fitted many times; its variogram keeps the remarks
        if variogram is None:
            model = fit_likelihood(x, e, start=start)
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


def _refuse_near_contradictions(
    points: Points, e: FloatArray, models: tuple[VariogramModel, ...], coordinates: FloatArray
) -> None:
    """Raise KrigingError, naming the rows, where near points differ more than the variograms allow.

    Parameters
    ----------
    points : Points
        The points.
    e : (u, k) array
        The errors of the points, which have no noise.
    models : tuple of k VariogramModel
        The model of each component.
    coordinates : (u, d) array
        The points in the coordinates of the variograms: without columns that are drift only.
    """
    if len(points.x) < 3:
        return
    found = KDTree(points.x).query(points.x, k=2)
    distance, nearest = np.asarray(found[0])[:, 1], np.asarray(found[1])[:, 1]
    i = np.flatnonzero(distance < NEAR * np.median(distance))
    j = nearest[i]
    for c, model in enumerate(models):
        scale = e[:, c].var() / (model.nugget + model.sill) if model.bounded else 1.0
        expected = 2 * scale * model.semivariance_between(coordinates[i], coordinates[j])
        difference = np.abs(e[i, c] - e[j, c])
        ratio = np.where(difference > NEAR * e[:, c].std(), difference / np.sqrt(np.maximum(expected, 1e-30)), 0.0)
        if ratio.size and ratio.max() > CONTRADICTION:
            worst = int(np.argmax(ratio))
            rows = sorted(int(np.flatnonzero(points.inverse == point)[0]) for point in (i[worst], j[worst]))
            raise KrigingError(
                f"{{rows}} are {distance[i[worst]]:.3g} apart, but their errors differ by "
                f"{difference[worst]:.3g}, {ratio[worst]:.3g} standard deviations of the "
                "variogram, and exact Kriging would swing between them; use exact=False with a nugget, give "
                "noise_std, or drop one",
                rows,
            )
