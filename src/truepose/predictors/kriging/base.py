"""The engine of Kriging from all samples: one factorisation, any drift, all components (equations (7) and (8))."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import KDTree
from sklearn.utils.validation import check_is_fitted

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.kriging.correlation import (
    Correlation,
    check_models,
    given_models,
    mean_model,
    with_pseudo_sill,
)
from truepose.predictors.kriging.drift import Drift, DriftLike
from truepose.predictors.kriging.random_fields import draw
from truepose.predictors.kriging.repeats import Points
from truepose.predictors.kriging.support import POINT, Support
from truepose.predictors.kriging.system import WORST, System
from truepose.predictors.kriging.variogram_estimation import estimate_model, own_scales
from truepose.similarity import VariogramModel

CHUNK: Final = 2**22
"""Covariances of targets and samples in memory at once: 32 MB."""


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


class GlobalKriging(Predictor):
    """Base of Kriging from all samples; a subclass says what the drift is.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        As for `OrdinaryKriging`.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    """

    variogram: VariogramModel | Sequence[VariogramModel] | str | Sequence[str] | None
    exact: bool

    # --- what a user asks -------------------------------------------------------------------------------------------

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by X, (m, k, d) or (m, d).

        At a sample, where a model with a cusp (spherical, exponential, linear) has none, that sample counts as flat.
        The nugget of exact Kriging has no derivative either.
        """
        check_is_fitted(self)
        x = self._validate(X)[0]
        inner = self._sums.gradient(self._coordinates(x), self._weights)
        slope = np.zeros((len(x), inner.shape[1], x.shape[1]))
        slope[:, :, self._is_coordinate(x.shape[1])] = inner
        if self._drift is not None:
            slope += np.einsum("mpd,pk->mkd", self._drift.gradient(x), self.beta_)
        return slope[:, 0] if self._flat else slope

    def predict_block(
        self, X: ArrayLike, size: ArrayLike, return_std: bool = False, nodes: int = 4
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Predict the mean of the error over boxes (block Kriging).

        The mean over a box is that of Gauss and Legendre's nodes. A nugget averages out over a volume, so the standard
        deviation has none. Source: A. G. Journel & C. J. Huijbregts, Mining Geostatistics (1978), §V.A.

        Parameters
        ----------
        X : (m, d) array_like
            Centres of the boxes.
        size : float or (d,) array_like
            Lengths of the boxes' edges, in the unit of the coordinates.
        return_std : bool
        nodes : int
            Nodes along each edge.

        Returns
        -------
        e : (m, k) or (m,) array [mm]
        std : (m, k) or (m,) array [mm]
            Only with `return_std`.

        Raises
        ------
        KrigingError
            If size or nodes cannot be, or the drift has columns of its own, which are not known inside the box.
        """
        check_is_fitted(self)
        x = self._validate(X)[0]
        if not self._is_coordinate(x.shape[1]).all():
            raise KrigingError("columns of X that are drift are not known inside a box; predict points instead")
        support = Support.box(size, x.shape[1], nodes, self._correlation)
        e = self._mean(x, support)
        if not return_std:
            return self._shaped(e)
        none = np.empty(0, np.int64)
        return self._shaped(e), self._shaped(np.sqrt(self._variance(x, none, none, support)))

    def covariance(self, X: ArrayLike, include_nugget: bool = False) -> FloatArray:
        """Return the covariance of the prediction's errors between m targets, (k, m, m) or (m, m) [mm²].

        Its diagonal is the square of `predict`'s standard deviation.
        """
        check_is_fitted(self)
        covariance = self._covariance(self._validate(X)[0], include_nugget)
        return covariance[0] if self._flat else covariance

    def simulate(
        self, X: ArrayLike, size: int = 1, *, rng: np.random.Generator | int = 0, include_nugget: bool = False
    ) -> FloatArray:
        """Draw fields that could be, given the samples (conditional simulation).

        They pass through what `predict` passes through, and vary between as the variogram says. Drawn from the joint
        covariance of the targets, which takes 8 m² bytes and O(m³) time.

        Parameters
        ----------
        X : (m, d) array_like
        size : int
            Number of fields.
        rng : Generator or int
        include_nugget : bool
            Add the noise of one new reading at each target.

        Returns
        -------
        (size, m, k) or (size, m) array [mm]
        """
        check_is_fitted(self)
        x = self._validate(X)[0]
        fields = self._predict(x, False)[0] + draw(self._covariance(x, include_nugget), size, rng)
        return fields[:, :, 0] if self._flat else fields

    def _leave_blocks_out(self, labels: NDArray[Any]) -> LeaveOneOut:
        """Predict the samples of each block from those of the others, from the one factorisation.

        Residual of a block I: (P_II)⁻¹ (P e)_I, with covariance (P_II)⁻¹; a point measured repeatedly is left out with
        all its repeats. Source: D. Ginsbourger & C. Schärer, Fast calculation of Gaussian process multiple-fold
        cross-validation residuals (2021).
        """
        residual, field = np.empty_like(self._e), np.empty_like(self._e)
        for label in np.unique(labels):
            rows = np.flatnonzero(labels == label)
            points, place = np.unique(self._points.inverse[rows], return_inverse=True)
            for group in self._groups:
                c = np.array(group.components)
                covariance: FloatArray = _inverse(group.system.left_out_precision(points), label)
                prediction = self._mean_e[np.ix_(points, c)] - covariance @ self._alpha[np.ix_(points, c)]
                own = np.maximum(covariance.diagonal() - group.noise[points], 0.0)
                residual[np.ix_(rows, c)] = self._e[np.ix_(rows, c)] - prediction[place]
                field[np.ix_(rows, c)] = own[place, None] * self._total[c]
        return LeaveOneOut(residual, np.sqrt(field + self._reading))

    # --- what a subclass says ---------------------------------------------------------------------------------------

    @abstractmethod
    def _drift_kind(self) -> DriftLike | None:
        """Return the drift, or None for a known mean."""

    def _known_mean(self, k: int) -> FloatArray:
        return np.zeros(k)

    # --- fit --------------------------------------------------------------------------------------------------------

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e, self._points = e, Points.of(X)
        u, k = len(self._points.x), e.shape[1]
        if u < 2:
            count = "is 1 sample" if len(e) == 1 else f"are {len(e)} samples, all at one"
            raise KrigingError(f"Kriging needs samples at 2 points or more, but there {count}; measure more")
        noise = np.zeros_like(e) if noise_std is None else noise_std**2
        if self.exact and noise_std is None:
            self._points.refuse_contradictions(e)
        kind = self._drift_kind()
        self._drift = None if kind is None else Drift.of(kind, self._points.x)
        self._offset = self._known_mean(k)
        given = given_models(self.variogram, k)
        if given:
            self._factorise(given, noise)
            self.variogram_ = mean_model(given)
        else:
            self.variogram_ = estimate_model(
                self.variogram, self._coordinates(X), e, self._basis(X), noise, self._points, self.exact
            )
            self._factorise(own_scales(self.variogram_, self._factorise((self.variogram_,) * k, noise)), noise)

    def _factorise(self, models: tuple[VariogramModel, ...], noise: FloatArray) -> FloatArray:
        """Store all that a prediction needs; return the scale that GLS finds of each component's model, (k,)."""
        from truepose.numerics.compiled import pack

        points, k = self._points, len(models)
        x = self._coordinates(points.x)
        check_models(models, x.shape[1])
        if self._drift is None and not models[0].bounded:
            raise KrigingError(f"simple Kriging needs a sill, and {models[0].family} has none; use OrdinaryKriging")
        nugget = np.array([m.nugget for m in models])
        self.variograms_ = models
        self._nugget = np.zeros(k) if self.exact else nugget
        if not (self.exact or noise.any() or nugget.any()):
            self._nugget = points.scatter(self._e)
        self._reading = noise + self._nugget
        self._mean_e, self._mean_noise = points.average(self._e, self._reading)
        if not self._mean_noise.any():
            points.refuse_near_contradictions(self._mean_e, models, x)

        model, rise = with_pseudo_sill(models[0], x)
        signal = rise * np.array([m.partial_sill for m in models])
        self._total = signal + nugget
        self._correlation = Correlation.of(model, x.shape[1])
        self._sums = self._correlation.at(x)
        self._groups = self._grouped(x, signal / self._total, (nugget if self.exact else 0 * nugget) / self._total)

        u = len(points.x)
        self._alpha, weights, scale = np.empty((u, k)), np.empty((u, k)), np.empty(k)
        self.beta_ = np.empty((self._groups[0].system.q.shape[1], k))
        for group in self._groups:
            c = group.components
            self.beta_[:, c], self._alpha[:, c], s2 = group.system.solve(self._mean_e[:, c] - self._offset[c])
            scale[c] = s2.diagonal()
            weights[:, c] = group.signal * self._alpha[:, c]
        self._weights = pack(weights)
        self.condition_ = max(group.system.condition for group in self._groups)
        own: FloatArray = scale / self._total
        return own

    def _grouped(self, x: FloatArray, signal: FloatArray, micro: FloatArray) -> list[_Group]:
        """Return one factorisation for all components with the same unit covariance matrix."""
        u = len(x)
        noise = self._mean_noise / self._total
        shares = np.vstack([signal, micro, noise])
        groups: list[_Group] = []
        for c in range(len(signal)):
            alike = [g for g in groups if np.allclose(shares[:, g.components[0]], shares[:, c], rtol=1e-9, atol=1e-15)]
            if alike:
                alike[0].components.append(c)
                continue
            matrix = self._sums.cross(x)
            matrix *= signal[c]
            matrix.flat[:: u + 1] = signal[c] + micro[c] + noise[:, c]
            system = System.factorise(matrix, self._basis(self._points.x), self._points.x)
            groups.append(_Group([c], float(signal[c]), float(micro[c]), noise[:, c], system))
        return groups

    # --- prediction -------------------------------------------------------------------------------------------------

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e = self._mean(X, POINT)
        targets, points = self._at_samples(X)
        variance = self._variance(X, targets, points, POINT) if return_std else None
        for group in self._groups:
            c = np.array(group.components)
            e[np.ix_(targets, c)] += group.micro * self._alpha[np.ix_(points, c)]
            silent = group.noise[points] == 0  # a reading without noise is the error itself
            e[np.ix_(targets[silent], c)] = self._mean_e[np.ix_(points[silent], c)]
            if variance is not None:
                variance[np.ix_(targets[silent], c)] = 0.0
        if variance is None:
            return e, None
        return e, np.sqrt(variance)

    def _nugget_variance(self) -> FloatArray:
        return self._nugget

    def _mean(self, X: FloatArray, support: Support) -> FloatArray:
        e = self._sums.weighted
        x = self._coordinates(X)
        smooth = support.average(lambda shift: e(x + shift, self._weights))
        return self._offset + smooth + support.average(lambda shift: self._basis(X + shift)) @ self.beta_

    def _variance(self, X: FloatArray, targets: IntArray, points: IntArray, support: Support) -> FloatArray:
        """Return the variance of the prediction at m targets, (m, k), in chunks of bounded memory."""
        variance = np.empty((len(X), len(self._total)))
        for part in self._chunks(len(X)):
            inside = (targets >= part.start) & (targets < part.stop)
            drift = support.average(lambda shift, X=X[part]: self._basis(X + shift))  # type: ignore[misc]
            for group in self._groups:
                cross = self._cross(group, X[part], targets[inside] - part.start, points[inside], support)
                prior = group.signal * support.within + group.micro * (support is POINT)
                unit = group.system.variance(cross, drift, prior)
                variance[part, group.components] = unit[:, None] * self._total[group.components]
        return variance

    def _cross(
        self, group: _Group, X: FloatArray, targets: IntArray, points: IntArray, support: Support = POINT
    ) -> FloatArray:
        """Return the unit covariance of targets and points, (m, u)."""
        x = self._coordinates(X)
        cross = support.average(lambda shift: self._sums.cross(x + shift))
        cross *= group.signal
        cross[targets, points] += group.micro
        return cross

    def _covariance(self, X: FloatArray, include_nugget: bool) -> FloatArray:
        targets, points = self._at_samples(X)
        out = np.empty((len(self._total), len(X), len(X)))
        drift, same = self._basis(X), self._coordinates(X)
        one = (same[:, None] == same[None]).all(axis=2) if self.exact else np.zeros(0)
        for group in self._groups:
            half, spread = group.system.reduce(self._cross(group, X, targets, points), drift)
            unit = group.signal * self._correlation.matrix(same) - half.T @ half + spread.T @ spread
            if group.micro:
                unit += group.micro * one
            silent = targets[group.noise[points] == 0]
            unit[silent] = unit[:, silent] = 0.0
            out[group.components] = unit * self._total[group.components, None, None]
        if include_nugget:
            out[:, np.arange(len(X)), np.arange(len(X))] += self._nugget[:, None]
        return out

    def _at_samples(self, X: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the targets that are samples, and which, where that makes a difference: else nothing."""
        if not any(group.micro or (group.noise == 0).any() for group in self._groups):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        found = KDTree(self._points.x).query(X, distance_upper_bound=1e-150)
        targets = np.flatnonzero(np.asarray(found[0]) == 0)
        return targets, np.asarray(found[1])[targets]

    # --- the rest ---------------------------------------------------------------------------------------------------

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

    def _coordinates(self, X: FloatArray) -> FloatArray:
        return X if self._drift is None else self._drift.coordinates(X)

    def _is_coordinate(self, d: int) -> BoolArray:
        return np.ones(d, bool) if self._drift is None else ~np.isin(np.arange(d), self._drift.columns)

    def _basis(self, X: FloatArray) -> FloatArray:
        return np.empty((len(X), 0)) if self._drift is None else self._drift(X)

    def _chunks(self, m: int) -> list[slice]:
        rows = max(1, CHUNK // len(self._points.x))
        return [slice(start, min(start + rows, m)) for start in range(0, m, rows)]


def _inverse(precision: FloatArray, label: Any) -> FloatArray:
    """Return the inverse of P_II, which is singular where the others cannot tell the drift."""
    try:
        factor = cho_factor(precision, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        factor = None
    if factor is None or factor[0].diagonal().min() ** 2 < WORST * precision.diagonal().max():
        raise KrigingError(
            f"without block {label} of {len(precision)} points the others cannot tell the drift; use smaller blocks"
        )
    inverse: FloatArray = cho_solve(factor, np.eye(len(precision)), check_finite=False)
    return inverse
