"""Ordinary Kriging (7): the best linear unbiased prediction from all samples, with its standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from sklearn.utils.validation import check_is_fitted

from truepose.errors import KrigingError
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.repeats import Points
from truepose.predictors.system import System
from truepose.similarity import VariogramModel, experimental_variogram, fit_likelihood, fit_variogram
from truepose.similarity.threads import blas_threads

FloatArray = NDArray[np.float64]

CHUNK: Final = 2**22
"""Covariances of targets and samples in memory at once: 32 MB."""

SMALLEST_SCALE: Final = 1e-12
"""Variance of a component that does not vary, in units of the components' mean."""


@dataclass(frozen=True, eq=False)
class _Group:
    """Components whose covariance matrices are proportional: one factorisation.

    Attributes
    ----------
    components : list of int
    signal, micro : float
        Shares of partial sill and exact nugget in the unit variance.
    noise : (u,) array
        Unit variance of the noise of each point's mean.
    system : System
    """

    components: list[int]
    signal: float
    micro: float
    noise: FloatArray
    system: System


class OrdinaryKriging(Predictor):
    """Ordinary Kriging of all components from one factorisation, equation (7).

    The nugget of the variogram is noise of the readings (``exact=False``): it is filtered, the prediction does not pass
    through the samples, and the standard deviation is that of the noise-free error; ``predict(…, include_nugget=True)``
    adds the noise of a new reading. Or it is micro-scale variation of the error itself (``exact=True``): the prediction
    passes through the samples, and the standard deviation contains the nugget everywhere but there. `noise_std` given
    to `fit` is noise in either case, and comes on top of the nugget.

    With a variogram of its own the variance is that model's. A fitted one gives all components one correlation (the
    intrinsic model, equation (9) with B diagonal); the mean of `noise_std`² is taken off its nugget, and the scale of
    each component follows by generalised least squares.

    Repeats of one point are averaged. Where the variogram is fitted, or is without nugget and no `noise_std` is given,
    the noise is at least their scatter. With ``exact=True`` and no `noise_std` they must agree.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        For all components; or one for each, of one family and range; or the families to choose from in a fit of the
        components' mean semivariogram by `fit_variogram`. When not given, `fit_likelihood` finds it, which predicts
        better where a smooth trend hides how small the nugget is.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.

    Attributes
    ----------
    variogram_ : VariogramModel
        Mean over the components, as given or fitted.
    variograms_ : tuple of VariogramModel
        Of each component.
    mean_ : (k,) array [mm]
        GLS estimate of the mean.
    condition_ : float
        Condition number of the covariance matrix (the worst, if components have their own).

    Examples
    --------
    >>> model = OrdinaryKriging(VariogramModel("exponential", sill=1.0, range=100.0))
    >>> model.fit([[0.0], [100.0]], [1.0, 3.0]).predict([[0.0], [50.0]]).round(6)
    array([1., 2.])
    """

    def __init__(
        self,
        variogram: VariogramModel | Sequence[VariogramModel] | str | Sequence[str] | None = None,
        exact: bool = False,
    ) -> None:
        self.variogram = variogram
        self.exact = exact

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by the coordinates, (m, k, d) or (m, d).

        At a sample, where a model with a cusp (spherical, exponential, linear) has none, that sample counts as flat.
        """
        from truepose.similarity.covariance import weighted_gradient

        check_is_fitted(self)
        u = self._validate(X)[0] / self._model.range
        slope = weighted_gradient(self._model.kind.code, u, self._samples, self._weights) / self._model.range
        return slope[:, 0] if self._flat else slope

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e, self._points = e, Points.of(X)
        u, k = len(self._points.x), e.shape[1]
        if u < 2:
            count = "is 1 sample" if len(e) == 1 else f"are {len(e)} samples, all at one"
            raise KrigingError(f"Kriging needs samples at 2 points or more, but there {count}; measure more")
        noise = np.zeros_like(e) if noise_std is None else noise_std**2
        if self.exact and noise_std is None:
            self._points.refuse_contradictions(e)
        given = _given(self.variogram, k)
        with blas_threads(u):
            if given:
                _check_models(given, X.shape[1])
                self._factorise(given, noise)
                self.variogram_ = self.variogram if isinstance(self.variogram, VariogramModel) else _mean_model(given)
            else:
                self.variogram_ = self._estimate(X, noise)
                _check_models((self.variogram_,), X.shape[1])
                scale = self._factorise((self.variogram_,) * k, noise)
                scale = np.maximum(scale, SMALLEST_SCALE * scale.mean())
                self._factorise(tuple(self.variogram_.scaled(float(s)) for s in scale), noise)

    def _estimate(self, X: FloatArray, noise: FloatArray) -> VariogramModel:
        """Fit the variogram of the components' mean; what noise explains is no nugget, what repeats scatter is."""
        n, k = self._e.shape
        if self.variogram is None:
            model = fit_likelihood(X, self._e)
        else:
            bins = max(4, min(20, n * (n - 1) // 60))
            families = cast("str | Sequence[str]", self.variogram)
            model = fit_variogram(experimental_variogram(X, self._e / np.sqrt(k), bins=bins), families)
        nugget = model.nugget if self.exact else max(model.nugget, float(self._points.scatter(self._e).mean()))
        least = 1e-6 * model.nugget if model.sill == 0 else 0.0  # something must vary
        return replace(model, nugget=max(nugget - float(noise.mean()), least))

    def _factorise(self, models: tuple[VariogramModel, ...], noise: FloatArray) -> FloatArray:
        """Store all that a prediction needs; return the scale that GLS finds of each component's model, (k,)."""
        from truepose.similarity.compiled import pack

        points, k = self._points, len(models)
        nugget = np.array([m.nugget for m in models])
        self.variograms_ = models
        self._nugget = np.zeros(k) if self.exact else nugget
        if not (self.exact or noise.any() or nugget.any()):
            self._nugget = points.scatter(self._e)
        self._reading = noise + self._nugget
        self._mean_e, self._mean_noise = points.average(self._e, self._reading)

        self._model = models[0] if models[0].kind.bounded else _with_pseudo_sill(models[0], points.x)
        slope = 1.0 if models[0].kind.bounded else self._model.range / models[0].range
        signal = slope * np.array([m.sill for m in models])
        self._total = signal + nugget
        self._samples = pack(points.x / self._model.range)
        self._groups = self._grouped(signal / self._total, (nugget if self.exact else 0 * nugget) / self._total)

        u = len(points.x)
        self.mean_, self._alpha, scale = np.empty(k), np.empty((u, k)), np.empty(k)
        weights = np.empty((u, k))
        for group in self._groups:
            c = group.components
            mean, self._alpha[:, c], scale[c] = group.system.solve(self._mean_e[:, c])
            self.mean_[c] = mean[0]
            weights[:, c] = group.signal * self._alpha[:, c]
        scale /= self._total
        self._weights = pack(weights)
        self.condition_ = max(group.system.condition for group in self._groups)
        return scale

    def _grouped(self, signal: FloatArray, micro: FloatArray) -> list[_Group]:
        """Return one factorisation for all components with the same unit covariance matrix."""
        from truepose.similarity.covariance import cross_correlation

        u = len(self._points.x)
        noise = self._mean_noise / self._total
        shares = np.vstack([signal, micro, noise])
        groups: list[_Group] = []
        for c in range(len(signal)):
            alike = [g for g in groups if np.allclose(shares[:, g.components[0]], shares[:, c], rtol=1e-9, atol=1e-15)]
            if alike:
                alike[0].components.append(c)
                continue
            matrix = cross_correlation(self._model.kind.code, self._points.x / self._model.range, self._samples, u)
            matrix *= signal[c]
            matrix.flat[:: u + 1] = signal[c] + micro[c] + noise[:, c]
            system = System.factorise(matrix, np.ones((u, 1)), self._points.x)
            groups.append(_Group([c], float(signal[c]), float(micro[c]), noise[:, c], system))
        return groups

    def _predict(self, X: FloatArray, return_std: bool, include_nugget: bool) -> tuple[FloatArray, FloatArray | None]:
        from truepose.similarity.covariance import weighted_sum

        u = X / self._model.range
        e = self.mean_ + weighted_sum(self._model.kind.code, u, self._samples, self._weights)
        targets, points = self._at_samples(X)
        variance = self._variance(u, targets, points) if return_std else None
        for group in self._groups:
            c = np.array(group.components)
            e[np.ix_(targets, c)] += group.micro * self._alpha[np.ix_(points, c)]
            silent = group.noise[points] == 0  # a reading without noise is the error itself
            e[np.ix_(targets[silent], c)] = self._mean_e[np.ix_(points[silent], c)]
            if variance is not None:
                variance[np.ix_(targets[silent], c)] = 0.0
        if variance is None:
            return e, None
        return e, np.sqrt(variance + self._nugget if include_nugget else variance)

    def _variance(self, u: FloatArray, targets: NDArray[np.int64], points: NDArray[np.int64]) -> FloatArray:
        """Return the variance of the prediction at m scaled targets, (m, k), in chunks of bounded memory."""
        from truepose.similarity.covariance import cross_correlation

        n = len(self._points.x)
        variance = np.empty((len(u), len(self._total)))
        rows = max(1, CHUNK // n)
        for start in range(0, len(u), rows):
            part = slice(start, min(start + rows, len(u)))
            inside = (targets >= part.start) & (targets < part.stop)
            drift = np.ones((part.stop - part.start, 1))
            for group in self._groups:
                cross = cross_correlation(self._model.kind.code, u[part], self._samples, n)
                cross *= group.signal
                cross[targets[inside] - start, points[inside]] += group.micro
                unit = group.system.variance(cross, drift, group.signal + group.micro)
                variance[part, group.components] = unit[:, None] * self._total[group.components]
        return variance

    def _at_samples(self, X: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the targets that are samples, and which, where that makes a difference: else nothing."""
        if not any(group.micro or (group.noise == 0).any() for group in self._groups):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        found = KDTree(self._points.x).query(X, distance_upper_bound=1e-150)
        targets = np.flatnonzero(np.asarray(found[0]) == 0)
        return targets, np.asarray(found[1])[targets]

    def _leave_one_out(self) -> LeaveOneOut:
        prediction, field = np.empty_like(self._mean_e), np.empty_like(self._mean_e)
        for group in self._groups:
            c = group.components
            left_out = group.system.left_out_variance()[:, None]
            prediction[:, c] = self._mean_e[:, c] - self._alpha[:, c] * left_out
            field[:, c] = np.maximum(left_out - group.noise[:, None], 0.0) * self._total[c]
        inverse = self._points.inverse
        return LeaveOneOut(self._e - prediction[inverse], np.sqrt(field[inverse] + self._reading))

    def _fitted_parameters(self) -> dict[str, Any]:
        models = tuple(replace(model, fit=None) for model in self.variograms_)
        return {"variogram": models[0] if all(model == models[0] for model in models) else models}


def _given(variogram: Any, k: int) -> tuple[VariogramModel, ...]:
    """Return the model of each of k components, or nothing when they are to be fitted."""
    if isinstance(variogram, VariogramModel):
        return (variogram,) * k
    if variogram is None or isinstance(variogram, str):
        return ()
    models = tuple(variogram)
    if models and all(isinstance(model, str) for model in models):
        return ()
    if not all(isinstance(model, VariogramModel) for model in models):
        raise KrigingError("variogram holds something else than VariogramModel; give models, or names of families")
    if len(models) != k:
        raise KrigingError(f"{len(models)} variograms came for {k} components; give one for all, or one for each")
    return models


def _check_models(models: Sequence[VariogramModel], d: int) -> None:
    first = models[0]
    if first.kind.dimensions < d:
        raise KrigingError(
            f"a {first.family} variogram is valid in up to {first.kind.dimensions} coordinates, but X has {d}; "
            "use exponential, gaussian, matern32 or matern52"
        )
    if any((model.family, model.range) != (first.family, first.range) for model in models):
        raise KrigingError(
            "the variograms of the components differ in family or range; give them one correlation, or fit one "
            "OrdinaryKriging for each component"
        )


def _mean_model(models: Sequence[VariogramModel]) -> VariogramModel:
    nugget, sill = np.mean([(model.nugget, model.sill) for model in models], axis=0)
    return VariogramModel(models[0].family, nugget=float(nugget), sill=float(sill), range=models[0].range)


def _with_pseudo_sill(model: VariogramModel, x: FloatArray) -> VariogramModel:
    """Return a model without sill such that A − γ(h) can stand for its covariance; A cancels where weights sum to 1.

    A is γ at twice the diagonal of the points, so that the matrix is positive definite.
    """
    far = 2 * float(np.linalg.norm(np.ptp(x, axis=0)))
    return replace(model, sill=model.sill * far / model.range, range=far)
