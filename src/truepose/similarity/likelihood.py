"""Fit of a variogram model to the samples themselves: maximum likelihood, restricted likelihood, leave-one-out.

The components share one correlation and have scales of their own (theory (9) with B diagonal), or one scale; the
criteria have them in closed form. So the search is over ranges, shape and nugget ratio alone, with analytic gradients.
Unlike the bins of a variogram, the likelihood distinguishes a small nugget from none under a smooth trend, and a
prediction's standard deviation depends on it.

For e = F β + Z + ε, Cov(Z + ε) = s K, K = ρ + t I (t = C0/C), the scale s is in closed form, and each criterion's
derivative by K is a symmetric matrix Q/2, so that the derivative by a parameter is ½ Σ Q_ij ∂K_ij. With
P = K⁻¹ − K⁻¹F(FᵀK⁻¹F)⁻¹FᵀK⁻¹ and w = P e, per component:

==== =============================================================== ==================================================
reml log|K| + log|FᵀK⁻¹F| + (n − p) log s, s = eᵀP e/(n − p)         P − w wᵀ/s
ml   log|K| + n log s, s = eᵀP e/n                                   K⁻¹ − w wᵀ/s
loo  −Σ log P_ii + n log s, s = Σ w_i²/P_ii / n                      P D P − (P v wᵀ + w vᵀP)/s, v = w/P_ii,
                                                                     D = 1/P_ii + w²/(s P_ii²)
==== =============================================================== ==================================================

(twice the negative logarithm each, without constants). Source: K. V. Mardia & R. J. Marshall, Biometrika 71 (1984);
P. K. Kitanidis, Water Resources Research 19 (1983); leave-one-out: S. Sundararajan & S. S. Keerthi, Neural Computation
13 (2001), with O. Dubrule's form for an unknown mean (Mathematical Geology 15, 1983).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import blas, lapack, solve_triangular
from scipy.optimize import minimize

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, KrigingError
from truepose.numerics.threads import blas_threads, kernel_threads
from truepose.similarity.experimental import check_points
from truepose.similarity.model import FitRecord, VariogramModel, warn_of_remarks
from truepose.similarity.parametrisation import Parametrisation
from truepose.similarity.structure import correlation_by_shape, cross_correlation, slope_moments
from truepose.similarity.trend import polynomial

ROUGH_TO_SMOOTH: Final = ("exponential", "matern32", "matern52")
"""Families tried by default: valid in any number of coordinates, and better conditioned than the gaussian."""

METHODS: Final = ("reml", "ml", "loo")
LEAST: Final = 5
STARTS: Final = ((0.5, 0.1), (4.0, 1e-3))
"""Practical range in units of the points' extent, and nugget ratio C0/C."""
RANGES: Final = (1e-3, 60.0)
RATIOS: Final = (1e-8, 1e4)
LARGE: Final = 3000
"""Samples from which threads gain more than they cost by waiting for each other."""
PART: Final = 250
"""Of twice as many samples a part of this size chooses between the starts; all samples refine the best."""
STEP: Final = 1e-4
"""Of the differences of gradients that give the standard errors, in logarithms of the parameters."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LikelihoodFit(FitRecord):
    """The record of a fit by likelihood.

    The criterion in `candidates` is the log-likelihood; the largest wins. All families have equally many parameters,
    except those with a shape. Standard errors are from the curvature of the criterion at its optimum; NaN for a
    parameter at a bound, and for ``loo``.

    Attributes
    ----------
    log_likelihood : float
        The logarithm of the criterion named by `method`, with its full constant. ``reml`` is the density of the n − p
        error contrasts Aᵀe with orthonormal A, AᵀF = 0 (Harville 1974): it has the terms −½(n − p) log 2π and
        +½ log|FᵀF|, and depends on the space that the drift spans, not on the scale of its columns. Software that
        omits one of these terms differs by it. ``ml`` is the density of e, ``loo`` the product of n densities.
    samples : int
        The number of samples used.
    method : str
        ``reml``, ``ml``, or ``loo`` (the product of the leave-one-out densities).
    scales : (c,) array [mm²]
        The partial sill of each component.
    optima : dict of str to tuple of float
        Where the search of each family ended, for the `start` of another fit.
    """

    log_likelihood: float
    samples: int
    method: str = "reml"
    scales: FloatArray = field(default_factory=lambda: np.empty(0))
    optima: dict[str, tuple[float, ...]] = field(default_factory=dict)


def fit_likelihood(
    x: ArrayLike,
    e: ArrayLike,
    family: str | Sequence[str] = ROUGH_TO_SMOOTH,
    *,
    method: str = "reml",
    ranges: str = "one",
    shape: float | None = None,
    drift: str | ArrayLike = "constant",
    common_scale: bool = False,
    largest: int | None = 300,
    start: LikelihoodFit | None = None,
) -> VariogramModel:
    """Fit a variogram model to samples by maximum likelihood.

    Parameters
    ----------
    x : (n, d) array_like
        Positions [mm] or joints [rad].
    e : (n, c) or (n,) array_like [mm]
        The errors at x.
    family : str or sequence of str
        The families with a sill; the most likely one wins. "spherical+exponential" has two structures, of which the
        first starts as the shorter one.
    method : {"reml", "ml", "loo"}
        The criterion: restricted likelihood, which does not favour short ranges as likelihood does; likelihood; or the
        product of the leave-one-out densities, which is the least sensitive to a wrong family.
    ranges : {"one", "each", "rotated"}
        The ranges: one; one for each coordinate; or one for each axis of a rotation that is fitted too, of 2 or 3
        coordinates.
    shape : float, optional
        The shape of a family that has one; fitted when not given.
    drift : {"none", "constant", "linear", "quadratic"} or (n, p) array_like
        The drift of the mean, by name or as columns.
    common_scale : bool
        Whether all components share one scale.
    largest : int, optional
        The largest number of samples used: of more, a random part with a fixed seed; all when None.
    start : LikelihoodFit, optional
        The record of a fit of similar samples with the same options: searches start at its optima only, which takes a
        third of the evaluations.

    Returns
    -------
    VariogramModel
        The model of the mean over the components, with its `fit` record.

    Warns
    -----
    VariogramWarning
        Once, with all `LikelihoodFit.remarks`: a parameter at its bound, or no sill within the samples.

    Raises
    ------
    KrigingError
        With fewer than 5 samples, errors that do not vary, or points that are all the same.

    Examples
    --------
    >>> x = np.linspace(0, 1000, 60)[:, None]
    >>> fit_likelihood(x, np.sin(x / 100)).family
    'matern52'
    """
    points, errors = check_points(x, e)
    names = [family] if isinstance(family, str) else list(family)
    parameters = _parametrisations(names, method, ranges, shape, points)
    components = errors.shape[1]
    errors = errors[:, np.ptp(errors, axis=0) > 0]
    if errors.shape[1] == 0:
        raise KrigingError("the errors do not vary, so no variogram can be fitted; check the column of e")
    columns = _drift(points, drift)
    if largest is not None and len(points) > largest:
        points, errors, columns = _part(largest, points, errors, columns)
    with blas_threads(len(points), LARGE), kernel_threads(len(points), LARGE):
        problems = {name: _Problem(parameters[name], method, common_scale, points, errors, columns) for name in names}
        known = {} if start is None else start.optima
        found = {name: _optimum(problem, known.get(name)) for name, problem in problems.items()}
        best = min(found, key=lambda name: found[name][0])
        optimum = found[best][1]
        judged = problems[best].judged(optimum)
        model = problems[best].model(optimum, judged, components)
        hit, errors_of = problems[best].uncertainty(optimum, judged, model)
    record = LikelihoodFit(
        log_likelihood=problems[best].log_likelihood(found[best][0]),
        bounds_hit=hit,
        samples=len(points),
        candidates={name: problems[name].log_likelihood(value) for name, (value, _) in found.items()},
        method=method,
        standard_error=errors_of,
        scales=judged.scale,
        optima={name: tuple(theta.tolist()) for name, (_, theta) in found.items()},
        fitted=model.to_dict(),
        practical_range=model.practical_range,
        longest=float(np.linalg.norm(np.ptp(points, axis=0))),
    )
    warn_of_remarks(model.family, record)
    return replace(model, fit=record)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The criterion as a function of θ: the parameters of all structures, then log C0/C of the first."""

    parameters: Parametrisation
    method: str
    common: bool
    points: FloatArray
    e: FloatArray
    drift: FloatArray

    @property
    def units(self) -> FloatArray:
        """Extent of the points: of all together, of each coordinate, or of all for each turned axis."""
        extent = np.ptp(self.points, axis=0)
        if self.parameters.ranges == "each":
            return np.asarray(extent)
        return np.full(self.parameters.axes, float(np.linalg.norm(extent)))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        own = self.parameters.bounds(RANGES[0] * self.units, RANGES[1] * self.units)
        return [*own, (math.log(RATIOS[0]), math.log(RATIOS[1]))]

    def start(self, reach: float, ratio: float) -> FloatArray:
        wide = math.sqrt(self.parameters.axes)  # with a range for each coordinate their distances add up
        return np.append(self.parameters.start(wide * reach * self.units), math.log(ratio))

    def loss(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Return the criterion and its gradient."""
        judged = self._judged(theta)
        if judged is None:  # singular in 64 bits
            return 1e300, np.zeros_like(theta)
        return judged.loss, self.gradient(theta, judged)

    def gradient(self, theta: FloatArray, judged: Judged) -> FloatArray:
        """Return the derivative of the criterion by θ."""
        from truepose.numerics.kernels import DISTANCE

        gradient: list[float] = []
        half_trace = float(np.trace(judged.Q)) / 2
        for k, part in enumerate(self.parameters.parts(theta[:-1])):
            code, shape, u = part.kind.code, part.shape or 0.0, part.coordinates(self.points)
            moments = slope_moments(code, u, judged.Q, shape, full=part.rotation is not None)
            own = part.by_logarithms(moments).tolist()
            if part.shape is not None and self.parameters.shape is None:
                by_shape = correlation_by_shape(part.family, _correlations(DISTANCE, u, 0.0), shape)
                own.append(shape * float((np.triu(judged.Q, 1) * by_shape).sum()))
            if k:
                own.append(float((np.triu(judged.Q, 1) * _correlations(code, u, shape)).sum()) + half_trace)
            gradient += (part.sill * np.array(own)).tolist()
        return np.array([*gradient, math.exp(theta[-1]) * half_trace])

    def judged(self, theta: FloatArray) -> Judged:
        judged = self._judged(theta)
        if judged is None:
            raise KrigingError(
                f"no {'+'.join(self.parameters.families)} variogram has a regular covariance matrix here; use a "
                "rougher family (matern52), or drop near points"
            )
        return judged

    def _judged(self, theta: FloatArray) -> Judged | None:
        parts, n = self.parameters.parts(theta[:-1]), len(self.points)
        K: FloatArray | None = None
        for part in parts:
            rho = _correlations(part.kind.code, part.coordinates(self.points), part.shape or 0.0)
            K = rho if K is None else np.add(K, part.sill * rho, out=K)
        assert K is not None
        K.flat[:: n + 1] = sum(part.sill for part in parts) + math.exp(theta[-1])
        return judge(self.method, K, self.drift, self.e, self.common)

    def curvature(self, theta: FloatArray, judged: Judged, free: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the second derivative of the criterion by the free parameters, and the first of log Σ s."""
        H, slope, gradient = np.empty((len(free), len(free))), np.empty(len(free)), self.gradient(theta, judged)
        for row, k in enumerate(free):
            moved = theta + STEP * np.eye(len(theta))[k]
            there = self.judged(moved)
            H[row] = (self.gradient(moved, there) - gradient)[free] / STEP
            slope[row] = math.log(there.scale.sum() / judged.scale.sum()) / STEP
        return (H + H.T) / 2, slope

    def log_likelihood(self, loss: float) -> float:
        n, c = self.e.shape
        freedom = n - self.drift.shape[1] if self.method == "reml" else n
        constant = -freedom * (1 + math.log(2 * math.pi)) / 2
        if self.method == "reml":
            constant += float(np.linalg.slogdet(self.drift.T @ self.drift)[1]) / 2
        return float(c * constant - loss)

    def model(self, theta: FloatArray, judged: Judged, components: int) -> VariogramModel:
        """Return the model of the mean over all components, those that do not vary included."""
        sill = float(judged.scale.sum()) / components
        return self.parameters.model(theta[:-1], math.exp(theta[-1]) * sill, sill)

    def uncertainty(
        self, theta: FloatArray, judged: Judged, model: VariogramModel
    ) -> tuple[dict[str, str], dict[str, float]]:
        """Return the bounds hit, and standard errors from the curvature of the criterion, by name."""
        names = [*self.parameters.names, "nugget"]
        at = np.array(self.bounds)
        low, high = theta <= at[:, 0] + 1e-3, theta >= at[:, 1] - 1e-3
        hit = {name: "lower" if low[k] else "upper" for k, name in enumerate(names) if low[k] or high[k]}
        errors = dict.fromkeys([*names, "sill"], math.nan)
        if hit.get("nugget") == "upper":
            return {"sill": "lower"}, errors
        free = np.flatnonzero(~(low | high))
        if self.method == "loo":
            return hit, errors
        H, slope = self.curvature(theta, judged, free)
        if not free.size or np.linalg.eigvalsh(H)[0] <= 0:
            return hit, errors
        covariance, scale = np.linalg.inv(H), judged.scale
        own = 2 / (len(self.e) - self.drift.shape[1]) * float((scale**2).sum() / scale.sum() ** 2)
        if self.common:
            own = 2 / ((len(self.e) - self.drift.shape[1]) * len(scale))
        for row, k in enumerate(free):
            name, value = names[k], math.exp(theta[k])
            if name.startswith(("nugget", "sill")):  # a ratio to the first sill
                with_ratio = slope + np.eye(len(free))[row]
                errors[name] = value * model.sill * math.sqrt(own + with_ratio @ covariance @ with_ratio)
            else:
                unit = 1.0 if name.startswith("rotation") else value
                errors[name] = unit * math.sqrt(covariance[row, row])
        errors["sill"] = model.sill * math.sqrt(own + slope @ covariance @ slope)
        return hit, errors


def _optimum(problem: _Problem, known: tuple[float, ...] | None) -> tuple[float, FloatArray]:
    """Return the least loss, and where; the search starts at a known optimum of similar samples, or everywhere.

    Many samples begin where a part of them ended.
    """
    n, bounds = len(problem.points), np.array(problem.bounds)
    if known is not None and len(known) == len(bounds):
        begin = np.clip(known, *bounds.T)
        with suppress(KrigingError):  # singular there
            return _descend(problem, begin, _unit(problem, begin))
    starts = [
        np.append(turned, log_ratio)
        for *theta, log_ratio in (problem.start(*start) for start in STARTS)
        for turned in problem.parameters.turned(np.array(theta))
    ]
    if n < 2 * PART:
        return min((_descend(problem, start) for start in starts), key=lambda result: result[0])
    points, e, drift = _part(PART, problem.points, problem.e, problem.drift)
    part = replace(problem, points=points, e=e, drift=drift)
    begin = min((_descend(part, start) for start in starts), key=lambda result: result[0])[1]
    return _descend(problem, begin, _unit(part, begin, n / PART))


def _unit(problem: _Problem, theta: FloatArray, samples: float = 1.0) -> FloatArray:
    """Return steps of each parameter that change the criterion of `samples` times as many samples alike."""
    H, _ = problem.curvature(theta, problem.judged(theta), np.arange(len(theta)))
    return np.asarray(1 / np.sqrt(np.maximum(samples * H.diagonal(), 1.0)))


def _descend(problem: _Problem, start: FloatArray, unit: float | FloatArray = 1.0) -> tuple[float, FloatArray]:
    """Return the least loss from a start, and where; the search steps are in a unit of each parameter."""
    low, high = np.array(problem.bounds).T

    def loss(z: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = problem.loss(z * unit)
        return value, gradient * unit

    bounds = list(zip(low / unit, high / unit, strict=True))
    found = minimize(loss, np.clip(start, low, high) / unit, jac=True, method="L-BFGS-B", bounds=bounds)
    return float(found.fun), np.asarray(found.x * unit)


def _part(size: int, *arrays: FloatArray) -> tuple[FloatArray, ...]:
    rows = np.random.default_rng(0).choice(len(arrays[0]), size, replace=False)
    return tuple(array[rows] for array in arrays)


def _correlations(code: int, u: FloatArray, shape: float) -> FloatArray:
    from truepose.numerics.kernels import pack

    return cross_correlation(code, u, pack(u), len(u), shape)


def _drift(points: FloatArray, drift: str | ArrayLike) -> FloatArray:
    if isinstance(drift, str):
        return np.empty((len(points), 0)) if drift == "none" else polynomial(points, drift)
    columns = np.asarray(drift, dtype=np.float64)
    if columns.ndim != 2 or len(columns) != len(points) or not np.isfinite(columns).all():
        raise DataError(f"drift has shape {columns.shape}; expected ({len(points)}, p) finite numbers")
    return columns


def _parametrisations(
    names: list[str], method: str, ranges: str, shape: float | None, points: FloatArray
) -> dict[str, Parametrisation]:
    found = {name: Parametrisation.of(name, ranges, points.shape[1], shape) for name in names}
    if not names:
        raise KrigingError("expected at least one variogram family, got none")
    if method not in METHODS:
        raise DataError(f"method is {method!r}; expected one of {', '.join(METHODS)}")
    if len(points) < LEAST:
        raise KrigingError(
            f"{len(points)} samples are too few to fit a variogram; measure at least {LEAST}, or give a variogram"
        )
    extent = np.ptp(points, axis=0)
    if not extent.any():
        raise KrigingError(f"all {len(points)} points are the same; a variogram needs points that are apart")
    if ranges != "one" and not extent.all():
        raise KrigingError(
            f"coordinate {int(np.argmin(extent))} of x is the same for all points; leave it out, or use ranges='one'"
        )
    return found


# --- criteria ---------------------------------------------------------------------------------------------------------


class Judged(NamedTuple):
    """A criterion at one covariance matrix.

    Attributes
    ----------
    loss : float
        Half of the table's sums, over all components.
    Q : (n, n) array
        The derivative of 2 loss by K; its upper triangle alone is filled.
    scale : (c,) array [mm²]
        The scale s of each component.
    """

    loss: float
    Q: FloatArray
    scale: FloatArray


def judge(method: str, K: FloatArray, drift: FloatArray, e: FloatArray, common: bool) -> Judged | None:
    """Return a criterion at K (n, n), C order, overwritten; nothing where K is singular in 64 bits.

    Parameters
    ----------
    method : {"reml", "ml", "loo"}
        The criterion.
    K : (n, n) array
        The covariance matrix, overwritten.
    drift : (n, p) array
        The columns F of the drift; p may be 0.
    e : (n, c) array [mm]
        The errors.
    common : bool
        Whether the components share one scale.
    """
    n, c = e.shape
    p = drift.shape[1]
    factor, failed = lapack.dpotrf(K.T, lower=1, clean=0, overwrite_a=1)
    if failed:
        return None
    half_determinant = float(np.log(factor.diagonal()).sum())
    solved = lapack.dpotrs(factor, np.asfortranarray(np.hstack([drift, e])), lower=1)[0]
    KF, w = solved[:, :p], solved[:, p:]
    M = drift.T @ KF
    root = np.linalg.cholesky((M + M.T) / 2)
    Z = solve_triangular(root, KF.T, lower=True).T if p else KF  # P = K⁻¹ − Z Zᵀ
    w = w - Z @ (Z.T @ e)
    inverse = lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
    if method == "loo":
        return _leave_one_out(inverse, Z, w, common)
    freedom = n - p if method == "reml" else n
    scale = _shared(np.einsum("nc,nc->c", e, w) / freedom, common)
    loss = c * half_determinant + freedom * float(np.log(scale).sum()) / 2
    if method == "reml":
        loss += c * float(np.log(root.diagonal()).sum())
    taken = np.hstack([math.sqrt(c) * Z, w / np.sqrt(scale)]) if method == "reml" else w / np.sqrt(scale)
    Q = blas.dsyrk(-1.0, np.asfortranarray(taken), beta=float(c), c=inverse, lower=1, overwrite_c=1)
    return Judged(loss, Q.T, scale)


def _leave_one_out(inverse: FloatArray, Z: FloatArray, w: FloatArray, common: bool) -> Judged:
    n, c = w.shape
    lower = np.tril(inverse)
    P = lower + np.tril(lower, -1).T - Z @ Z.T
    diagonal = P.diagonal()
    v = w / diagonal[:, None]
    scale = _shared((w * v).mean(axis=0), common)
    loss = (n * float(np.log(scale).sum()) - c * float(np.log(diagonal).sum())) / 2
    Pv = P @ (v / scale)
    D = c / diagonal + (v**2 / scale).sum(axis=1)
    cross = Pv @ w.T
    return Judged(loss, np.ascontiguousarray((P * D) @ P - cross - cross.T), scale)


def _shared(scale: FloatArray, common: bool) -> FloatArray:
    return np.full_like(scale, scale.mean()) if common else scale
