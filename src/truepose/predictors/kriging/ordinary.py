"""Simple, ordinary and universal Kriging: the best linear unbiased prediction from all samples (7), (8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, lapack
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.base import LeaveOneOut
from truepose.predictors.kriging.base import Kriging, VariogramLike
from truepose.predictors.kriging.correlation import POINT, Support
from truepose.predictors.kriging.system import WORST, System, draw, symmetric
from truepose.similarity.model import VariogramModel
from truepose.similarity.trend import DriftLike

CHUNK: Final = 2**22
"""Covariances of targets and samples in memory at once: 32 MB."""


@dataclass(frozen=True, eq=False)
class _Group:
    """Components whose covariance matrices are proportional: one factorisation.

    Attributes
    ----------
    components : list of int
        The components of the group.
    signal, micro : float
        The shares of partial sill and exact nugget in the unit variance.
    noise : (u,) array
        The unit variance of the noise of each point's mean.
    system : System
        The factorised system.
    """

    components: list[int]
    signal: float
    micro: float
    noise: FloatArray
    system: System


class GlobalKriging(Kriging):
    """Base of Kriging from all samples: one factorisation, any drift, all components (equations (7) and (8))."""

    single_variance: bool

    # --- methods for users --------------------------------------------------------------------------------------------

    @property
    def condition_(self) -> float:
        """The condition number of the covariance matrix; the worst, if components have their own."""
        self._check_fitted()
        return max(group.system.condition for group in self._groups)

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by X, (m, k, d) or (m, d).

        A model with a cusp (spherical, exponential, linear) has no derivative at a sample; the contribution of that
        sample is zero there. The nugget of exact Kriging does not contribute either.
        """
        self._check_fitted()
        x = self._validate(X)[0]
        inner = self._sums.gradient(self._coordinates(x), self._weights)
        slope = np.zeros((len(x), inner.shape[1], x.shape[1]))
        slope[:, :, self._is_coordinate(x.shape[1])] = inner
        if self._drift is not None:
            slope += np.einsum("mpd,pk->mkd", self._drift.gradient(x), self.beta_)
        return slope[:, 0] if self._flat else slope

    def predict_block(
        self, X: ArrayLike, size: ArrayLike, return_std: bool = False, nodes: int | None = None
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Predict the mean of the error over boxes (block Kriging).

        The mean over a box is computed at Gauss–Legendre nodes; the mean covariance of two points of the box by
        Gauss–Legendre quadrature over their difference. With the default nodes the variance of a square estimated from
        its centre or from its corners, with a linear semivariogram, deviates by less than 1 % from the closed form
        (mean distances in a square: B. Ghosh, Bulletin of the Calcutta Mathematical Society 43, 1951). A nugget
        averages out over a volume, so the standard deviation does not contain it. Source: A. G. Journel & C. J.
        Huijbregts, Mining Geostatistics (1978), §V.A.

        Parameters
        ----------
        X : (m, d) array_like
            The centres of the boxes.
        size : float or (d,) array_like
            The lengths of the boxes' edges, in the unit of the coordinates.
        return_std : bool
            Whether the standard deviation is returned as well.
        nodes : int, optional
            The number of nodes along each edge; by default 6, or 4 with more than 4 coordinates.

        Returns
        -------
        e : (m, k) or (m,) array [mm]
            The predicted errors.
        std : (m, k) or (m,) array [mm]
            The standard deviations, only with `return_std`.

        Raises
        ------
        KrigingError
            If size or nodes are invalid, or the drift has columns of its own, which are not known inside the box.
        """
        self._check_fitted()
        x = self._validate(X)[0]
        if not self._is_coordinate(x.shape[1]).all():
            raise KrigingError("columns of X that are drift are not known inside a box; predict points instead")
        support = Support.box(size, x.shape[1], nodes, self._correlation)
        if not return_std:
            return self._shaped(self._mean(x, support))
        none = np.empty(0, np.int64)
        e, variance = self._moments(x, none, none, support)
        return self._shaped(e), self._shaped(np.sqrt(variance))

    def covariance(self, X: ArrayLike, include_nugget: bool = False) -> FloatArray:
        """Return the covariance of the prediction's errors between m targets, (k, m, m) or (m, m) [mm²].

        Its diagonal is the square of `predict`'s standard deviation.
        """
        self._check_fitted()
        covariance = self._covariance(self._validate(X)[0], include_nugget)
        return covariance[0] if self._flat else covariance

    def simulate(
        self, X: ArrayLike, size: int = 1, *, rng: np.random.Generator | int = 0, include_nugget: bool = False
    ) -> FloatArray:
        """Draw random fields given the samples (conditional simulation).

        They pass through the same samples as `predict`, and vary between them as the variogram states. They are drawn
        from the joint covariance of the targets, which takes 8 m² bytes and O(m³) time.

        Parameters
        ----------
        X : (m, d) array_like
            The targets.
        size : int
            The number of fields.
        rng : Generator or int
            The generator or seed of the draws.
        include_nugget : bool
            Whether the noise of one new reading is added at each target.

        Returns
        -------
        (size, m, k) or (size, m) array [mm]
            The drawn fields.
        """
        self._check_fitted()
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

    # --- fit ----------------------------------------------------------------------------------------------------------

    def _known_mean(self, k: int) -> FloatArray:
        return np.zeros(k)

    def _check_parameters(self, u: int, k: int) -> None:
        self._offset = self._known_mean(k)

    def _check_sill(self, model: VariogramModel) -> None:
        if self._drift is None and not model.bounded:
            raise KrigingError(f"simple Kriging needs a sill, and {model.family} has none; use OrdinaryKriging")

    def _solve(self, x: FloatArray, signal: FloatArray, micro: FloatArray) -> None:
        from truepose.numerics import kernels

        self._sums = self._correlation.at(x)
        groups, noise = self._alike(signal, micro)
        self._groups = [self._factorised(x, c, float(signal[c[0]]), float(micro[c[0]]), noise[:, c[0]]) for c in groups]
        u, k = self._mean_e.shape
        self._alpha = np.empty((u, k))
        self.beta_ = np.empty((self._groups[0].system.q.shape[1], k))
        for group in self._groups:
            c = slice(None) if len(self._groups) == 1 else group.components
            self.beta_[:, c], self._alpha[:, c] = group.system.solve(self._mean_e[:, c] - self._offset[c])
            signal[c] = group.signal
        self._weights = kernels.pack(signal * self._alpha)

    def _factorised(
        self, x: FloatArray, components: list[int], signal: float, micro: float, noise: FloatArray
    ) -> _Group:
        matrix = self._sums.cross(x)
        matrix *= signal
        matrix.reshape(-1)[:: len(x) + 1] = signal + micro + noise
        system = System.factorise(matrix, self._basis(self._points.x), self._points.x, micro + float(noise.min()))
        return _Group(components, signal, micro, noise, system)

    def _scale(self) -> FloatArray:
        scale = np.empty(len(self._total))
        for group in self._groups:
            c = group.components
            scale[c] = group.system.scale(self._mean_e[:, c] - self._offset[c]).diagonal()
        return np.asarray(scale / self._total)

    # --- prediction ---------------------------------------------------------------------------------------------------

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        targets, points = self._at_samples(X)
        variance = None
        if return_std:
            e, variance = self._moments(X, targets, points, POINT)
        else:
            e = self._mean(X, POINT)
        for group in self._groups if targets.size else ():
            c = np.array(group.components)
            if variance is None:
                e[np.ix_(targets, c)] += group.micro * self._alpha[np.ix_(points, c)]
            silent = group.noise[points] == 0  # a reading without noise is the error itself
            e[np.ix_(targets[silent], c)] = self._mean_e[np.ix_(points[silent], c)]
            if variance is not None:
                variance[np.ix_(targets[silent], c)] = 0.0
        return e, None if variance is None else np.sqrt(variance)

    def _mean(self, X: FloatArray, support: Support) -> FloatArray:
        e = self._sums.weighted
        x = self._coordinates(X)
        smooth = support.average(lambda shift: e(x + shift, self._weights))
        return self._offset + smooth + self._mean_basis(X, support) @ self.beta_

    def _mean_basis(self, X: FloatArray, support: Support) -> FloatArray:
        """Return the columns of the drift at m targets, (m, p), averaged over the support."""
        return support.average(lambda shift: self._basis(X + shift))

    def _moments(
        self, X: FloatArray, targets: IntArray, points: IntArray, support: Support
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the prediction at m targets, (m, k), in chunks of bounded memory."""
        e, variance = np.empty((2, len(X), len(self._total)))
        for part in self._chunks(len(X)):
            inside = (targets >= part.start) & (targets < part.stop)
            drift = self._mean_basis(X[part], support)
            for group in self._groups:
                c = slice(None) if len(self._groups) == 1 else group.components
                cross = self._cross(group, X[part], targets[inside] - part.start, points[inside], support)
                e[part, c] = self._offset[c] + cross @ self._alpha[:, c] + drift @ self.beta_[:, c]
                prior = group.signal * support.within + group.micro * (support is POINT)
                unit = group.system.single_variance if self.single_variance else group.system.variance
                variance[part, c] = unit(cross, drift, prior)[:, None] * self._total[c]
        return e, variance

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
        """Return the targets at samples, and the points of these samples; empty arrays where it makes no difference."""
        if not any(group.micro or (group.noise == 0).any() for group in self._groups):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        found = KDTree(self._points.x).query(X, distance_upper_bound=1e-150)
        targets = np.flatnonzero(np.asarray(found[0]) == 0)
        return targets, np.asarray(found[1])[targets]

    # --- the rest -----------------------------------------------------------------------------------------------------

    def _leave_one_out(self) -> LeaveOneOut:
        prediction, field = np.empty_like(self._mean_e), np.empty_like(self._mean_e)
        for group in self._groups:
            c = group.components
            left_out = group.system.left_out_variance()[:, None]
            prediction[:, c] = self._mean_e[:, c] - self._alpha[:, c] * left_out
            field[:, c] = np.maximum(left_out - group.noise[:, None], 0.0) * self._total[c]
        inverse = self._points.inverse
        return LeaveOneOut(self._e - prediction[inverse], np.sqrt(field[inverse] + self._reading))

    def _is_coordinate(self, d: int) -> BoolArray:
        return np.ones(d, bool) if self._drift is None else ~np.isin(np.arange(d), self._drift.columns)

    def _chunks(self, m: int) -> list[slice]:
        rows = max(1, CHUNK // len(self._points.x))
        return [slice(start, min(start + rows, m)) for start in range(0, m, rows)]


class OrdinaryKriging(GlobalKriging):
    """Ordinary Kriging of all components from one factorisation, theory (7).

    With ``exact=False`` the nugget of the variogram is noise of the readings: it is filtered, the prediction does not
    pass through the samples, and the standard deviation is that of the noise-free error; ``predict(…,
    include_nugget=True)`` adds the noise of a new reading. With ``exact=True`` the nugget is micro-scale variation of
    the error itself: the prediction passes through the samples, and the standard deviation contains the nugget except
    at the samples. The `noise_std` of `fit` is noise in both cases, in addition to the nugget.

    A given variogram determines the variance. A fitted one gives all components the same correlation (the intrinsic
    model, theory (9) with B diagonal); the mean square of `noise_std` is subtracted from its nugget, and the scale of
    each component follows from generalised least squares.

    Repeats of one point are averaged. If the variogram is fitted, or has no nugget and no `noise_std` is given, the
    noise is at least their scatter. With ``exact=True`` and no `noise_std` repeats must agree.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        The variogram of all components; or one for each, of one family and range; or the families to choose from in a
        fit of the components' mean semivariogram by `fit_variogram`. When not given, it is fitted by `fit_likelihood`,
        which predicts better where a smooth trend hides a small nugget.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    single_variance : bool
        Whether the product in the variance of predictions is computed in single precision, in little more than half of
        the time. Its rounding moves the variance by some 1e-7 of the sill times the root of `condition_`.

    Attributes
    ----------
    variogram_ : VariogramModel
        The mean over the components, as given or fitted.
    variograms_ : tuple of VariogramModel
        The variogram of each component.
    mean_ : (k,) array [mm]
        The GLS estimate of the mean.
    condition_ : float
        The condition number of the covariance matrix (the worst, if components have their own).

    Examples
    --------
    >>> model = OrdinaryKriging(VariogramModel("exponential", sill=1.0, range=100.0))
    >>> model.fit([[0.0], [100.0]], [1.0, 3.0]).predict([[0.0], [50.0]]).round(6)
    array([1., 2.])
    """

    def __init__(self, variogram: VariogramLike = None, exact: bool = False, single_variance: bool = False) -> None:
        self.variogram = variogram
        self.exact = exact
        self.single_variance = single_variance

    @property
    def mean_(self) -> FloatArray:
        """GLS estimate of the mean, (k,) [mm]."""
        mean: FloatArray = self.beta_[0]
        return mean

    def _drift_kind(self) -> DriftLike:
        return "constant"


class SimpleKriging(GlobalKriging):
    """Kriging with a known mean, theory (8) without a drift.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        The variogram, as for `OrdinaryKriging`; a model with a sill.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    mean : float or sequence of float [mm]
        The known mean, of all components or of each.
    single_variance : bool
        The parameter of `OrdinaryKriging`.

    Examples
    --------
    >>> model = SimpleKriging(VariogramModel("exponential", sill=1.0, range=100.0), mean=2.0)
    >>> model.fit([[0.0], [100.0]], [1.0, 3.0]).predict([[0.0], [1e6]]).round(6)
    array([1., 2.])
    """

    def __init__(
        self,
        variogram: VariogramLike = None,
        exact: bool = False,
        mean: float | Sequence[float] = 0.0,
        single_variance: bool = False,
    ) -> None:
        self.variogram = variogram
        self.exact = exact
        self.mean = mean
        self.single_variance = single_variance

    def _drift_kind(self) -> None:
        return None

    def _known_mean(self, k: int) -> FloatArray:
        mean = np.asarray(self.mean, dtype=np.float64)
        if mean.shape not in ((), (k,)) or not np.isfinite(mean).all():
            raise KrigingError(f"mean is {self.mean}; expected a finite number, or one for each of {k} components")
        return np.broadcast_to(mean, (k,))


class UniversalKriging(GlobalKriging):
    """Kriging with a drift, theory (8): its coefficients by generalised least squares, their uncertainty in the std.

    A fitted variogram is that of the residuals of the drift by ordinary least squares.

    Parameters
    ----------
    drift : {"constant", "linear", "quadratic", "cubic"}, int, sequence of int, or callable
        The polynomial of all coordinates by name or degree; the numbers of columns of X that are columns of the drift
        and not coordinates; or a function X (m, d) → (m, p). A constant is always added. A function cannot be saved.
    variogram, exact, single_variance
        The parameters of `OrdinaryKriging`.

    Attributes
    ----------
    beta_ : (p, k) array [mm]
        The GLS coefficients of the columns: the constant, then polynomials of (x − mean of the points)/half their
        extent, or columns of X scaled in this way, or the function's.
    variogram_, variograms_, condition_
        The attributes of `OrdinaryKriging`.

    Examples
    --------
    >>> model = UniversalKriging("linear", VariogramModel("exponential", sill=1.0, range=10.0))
    >>> model.fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0]).predict([[50.0]]).round(6)
    array([50.])
    """

    def __init__(
        self,
        drift: DriftLike = "linear",
        variogram: VariogramLike = None,
        exact: bool = False,
        single_variance: bool = False,
    ) -> None:
        self.drift = drift
        self.variogram = variogram
        self.exact = exact
        self.single_variance = single_variance

    def _drift_kind(self) -> DriftLike:
        return self.drift


def _inverse(precision: FloatArray, label: Any) -> FloatArray:
    """Return the inverse of P_II, which is singular where the others do not determine the drift."""
    try:
        factor = cho_factor(precision, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        factor = None
    if factor is None or factor[0].diagonal().min() ** 2 < WORST * precision.diagonal().max():
        raise KrigingError(
            f"without block {label} of {len(precision)} points the others do not determine the drift; use "
            "smaller blocks"
        )
    return symmetric(lapack.dpotri(factor[0], lower=1)[0])
