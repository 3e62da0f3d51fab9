"""Weighted least squares of a variogram model to the bins of one or several semivariograms.

N. Cressie, "Fitting variogram models by weighted least squares", Mathematical Geology 17 (1985): weights N(h)/γ(h)²
with the fitted γ, iterated until γ settles; or weights that do not depend on the fit (`WEIGHTS`). For given ranges,
rotations and shapes the nugget and the sills are linear and not negative (C. L. Lawson & R. J. Hanson, Solving Least
Squares Problems, 1974, ch. 23), so the search is over the others alone (variable projection: G. H. Golub & V. Pereyra,
SIAM Journal on Numerical Analysis 10, 1973).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares, minimize_scalar, nnls

from truepose._typing import FloatArray
from truepose.similarity.model import VariogramModel
from truepose.similarity.parametrisation import Parametrisation

WEIGHTS: Final = ("cressie", "pairs", "pairs/h2", "equal")
"""Weights of a bin with N pairs at lag h: N/γ_model(h)², N, N/h² (the default of gstat), 1 (the default of GSTools)."""
SHAPES: Final[dict[str, tuple[float, ...]]] = {
    "matern": (0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 4.0, 8.0),
    "stable": (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0),
    "rational": (0.25, 0.5, 1.0, 2.0, 4.0, 10.0),
    "power": (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 1.9),
}
"""Shapes that are tried for one isotropic structure when none is given."""
STARTS: Final = 48
"""Ranges that are tried for one isotropic structure."""
GRID: Final = 7
"""Practical ranges of the starts of several structures, from the shortest lag to twice the longest."""
BEST: Final = 4
"""Starts of several structures that are refined."""
ROUNDS: Final = 30
"""Iterations of the weights for several structures."""
ITERATIONS: Final = 100
"""Iterations of the weights for one isotropic structure."""
LONGEST: Final = 5.0
"""Longest practical range, in units of the largest lag: beyond it the sill is not identifiable."""
FLOOR: Final = 1e-6
NEGLIGIBLE: Final = 1e-9
"""Ratio of nugget and sill below which the smaller one counts as zero."""


class Fitted(NamedTuple):
    """A fitted model, whether its weights settled, and the parameters at a bound."""

    model: VariogramModel
    converged: bool
    bounds_hit: dict[str, str]


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of all variograms together.

    Attributes
    ----------
    h, gamma, pairs : (k,) arrays
        The lag, semivariance [mm²] and number of pairs.
    vectors : (k, d) or (k, 0) array
        The lag as a vector, where the variograms have directions.
    weighting : str
        The weights, of `WEIGHTS`.
    held : mapping of str to float
        The parameters that are not fitted.
    """

    h: FloatArray
    gamma: FloatArray
    pairs: FloatArray
    vectors: FloatArray
    weighting: str = "cressie"
    held: Mapping[str, float] = field(default_factory=dict)

    def correlation(self, part: VariogramModel) -> FloatArray:
        """Return ρ of one structure at each lag, (k,)."""
        if isinstance(part.range, tuple):
            return part.correlation(np.asarray(np.linalg.norm(part.coordinates(self.vectors), axis=1)))
        return part.correlation(self.h / part.range)

    def semivariance(self, model: VariogramModel) -> FloatArray:
        """Return γ of a model at each lag, (k,)."""
        total = np.full(len(self.h), model.nugget)
        for part in model.structures:
            total += part.sill * (1 - self.correlation(part))
        return total

    def derivatives(self, model: VariogramModel) -> dict[str, FloatArray]:
        """Return ∂γ/∂parameter at each lag, by name."""
        if not self.vectors.shape[1]:
            return model.derivatives(self.h)
        each = [model.derivatives(h, v) for h, v in zip(self.h[:, None], self.vectors, strict=True)]
        return {name: np.concatenate([one[name] for one in each]) for name in each[0]}

    @property
    def counts(self) -> FloatArray:
        """The part of the weights that does not depend on the fit, (k,)."""
        if self.weighting == "pairs/h2":
            return np.asarray(self.pairs * (self.h.mean() / self.h) ** 2)
        return np.ones_like(self.pairs) if self.weighting == "equal" else self.pairs

    def weights(self, fitted: FloatArray | None = None) -> FloatArray:
        """Return the square roots of the weights, given the fitted γ, or before a fit."""
        if fitted is None or self.weighting != "cressie":
            return np.asarray(np.sqrt(self.counts) / self.gamma.mean())
        return np.asarray(np.sqrt(self.counts) / np.maximum(fitted, FLOOR * self.gamma.max()))

    def objective(self, model: VariogramModel) -> float:
        """Return the weighted mean of (γ/γ_model − 1)²; with other weights than Cressie's of (γ − γ_model)²/mean²."""
        fitted = self.semivariance(model)
        return float(((self.weights(fitted) * (self.gamma - fitted)) ** 2).sum() / self.counts.sum())

    def practical_ranges(self) -> tuple[float, float]:
        """Return the bounds of practical ranges: half the shortest lag, and five times the longest."""
        return float(self.h.min()) / 2, LONGEST * float(self.h.max())


def fit_one(family: str, shape: float | None, bins: Bins) -> Fitted:
    """Fit one isotropic structure; of several shapes the best one is returned."""
    if family == "nugget":
        mean = float(bins.gamma @ bins.counts / bins.counts.sum())
        return Fitted(VariogramModel(family, nugget=bins.held.get("nugget", mean)), True, {})
    shapes = SHAPES.get(family, (None,)) if shape is None else (shape,)
    units = [VariogramModel(family, sill=1.0, shape=one) for one in shapes]
    model, converged = min((_fit_unit(unit, bins) for unit in units), key=lambda fit: bins.objective(fit[0]))
    return Fitted(model, converged, _bounds_hit(model, 1, [model.kind.practical_range(model.shape)], bins))


def fit_several(parameters: Parametrisation, bins: Bins) -> Fitted:
    """Fit several structures, or ranges along axes."""
    bounds = _bounds(parameters, bins)
    low, high = bounds
    weights = bins.weights()
    starts = [np.clip(start, low, high) for start in _starts(parameters, bins)]
    starts.sort(key=lambda start: float((_residual(start, parameters, bins, weights) ** 2).sum()))

    def settled(start: FloatArray) -> tuple[VariogramModel, bool]:
        theta = start
        if not len(theta):  # all ranges are held
            return _settle(lambda weights: _model(theta, parameters, bins, weights), bins, ROUNDS, 1e-6)

        def best(weights: FloatArray) -> VariogramModel:
            nonlocal theta
            theta = least_squares(
                _residual, theta, bounds=bounds, args=(parameters, bins, weights), x_scale=0.3, max_nfev=200
            ).x
            return _model(theta, parameters, bins, weights)

        return _settle(best, bins, ROUNDS, 1e-6)

    model, converged = min((settled(start) for start in starts[:BEST]), key=lambda fit: bins.objective(fit[0]))
    factors = [parameters.practical(family) for family in parameters.families]
    return Fitted(model, converged, _bounds_hit(model, len(parameters.families), factors, bins))


def standard_errors(fitted: Fitted, bins: Bins) -> dict[str, float]:
    """Return sqrt diag s² (JᵀWJ)⁻¹ over the free parameters, where s² is the weighted mean square of the residuals."""
    model, hit = fitted.model, fitted.bounds_hit
    columns = bins.derivatives(model)  # of the nugget alone where there is no sill
    fixed = set(hit) | set(bins.held) | ({"range"} if "sill" in hit or not model.kind.bounded else set())
    free = [name for name in columns if name not in fixed and not name.startswith("shape")]
    errors = dict.fromkeys(("nugget", "sill", "range"), math.nan) | dict.fromkeys(columns, math.nan)
    errors = {name: value for name, value in errors.items() if not name.startswith("shape")}
    if not free or len(bins.h) <= len(free):
        return errors
    gamma = bins.semivariance(model)
    scale = bins.weights(gamma)
    jacobian = scale[:, None] * np.column_stack([columns[name] for name in free])
    size = np.linalg.norm(jacobian, axis=0)
    if not size.all():  # a rotation has no effect on equal ranges
        return errors
    s2 = float(((scale * (bins.gamma - gamma)) ** 2).sum()) / (len(bins.h) - len(free))
    _, singular, right = np.linalg.svd(jacobian / size, full_matrices=False)
    if singular[-1] > 1e-10 * singular[0]:
        variance = s2 * ((right / singular[:, None]) ** 2).sum(axis=0) / size**2
        errors.update(zip(free, np.sqrt(variance).tolist(), strict=True))
    return errors


def _settle(
    best: Callable[[FloatArray], VariogramModel], bins: Bins, rounds: int, rtol: float
) -> tuple[VariogramModel, bool]:
    """Return the best model, with Cressie's weights iterated, and whether it settled."""
    weights, fitted = bins.weights(), np.zeros_like(bins.h)
    if bins.weighting != "cressie":
        return best(weights), True
    for _ in range(rounds):
        model = best(weights)
        previous, fitted = fitted, bins.semivariance(model)
        if np.allclose(fitted, previous, rtol=rtol, atol=0):
            return model, True
        weights = bins.weights(fitted)
    return model, False


def _bounds_hit(model: VariogramModel, structures: int, factors: list[float], bins: Bins) -> dict[str, str]:
    """Return the fitted parameters at a bound: nugget and sills of zero, ranges (given practical range over range)."""
    hit = _bounds_of_all(model, structures, factors, bins)
    return {name: bound for name, bound in hit.items() if name not in bins.held}


def _bounds_of_all(model: VariogramModel, structures: int, factors: list[float], bins: Bins) -> dict[str, str]:
    hit = {"nugget": "lower"} if model.nugget <= NEGLIGIBLE * model.partial_sill else {}
    if sum(part.sill > NEGLIGIBLE * model.nugget for part in model.structures) < structures:
        return hit | {"sill": "lower"}
    low, high = bins.practical_ranges()
    for k, (part, factor) in enumerate(zip(model.structures, factors, strict=True), 1):
        if not part.kind.bounded:
            continue
        several = isinstance(part.range, tuple)
        for axis, value in enumerate(np.ravel(part.range), 1):
            name = ("range" + f"_{axis}" * several) + ("" if k == 1 else f"_of_{k}")
            if not 1.001 * low < factor * value < 0.999 * high:
                hit[name] = "lower" if factor * value < (low * high) ** 0.5 else "upper"
    return hit


# --- one isotropic structure: a grid of ranges, and the best one refined ----------------------------------------------


def _fit_unit(unit: VariogramModel, bins: Bins) -> tuple[VariogramModel, bool]:
    if unit.kind.bounded:
        factor = unit.kind.practical_range(unit.shape)
        low, high = (bound / factor for bound in bins.practical_ranges())
        ranges = np.geomspace(low, high, STARTS) if high > low else np.array([low])
    else:  # only sill/range^α matters
        ranges = np.array([float(bins.h.max())])
    if "range" in bins.held:
        ranges = np.array([bins.held["range"]])
    return _settle(lambda weights: _best_range(unit, ranges, bins, weights**2), bins, ITERATIONS, 1e-8)


def _best_range(unit: VariogramModel, ranges: FloatArray, bins: Bins, weights: FloatArray) -> VariogramModel:
    _, _, loss = _linear_part(unit, ranges, bins, weights)
    i = int(np.argmin(loss))
    best = float(ranges[i])
    if len(ranges) > 1:
        interval = math.log(ranges[max(i - 1, 0)]), math.log(ranges[min(i + 1, len(ranges) - 1)])

        def loss_at(log_range: float) -> float:
            return float(_linear_part(unit, np.array([math.exp(log_range)]), bins, weights)[2][0])

        refined = minimize_scalar(loss_at, bounds=interval, method="bounded", options={"xatol": 1e-10})
        if refined.fun < loss[i]:
            best = math.exp(refined.x)
    nugget, sill, _ = _linear_part(unit, np.array([best]), bins, weights)
    return replace(unit, nugget=float(nugget[0]), sill=float(sill[0]), range=best)


def _linear_part(
    unit: VariogramModel, ranges: FloatArray, bins: Bins, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nugget and sill >= 0, and the weighted sum of squared residuals, for each range."""
    gamma = bins.gamma
    shape = 1 - unit.correlation(bins.h / ranges[:, None])
    if {"nugget", "sill"} & set(bins.held):
        return _linear_part_held(shape, bins, weights)
    w0, w1, w2 = weights.sum(), shape @ weights, shape**2 @ weights
    y0, y1 = gamma @ weights, shape @ (gamma * weights)
    determinant = w0 * w2 - w1**2
    regular = determinant > 1e-12 * w0 * w2
    safe = np.where(regular, determinant, 1.0)
    nugget, sill = (w2 * y0 - w1 * y1) / safe, (w0 * y1 - w1 * y0) / safe
    inside = regular & (nugget >= 0) & (sill >= 0)
    only_nugget = np.stack([np.full(len(ranges), y0 / w0), np.zeros(len(ranges))])
    only_sill = np.stack([np.zeros(len(ranges)), y1 / w2])
    options = np.stack([np.stack([nugget, sill]), only_nugget, only_sill])
    residual = gamma - options[:, 0, :, None] - options[:, 1, :, None] * shape
    loss = residual**2 @ weights
    loss[0, ~inside] = np.inf
    choice = np.argmin(loss, axis=0), np.arange(len(ranges))
    return options[choice[0], 0, choice[1]], options[choice[0], 1, choice[1]], loss[choice]


def _linear_part_held(shape: FloatArray, bins: Bins, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same with the nugget or the sill held, or both; shape is 1 − ρ, (ranges, k)."""
    held, gamma = bins.held, bins.gamma
    nugget, sill = np.full(len(shape), held.get("nugget", 0.0)), np.full(len(shape), held.get("sill", 0.0))
    if "nugget" not in held:
        nugget = np.maximum((gamma - sill[:, None] * shape) @ weights / weights.sum(), 0.0)
    if "sill" not in held:
        scale = np.maximum(shape**2 @ weights, np.finfo(float).tiny)
        sill = np.maximum(((gamma - nugget[:, None]) * shape) @ weights / scale, 0.0)
    return nugget, sill, (gamma - nugget[:, None] - sill[:, None] * shape) ** 2 @ weights


# --- several structures, or several ranges ----------------------------------------------------------------------------


def _residual(theta: FloatArray, parameters: Parametrisation, bins: Bins, weights: FloatArray) -> FloatArray:
    return weights * (bins.semivariance(_model(theta, parameters, bins, weights)) - bins.gamma)


def _model(theta: FloatArray, parameters: Parametrisation, bins: Bins, weights: FloatArray) -> VariogramModel:
    """Return the model of given ranges, rotations and shapes with the best nugget and sills."""
    full = np.array([_in_theta(name, bins.held) for name in parameters.names])
    full[_searched(parameters, bins)] = theta
    parts = parameters.parts(full)
    columns = np.column_stack([np.ones_like(bins.h), *(1 - bins.correlation(part) for part in parts)])
    nugget, first, *sills = _linear_parameters(columns, bins, weights)
    rest = tuple(replace(part, sill=sill) for part, sill in zip(parts[1:], sills, strict=True) if sill)
    return replace(parts[0], nugget=nugget, sill=first, plus=rest)


def _linear_parameters(columns: FloatArray, bins: Bins, weights: FloatArray) -> list[float]:
    """Return the nugget and the sills, those that are not held by least squares."""
    names = ["nugget", "sill", *(f"sill_of_{k}" for k in range(2, columns.shape[1]))]
    values = np.array([bins.held.get(name, 0.0) for name in names])
    free = np.array([name not in bins.held for name in names])
    left = bins.gamma - columns @ values
    values[free] = nnls(weights[:, None] * columns[:, free], weights * left)[0] if free.any() else []
    return list(values.tolist())


def _in_theta(name: str, held: Mapping[str, float]) -> float:
    """Return a held parameter as a number in θ; 0 for those that are searched for or linear."""
    if name not in held or name.startswith("sill"):
        return 0.0
    return held[name] if name.startswith("rotation") else math.log(held[name])


def _bounds(parameters: Parametrisation, bins: Bins) -> tuple[FloatArray, FloatArray]:
    low, high = (np.full(parameters.axes, value) for value in bins.practical_ranges())
    lower, upper = np.array(parameters.bounds(low, high))[_searched(parameters, bins)].T
    return lower, upper


def _starts(parameters: Parametrisation, bins: Bins) -> list[FloatArray]:
    """Return starts with increasing ranges, in every combination, and with turned axes."""
    searched = _searched(parameters, bins)
    starts = []
    for reaches in combinations(np.geomspace(bins.h.min(), 2 * bins.h.max(), GRID), len(parameters.families)):
        theta = parameters.start(np.ones(parameters.axes), spread=1.0)
        theta[[name.startswith("range") for name in parameters.names]] += np.repeat(np.log(reaches), parameters.axes)
        starts += [start[searched] for start in parameters.turned(theta)]
    return starts


def _searched(parameters: Parametrisation, bins: Bins) -> list[bool]:
    """Return which numbers of θ are searched for: the sills are in closed form, and some parameters may be held."""
    return [not name.startswith("sill") and name not in bins.held for name in parameters.names]
