"""The engine of Kriging from the samples near each target (13): many small systems instead of a large one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree
from sklearn.utils.validation import check_is_fitted

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.numerics.threads import threads
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.kriging.correlation import Correlation, check_models, given_models, mean_model
from truepose.predictors.kriging.drift import Drift, DriftLike
from truepose.predictors.kriging.ordinary import VariogramLike
from truepose.predictors.kriging.repeats import Points
from truepose.predictors.kriging.variogram_estimation import estimate_model, own_scales
from truepose.similarity import VariogramModel

CHUNK: Final = 2**21
"""Correlations worked on at once: 16 MB."""

SCALING: Final = 2000
"""Samples whose leave-one-out residuals give the scale of a fitted variogram."""


@dataclass(frozen=True, eq=False)
class Group:
    """Components with one unit covariance.

    Attributes
    ----------
    components : array of int
    signal, micro : float
        Shares of partial sill and exact nugget in the unit variance.
    noise : (u,) array
        Unit variance of the noise of each point's mean.
    right : (u, p + c) array
        Columns of the drift, then the errors of these components.
    """

    components: IntArray
    signal: float
    micro: float
    noise: FloatArray
    right: FloatArray

    @property
    def prior(self) -> float:
        """Unit variance of the error."""
        return self.signal + self.micro


class NeighbourKriging(Predictor):
    """Base of Kriging from the nearest samples; a subclass says how the drift is found.

    Parameters
    ----------
    neighbours : int
    variogram, exact
        As for `OrdinaryKriging`; the variogram needs a sill.
    drift
        As for `UniversalKriging`.
    """

    def __init__(
        self,
        neighbours: int = 32,
        variogram: VariogramLike = None,
        exact: bool = False,
        drift: DriftLike = "constant",
    ) -> None:
        self.neighbours = neighbours
        self.variogram = variogram
        self.exact = exact
        self.drift = drift

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by X while the neighbours stay the same, (m, k, d) or (m, d)."""
        check_is_fitted(self)
        x = self._validate(X)[0]
        slope = np.empty((len(x), len(self._total), x.shape[1]))
        for part, near, _ in self._parts(x, self.neighbours):
            for group in self._groups:
                slope[part, group.components] = self._slope(x[part], near, group)
        return slope[:, 0] if self._flat else slope

    # --- what a subclass says ---------------------------------------------------------------------------------------

    @abstractmethod
    def _scale(self, group: Group) -> FloatArray:
        """Return the variance of the group's components in units of the model's, (c,)."""

    @abstractmethod
    def _combine(self, group: Group, gram: FloatArray, f0: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (m, c) and unit variance (m,) from [k0, F, e]ᵀ K⁻¹ [k0, F, e] and the drift at the targets."""

    @abstractmethod
    def _coefficients(self, group: Group, inverse: FloatArray, near: IntArray) -> FloatArray:
        """Return beta of each target, (m, p, c), given K⁻¹ of its neighbours (m, k, k)."""

    def _refined(self, model: VariogramModel, noise: FloatArray) -> VariogramModel:
        """Return a fitted variogram (k components alike), refined where a subclass can."""
        return model

    def _prepare(self) -> None:
        """Prepare what is common to all targets, once the groups are there."""

    # --- fit --------------------------------------------------------------------------------------------------------

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e, self._points = e, Points.of(X)
        u, k = len(self._points.x), e.shape[1]
        if u < 2:
            count = "is 1 sample" if len(e) == 1 else f"are {len(e)} samples, all at one"
            raise KrigingError(f"Kriging needs samples at 2 points or more, but there {count}; measure more")
        if (
            isinstance(self.neighbours, bool)
            or not isinstance(self.neighbours, int | np.integer)
            or self.neighbours < 1
        ):
            raise KrigingError(f"neighbours is {self.neighbours!r}; expected a whole number of 1 or more")
        noise = np.zeros_like(e) if noise_std is None else noise_std**2
        if self.exact and noise_std is None:
            self._points.refuse_contradictions(e)
        self._drift = Drift.of(self.drift, self._points.x)
        columns = self._drift(self._points.x[:1]).shape[1]
        if min(self.neighbours, u) < columns:
            raise KrigingError(
                f"{min(self.neighbours, u)} neighbours cannot tell a drift of {columns} columns; use more neighbours "
                "or a simpler drift"
            )
        given = given_models(self.variogram, k)
        if given:
            self._set(given, noise)
            self.variogram_ = mean_model(given)
            return
        x, basis = self._drift.coordinates(X), self._drift(X)
        found = estimate_model(self.variogram, x, e, basis, noise, self._points, self.exact)
        self.variogram_ = self._refined(found, noise)
        self._set((self.variogram_,) * k, noise)
        scale = np.empty(k)
        for group in self._groups:
            scale[group.components] = self._scale(group)
        self._set(own_scales(self.variogram_, scale), noise)

    def _set(self, models: tuple[VariogramModel, ...], noise: FloatArray) -> None:
        """Store all that a prediction needs."""
        points, k = self._points, len(models)
        x = self._drift.coordinates(points.x)
        check_models(models, x.shape[1])
        if not models[0].bounded:
            raise KrigingError(
                f"{type(self).__name__} needs a sill, and {models[0].family} has none; use OrdinaryKriging"
            )
        nugget = np.array([m.nugget for m in models])
        self.variograms_ = models
        self._nugget = np.zeros(k) if self.exact else nugget
        if not (self.exact or noise.any() or nugget.any()):
            self._nugget = points.scatter(self._e)
        self._reading = noise + self._nugget
        self._mean_e, self._mean_noise = points.average(self._e, self._reading)
        if not self._mean_noise.any():
            points.refuse_near_contradictions(self._mean_e, models, x)
        signal = np.array([m.partial_sill for m in models])
        self._total = signal + nugget
        self._correlation = Correlation.of(models[0], x.shape[1])
        self._scaled = tuple(s.scaled(x) for s in self._correlation.structures) or (x,)
        self._tree = KDTree(self._scaled[0])
        self._basis = self._drift(points.x)
        self._groups = self._grouped(signal / self._total, (nugget if self.exact else 0 * nugget) / self._total)
        self._prepare()

    def _grouped(self, signal: FloatArray, micro: FloatArray) -> list[Group]:
        noise = self._mean_noise / self._total
        shares = np.vstack([signal, micro, noise])
        left, groups = list(range(len(signal))), []
        while left:
            alike = [c for c in left if np.allclose(shares[:, left[0]], shares[:, c], rtol=1e-9, atol=1e-15)]
            left = [c for c in left if c not in alike]
            c = alike[0]
            right = np.ascontiguousarray(np.hstack([self._basis, self._mean_e[:, alike]]))
            groups.append(Group(np.array(alike), float(signal[c]), float(micro[c]), noise[:, c].copy(), right))
        return groups

    # --- prediction -------------------------------------------------------------------------------------------------

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e, variance = np.empty((2, len(X), len(self._total)))
        for part, near, distance in self._parts(X, self.neighbours):
            e[part], variance[part] = self._moments(X[part], near, distance[:, 0] == 0)
        if not return_std:
            return e, None
        return e, np.sqrt(variance)

    def _nugget_variance(self) -> FloatArray:
        return self._nugget

    def _moments(self, X: FloatArray, near: IntArray, here: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance at targets, (m, k); `here` where the first neighbour is at the target."""
        e, variance = np.empty((2, len(X), len(self._total)))
        targets = [s.scaled(self._drift.coordinates(X)) for s in self._correlation.structures]
        rho = self._rho(targets, near)
        f0 = self._drift(X)
        for group in self._groups:
            gram = self._gram(group, rho, near, np.where(here, group.micro, 0.0))
            mean, unit = self._combine(group, gram, f0)
            silent = np.flatnonzero(here & (group.noise[near[:, 0]] == 0))  # a reading without noise is the error
            mean[silent] = self._mean_e[np.ix_(near[silent, 0], group.components)]
            unit[silent] = 0.0
            e[:, group.components] = mean
            variance[:, group.components] = np.maximum(unit, 0.0)[:, None] * self._total[group.components]
        return e, variance

    def _rho(self, targets: Sequence[FloatArray], near: IntArray) -> FloatArray:
        """Return the correlations among neighbours and with their targets, in lanes."""
        from truepose.numerics.small_systems import pair_distances

        if not targets:
            return 0 * pair_distances(self._scaled[0], self._scaled[0][near[:, 0]], near)
        return self._correlation.of_distances(
            [pair_distances(u, x, near) for u, x in zip(self._scaled, targets, strict=True)]
        )

    def _gram(self, group: Group, rho: FloatArray, near: IntArray, at_target: FloatArray) -> FloatArray:
        from truepose.numerics.small_systems import eliminate

        gram = eliminate(rho, near, group.signal, group.prior + group.noise, at_target, group.right)
        bad = np.flatnonzero(np.isnan(gram[:, 0, 0]))
        if bad.size:
            rows = near[bad[0]]
            raise KrigingError(
                f"the covariance matrix of the {near.shape[1]} samples near a target is singular to 64 bits (points "
                f"{', '.join(map(str, rows[:3]))} …; {bad.size} targets in all); give the variogram a nugget, use a "
                "rougher family (matern52 for gaussian), or fewer neighbours"
            )
        return gram

    def _parts(self, X: FloatArray, neighbours: int) -> Iterator[tuple[slice, IntArray, FloatArray]]:
        """Yield parts of the targets with their nearest points in units of the ranges and the distances, (m, k)."""
        scaled = self._drift.coordinates(X)
        if self._correlation.structures:
            scaled = self._correlation.structures[0].scaled(scaled)
        k = min(neighbours, len(self._points.x))
        rows = max(64, CHUNK // (k * (k + 1) // 2))
        for start in range(0, len(X), rows):
            part = slice(start, min(start + rows, len(X)))
            found = self._tree.query(scaled[part], np.arange(1, k + 1), workers=threads())
            yield part, np.asarray(found[1], dtype=np.int64), np.asarray(found[0])

    def _slope(self, X: FloatArray, near: IntArray, group: Group) -> FloatArray:
        """Return ∂f0 beta + ∂k0 K⁻¹ (e − F beta) of each target, (m, c, d)."""
        from truepose.similarity.covariance import slope_over_distance

        m, k = near.shape
        p = self._basis.shape[1]
        matrix: FloatArray = np.zeros((m, k, k))
        for s, u in zip(self._correlation.structures, self._scaled, strict=False):
            one = replace(self._correlation, structures=(s,))
            matrix += one.of_distances([np.linalg.norm(u[near][:, :, None] - u[near][:, None], axis=3)])
        matrix *= group.signal
        matrix[:, np.arange(k), np.arange(k)] = group.prior + group.noise[near]
        inverse: FloatArray = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        beta = self._coefficients(group, inverse, near)
        alpha = inverse @ (group.right[near][:, :, p:] - group.right[near][:, :, :p] @ beta)
        slope = np.einsum("mpd,mpc->mcd", self._drift.gradient(X), beta)
        columns = np.delete(np.arange(X.shape[1]), self._drift.columns)
        x = self._drift.coordinates(X)
        for s, u in zip(self._correlation.structures, self._scaled, strict=False):
            offset = s.scaled(x)[:, None] - u[near]
            rate = s.share * slope_over_distance(s.code, np.linalg.norm(offset, axis=2), s.shape)
            along = np.einsum("mk,mkc,mkd->mcd", rate, alpha, offset) @ s.axes.T
            slope[:, :, columns] += group.signal * along
        return np.asarray(slope)

    # --- leave-one-out ----------------------------------------------------------------------------------------------

    def _left_out(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Predict points from their nearest others, mean and variance (m, k)."""
        e, variance = np.empty((2, len(rows), len(self._total)))
        x = self._points.x[rows]
        for part, near, _ in self._parts(x, self.neighbours + 1):
            e[part], variance[part] = self._moments(x[part], near[:, 1:], np.zeros(len(near), bool))
        return e, variance

    def _leave_one_out(self) -> LeaveOneOut:
        prediction, field = self._left_out(np.arange(len(self._points.x)))
        inverse = self._points.inverse
        return LeaveOneOut(self._e - prediction[inverse], np.sqrt(field[inverse] + self._reading))

    def _fitted_parameters(self) -> dict[str, Any]:
        models = tuple(replace(model, fit=None) for model in self.variograms_)
        return {"variogram": models[0] if all(model == models[0] for model in models) else models}
