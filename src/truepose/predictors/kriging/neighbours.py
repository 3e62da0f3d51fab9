"""Kriging from the samples near each target (13): many small systems instead of a large one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.numerics.threads import threads
from truepose.predictors.base import LeaveOneOut
from truepose.predictors.kriging.base import Kriging, VariogramLike
from truepose.similarity.model import VariogramModel
from truepose.similarity.structure import slope_over_distance
from truepose.similarity.trend import DriftLike

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
        The components of the group.
    signal, micro : float
        The shares of partial sill and exact nugget in the unit variance.
    noise : (u,) array
        The unit variance of the noise of each point's mean.
    right : (u, p + c) array
        The columns of the drift, then the errors of these components.
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


class NeighbourKriging(Kriging):
    """Base of Kriging from the nearest samples; a subclass determines how the drift is found.

    Parameters
    ----------
    neighbours : int
        The number of nearest samples used for each target.
    variogram, exact
        The parameters of `OrdinaryKriging`; the variogram needs a sill.
    drift
        The drift, as for `UniversalKriging`.
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
        self._check_fitted()
        x = self._validate(X)[0]
        slope = np.empty((len(x), len(self._total), x.shape[1]))
        for part, near, _ in self._parts(x, self.neighbours):
            for group in self._groups:
                slope[part, group.components] = self._slope(x[part], near, group)
        return slope[:, 0] if self._flat else slope

    # --- methods of a subclass ----------------------------------------------------------------------------------------

    @abstractmethod
    def _group_scale(self, group: Group) -> FloatArray:
        """Return the variance of the group's components in units of the model's, (c,)."""

    @abstractmethod
    def _combine(self, group: Group, gram: FloatArray, f0: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (m, c) and unit variance (m,) from [k0, F, e]ᵀ K⁻¹ [k0, F, e] and the drift at the targets."""

    @abstractmethod
    def _coefficients(self, group: Group, inverse: FloatArray, near: IntArray) -> FloatArray:
        """Return beta of each target, (m, p, c), given K⁻¹ of its neighbours (m, k, k)."""

    def _prepare(self) -> None:
        """Prepare the common part of all targets, once the groups exist."""

    # --- fit ----------------------------------------------------------------------------------------------------------

    def _drift_kind(self) -> DriftLike:
        return self.drift

    def _check_parameters(self, u: int, k: int) -> None:
        count = self.neighbours
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise KrigingError(f"neighbours is {count!r}; expected a whole number of 1 or more")
        columns = self._basis(self._points.x[:1]).shape[1]
        if min(count, u) < columns:
            raise KrigingError(
                f"{min(count, u)} neighbours do not determine a drift of {columns} columns; use more neighbours or a "
                "simpler drift"
            )

    def _check_sill(self, model: VariogramModel) -> None:
        if not model.bounded:
            raise KrigingError(f"{type(self).__name__} needs a sill, and {model.family} has none; use OrdinaryKriging")

    def _solve(self, x: FloatArray, signal: FloatArray, micro: FloatArray) -> None:
        self._scaled = tuple(s.scaled(x) for s in self._correlation.structures) or (x,)
        self._tree = KDTree(self._scaled[0])
        self._columns = self._basis(self._points.x)
        groups, noise = self._alike(signal, micro)
        self._groups = [
            Group(
                np.array(c),
                float(signal[c[0]]),
                float(micro[c[0]]),
                noise[:, c[0]].copy(),
                np.ascontiguousarray(np.hstack([self._columns, self._mean_e[:, c]])),
            )
            for c in groups
        ]
        self._prepare()

    def _scale(self) -> FloatArray:
        scale = np.empty(len(self._total))
        for group in self._groups:
            scale[group.components] = self._group_scale(group)
        return scale

    # --- prediction ---------------------------------------------------------------------------------------------------

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e, variance = np.empty((2, len(X), len(self._total)))
        for part, near, distance in self._parts(X, self.neighbours):
            e[part], variance[part] = self._moments(X[part], near, distance[:, 0] == 0)
        if not return_std:
            return e, None
        return e, np.sqrt(variance)

    def _moments(self, X: FloatArray, near: IntArray, here: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance at targets, (m, k); `here` where the first neighbour is at the target."""
        e, variance = np.empty((2, len(X), len(self._total)))
        targets = [s.scaled(self._coordinates(X)) for s in self._correlation.structures]
        rho = self._rho(targets, near)
        f0 = self._basis(X)
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
        scaled = self._coordinates(X)
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
        m, k = near.shape
        p = self._columns.shape[1]
        matrix: FloatArray = np.zeros((m, k, k))
        for s, u in zip(self._correlation.structures, self._scaled, strict=False):
            one = replace(self._correlation, structures=(s,))
            matrix += one.of_distances([np.linalg.norm(u[near][:, :, None] - u[near][:, None], axis=3)])
        matrix *= group.signal
        matrix[:, np.arange(k), np.arange(k)] = group.prior + group.noise[near]
        inverse: FloatArray = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        beta = self._coefficients(group, inverse, near)
        alpha = inverse @ (group.right[near][:, :, p:] - group.right[near][:, :, :p] @ beta)
        assert self._drift is not None
        slope = np.einsum("mpd,mpc->mcd", self._drift.gradient(X), beta)
        columns = np.delete(np.arange(X.shape[1]), self._drift.columns)
        x = self._coordinates(X)
        for s, u in zip(self._correlation.structures, self._scaled, strict=False):
            offset = s.scaled(x)[:, None] - u[near]
            rate = s.share * slope_over_distance(s.code, np.linalg.norm(offset, axis=2), s.shape)
            along = np.einsum("mk,mkc,mkd->mcd", rate, alpha, offset) @ s.axes.T
            slope[:, :, columns] += group.signal * along
        return np.asarray(slope)

    # --- leave-one-out ------------------------------------------------------------------------------------------------

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


class LocalKriging(NeighbourKriging):
    """Ordinary or universal Kriging of each target from its nearest samples, theory (13).

    Distances are in units of the variogram's ranges. The prediction has small jumps where the neighbours change; the
    standard deviation is that of Kriging from these neighbours. The scale of each component of a fitted variogram is
    estimated from leave-one-out residuals.

    Parameters
    ----------
    neighbours : int
        The number of nearest samples used for each target.
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        The variogram, as for `OrdinaryKriging`; a model with a sill.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    drift : {"constant", "linear", "quadratic", "cubic"}, int, sequence of int, or callable
        The drift, as for `UniversalKriging`; each target has its own coefficients.

    Attributes
    ----------
    variogram_ : VariogramModel
        The mean over the components, as given or fitted.
    variograms_ : tuple of VariogramModel
        The variogram of each component.

    Examples
    --------
    >>> x = np.arange(100.0)[:, None]
    >>> model = LocalKriging(4, VariogramModel("matern52", sill=1.0, range=20.0)).fit(x, np.sin(x / 10))
    >>> model.predict([[25.5]]).round(3)
    array([[0.558]])
    """

    def _group_scale(self, group: Group) -> FloatArray:
        u = len(self._points.x)
        some = np.random.default_rng(0).choice(u, min(u, SCALING), replace=False)
        prediction, field = self._left_out(some)
        c = group.components
        variance = field[:, c] + self._mean_noise[np.ix_(some, c)]
        squares = (self._mean_e[np.ix_(some, c)] - prediction[:, c]) ** 2
        return np.asarray(np.mean(squares / np.maximum(variance, np.finfo(float).tiny), axis=0))

    def _combine(self, group: Group, gram: FloatArray, f0: FloatArray) -> tuple[FloatArray, FloatArray]:
        p = f0.shape[1]
        information, unexplained = gram[:, 1 : 1 + p, 1 : 1 + p], f0 - gram[:, 0, 1 : 1 + p]
        try:
            lagrange = np.linalg.solve(information, unexplained[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            raise KrigingError(
                f"near some target {self.neighbours} neighbours do not determine the {p} columns of the drift; use "
                "more neighbours or a simpler drift"
            ) from None
        mean = gram[:, 0, 1 + p :] + np.einsum("mp,mpc->mc", lagrange, gram[:, 1 : 1 + p, 1 + p :])
        return mean, group.prior - gram[:, 0, 0] + np.einsum("mp,mp->m", unexplained, lagrange)

    def _coefficients(self, group: Group, inverse: FloatArray, near: IntArray) -> FloatArray:
        p = self._columns.shape[1]
        right = group.right[near]
        explained = right[:, :, :p].transpose(0, 2, 1) @ inverse
        return np.asarray(np.linalg.solve(explained @ right[:, :, :p], explained @ right[:, :, p:]))
