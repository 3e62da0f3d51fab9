"""Fit of a variogram model by weighted least squares.

N. Cressie, "Fitting variogram models by weighted least squares", Mathematical Geology 17 (1985): weights N(h)/γ(h)²
with the fitted γ, iterated until it moves no more. Nugget and sill enter linearly, so that they are solved in closed
form for each range, and the search is over the range alone: a grid of starts over its whole interval, then the best one
refined.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize_scalar

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.experimental import ExperimentalVariogram
from truepose.similarity.model import FAMILIES, VariogramModel
from truepose.similarity.nested_fit import Bins, at_bounds, fit_structures
from truepose.similarity.remarks import remarks_on, sill_is_beyond, warn_of
from truepose.similarity.structures import Structures

USUAL: Final = ("spherical", "exponential", "gaussian", "matern32", "matern52")
"""Families that "best" tries: monotonic, with nugget, sill and range."""
SHAPES: Final[dict[str, tuple[float, ...]]] = {
    "matern": (0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 4.0, 8.0),
    "stable": (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0),
    "rational": (0.25, 0.5, 1.0, 2.0, 4.0, 10.0),
    "power": (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 1.9),
}
"""Shapes that are tried where none is given."""
PARAMETERS: Final = {"nugget": 1, "linear": 2, "power": 2}
STARTS: Final = 48
ITERATIONS: Final = 100
LONGEST: Final = 5.0
"""Longest practical range looked for, in units of the largest lag: beyond it no sill can be told."""


@dataclass(frozen=True, eq=False)
class VariogramFit:
    """How a model was fitted.

    Attributes
    ----------
    objective : float
        Σ N (γ/γ_model − 1)² / Σ N, the mean squared relative deviation: the criterion by which families are compared.
    standard_error : dict of str to float
        Of nugget [mm²], sill [mm²] and range, from the weighted Jacobian, at the shape that was chosen. NaN for a
        parameter held at a bound, and for all where there are no more bins than parameters. Bins share points, so these
        are lower than the truth.
    bounds_hit : dict of str to {"lower", "upper"}
        Parameters that ended at a bound.
    bins : int
        Bins used.
    converged : bool
        Whether the weights settled.
    candidates : dict of str to float
        The objective of every family tried.
    fitted : dict
        The model that was found, as `VariogramModel.to_dict` gives it: it stays when a value is replaced by hand.
    practical_range, longest : float
        Of that model, and the largest lag of the bins.
    """

    objective: float
    standard_error: dict[str, float]
    bounds_hit: dict[str, str]
    bins: int
    converged: bool
    candidates: dict[str, float]
    fitted: dict[str, Any] = field(default_factory=dict)
    practical_range: float = math.nan
    longest: float = math.nan

    @property
    def no_sill(self) -> bool:
        """Whether the model has its sill beyond the largest lag only: sill and range are extrapolated."""
        return sill_is_beyond(self.bounds_hit, self.practical_range, self.longest)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What bounds and range mean, in words."""
        settled = () if self.converged else (f"the weights did not settle in {ITERATIONS} iterations",)
        return remarks_on(self.bounds_hit, self.practical_range, self.longest) + settled


def fit_variogram(
    ev: ExperimentalVariogram | Sequence[ExperimentalVariogram],
    family: str | Sequence[str] = "spherical",
    *,
    component: int | None = None,
    shape: float | None = None,
    ranges: str = "one",
) -> VariogramModel:
    """Return the model that fits an experimental variogram best.

    Parameters
    ----------
    ev : ExperimentalVariogram or sequence of ExperimentalVariogram
        One; or several along different directions, which ranges along axes need.
    family : str or sequence of str
        A name of `VariogramModel`; several names, or "best" for the usual ones with a sill that are valid in the
        points' dimension, all with three parameters: the smallest `VariogramFit.objective` wins. A name such as
        "spherical+exponential" has several structures, the shorter range first in the starts.
    component : int, optional
        Column of the errors; the vector (sum over the components) when not given.
    shape : float, optional
        Of a family that has one; the best of `SHAPES` when not given.
    ranges : {"one", "each", "rotated"}
        One range for each structure; one for each coordinate; or one for each axis of a rotation that is found as well,
        of 2 or 3 coordinates.

    Returns
    -------
    VariogramModel
        With its `fit` record.

    Warns
    -----
    VariogramWarning
        Once, of all `VariogramFit.remarks`: a parameter at its bound, or no sill within the samples.

    Raises
    ------
    KrigingError
        If fewer bins than parameters hold pairs, if the errors do not vary, or if the family is not known.

    Examples
    --------
    >>> from truepose.similarity import experimental_variogram
    >>> x = np.linspace(0, 1000, 200)[:, None]
    >>> vm = fit_variogram(experimental_variogram(x, np.sin(x / 50)), "gaussian")
    >>> vm.structural_ratio > 0.99
    True
    """
    evs = [ev] if isinstance(ev, ExperimentalVariogram) else list(ev)
    names = _families(family, evs)
    bins = _bins(evs, component, ranges)
    parameters = min(_parameters(name, ranges, evs[0].dimensions) for name in names)
    if len(bins.h) < parameters:
        raise KrigingError(
            f"{len(bins.h)} bins hold pairs, but a variogram model has {parameters} parameters; "
            "use more bins or a larger max_lag, or measure more points"
        )
    if not bins.gamma.max() > 0:
        raise KrigingError("the errors do not vary within the lags; use a larger max_lag, or check the column of e")
    fits = {name: _fit(name, shape, ranges, bins, evs[0].dimensions) for name in names}
    candidates = {name: _objective(model, bins) for name, (model, _, _) in fits.items()}
    best = min(candidates, key=candidates.__getitem__)
    model, converged, hit = fits[best]
    record = VariogramFit(
        objective=candidates[best],
        standard_error=_standard_errors(model, hit, bins),
        bounds_hit=hit,
        bins=len(bins.h),
        converged=converged,
        candidates=candidates,
        fitted=model.to_dict(),
        practical_range=model.practical_range,
        longest=float(bins.h.max()),
    )
    return warn_of(replace(model, fit=record))


def _bins(evs: Sequence[ExperimentalVariogram], component: int | None, ranges: str) -> Bins:
    """Return the bins that hold pairs, of all variograms."""
    if not evs:
        raise DataError("no semivariogram came; give one, or several along different directions")
    if ranges != "one" and any(not one.axis.size for one in evs):
        raise DataError(
            f"ranges={ranges!r} needs semivariograms along directions; give experimental_variogram(…, direction=…) of "
            "several"
        )
    used = [(one.pairs > 0) & (one.lag > 0) for one in evs]
    along = [
        one.lag[u, None] * (one.axis if ranges != "one" else np.empty(0)) for one, u in zip(evs, used, strict=True)
    ]
    gammas = [one.vector if component is None else _column(one, component) for one in evs]
    return Bins(
        h=np.concatenate([one.lag[u] for one, u in zip(evs, used, strict=True)]),
        gamma=np.concatenate([gamma[u] for gamma, u in zip(gammas, used, strict=True)]),
        pairs=np.concatenate([one.pairs[u] for one, u in zip(evs, used, strict=True)]).astype(np.float64),
        vectors=np.concatenate(along),
    )


def _parameters(name: str, ranges: str, dimensions: int) -> int:
    if ranges == "one" and "+" not in name:
        return PARAMETERS.get(name, 3)
    return 2 + len(Structures.of(name, ranges, dimensions).names)


def _fit(
    name: str, shape: float | None, ranges: str, bins: Bins, dimensions: int
) -> tuple[VariogramModel, bool, dict[str, str]]:
    """Return the best model of a family, or of several structures; whether it settled; the bounds hit."""
    if ranges == "one" and "+" not in name:
        model, settled = _fit_shapes(name, shape, bins.h, bins.gamma, bins.pairs)
        return model, settled, _bounds_hit(model, bins.h)
    structures = Structures.of(name, ranges, dimensions, shape)
    model, settled = fit_structures(structures, bins)
    return model, settled, at_bounds(structures, model, bins)


def _column(ev: ExperimentalVariogram, component: int) -> FloatArray:
    if not 0 <= component < ev.semivariance.shape[1]:
        raise DataError(
            f"component is {component}, but the variogram has the components 0 to {ev.semivariance.shape[1] - 1}"
        )
    return ev.semivariance[:, component]


def _families(family: str | Sequence[str], evs: Sequence[ExperimentalVariogram]) -> list[str]:
    if family == "best":
        return [name for name in USUAL if FAMILIES[name].dimensions >= max(ev.dimensions for ev in evs)]
    names = [family] if isinstance(family, str) else list(family)
    unknown = [part for name in names for part in name.split("+") if part.strip() not in FAMILIES]
    if unknown or not names:
        raise KrigingError(f"variogram family {unknown} is not known; use one of {', '.join(FAMILIES)}, or 'best'")
    return names


def _range_bounds(unit: VariogramModel, h: FloatArray) -> tuple[float, float]:
    """Return the interval of a: practical ranges from half the shortest lag to five times the longest."""
    if not unit.kind.bounded:  # only sill/range^α matters
        return float(h.max()), float(h.max())
    practical = unit.kind.practical_range(unit.shape)
    return h.min() / 2 / practical, LONGEST * h.max() / practical


def _fit_shapes(
    name: str, shape: float | None, h: FloatArray, gamma: FloatArray, pairs: FloatArray
) -> tuple[VariogramModel, bool]:
    """Return the model of the best shape, and whether its weights settled."""
    if name == "nugget":
        return VariogramModel(name, nugget=float(gamma @ pairs / pairs.sum())), True
    shapes = SHAPES.get(name, (None,)) if shape is None else (shape,)
    units = [VariogramModel(name, sill=1.0, shape=one) for one in shapes]
    fits = [_fit_family(unit, h, gamma, pairs) for unit in units]
    bins = Bins(h, gamma, pairs, np.empty((len(h), 0)))
    return min(fits, key=lambda fit: _objective(fit[0], bins))


def _fit_family(
    unit: VariogramModel, h: FloatArray, gamma: FloatArray, pairs: FloatArray
) -> tuple[VariogramModel, bool]:
    """Return the model after Cressie's iteration, and whether it settled."""
    lower, upper = _range_bounds(unit, h)
    ranges = np.geomspace(lower, upper, STARTS) if upper > lower else np.array([lower])
    floor = 1e-6 * gamma.max()
    weights, fitted = pairs, np.zeros_like(h)
    for _ in range(ITERATIONS):
        model = _best_range(unit, ranges, h, gamma, weights)
        previous, fitted = fitted, model.semivariance(h)
        if np.allclose(fitted, previous, rtol=1e-8, atol=0):
            return model, True
        weights = pairs / np.maximum(fitted, floor) ** 2
    return model, False


def _best_range(
    unit: VariogramModel, ranges: FloatArray, h: FloatArray, gamma: FloatArray, weights: FloatArray
) -> VariogramModel:
    _, _, loss = _linear_part(unit, ranges, h, gamma, weights)
    i = int(np.argmin(loss))
    best = float(ranges[i])
    if len(ranges) > 1:
        interval = math.log(ranges[max(i - 1, 0)]), math.log(ranges[min(i + 1, len(ranges) - 1)])

        def loss_at(log_range: float) -> float:
            return float(_linear_part(unit, np.array([math.exp(log_range)]), h, gamma, weights)[2][0])

        refined = minimize_scalar(loss_at, bounds=interval, method="bounded", options={"xatol": 1e-10})
        if refined.fun < loss[i]:
            best = math.exp(refined.x)
    nugget, sill, _ = _linear_part(unit, np.array([best]), h, gamma, weights)
    return replace(unit, nugget=float(nugget[0]), sill=float(sill[0]), range=best)


def _linear_part(
    unit: VariogramModel, ranges: FloatArray, h: FloatArray, gamma: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nugget, sill >= 0 and the weighted squares that they leave, for each range."""
    shape = 1 - unit._correlation(h / ranges[:, None])
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


def _objective(model: VariogramModel, bins: Bins) -> float:
    fitted = bins.semivariance(model)
    return float(((bins.weights(fitted) * (bins.gamma - fitted)) ** 2).sum() / bins.pairs.sum())


def _bounds_hit(model: VariogramModel, h: FloatArray) -> dict[str, str]:
    hit: dict[str, str] = {}
    if model.nugget <= 1e-9 * model.sill:
        hit["nugget"] = "lower"
    if model.family != "nugget" and model.sill <= 1e-9 * model.nugget:
        hit["sill"] = "lower"
    elif model.sill and model.kind.bounded:
        lower, upper = _range_bounds(model, h)
        if float(np.min(model.range)) <= lower * 1.001:
            hit["range"] = "lower"
        elif float(np.max(model.range)) >= upper * 0.999:
            hit["range"] = "upper"
    return hit


def _standard_errors(model: VariogramModel, hit: dict[str, str], bins: Bins) -> dict[str, float]:
    """Return sqrt diag s² (JᵀWJ)⁻¹ over the free parameters, s² the weighted mean square left."""
    columns = bins.derivatives(model)  # of the nugget alone where there is no sill
    fixed = set(hit) | ({"range"} if "sill" in hit or not model.kind.bounded else set())
    free = [name for name in columns if name not in fixed and not name.startswith("shape")]
    errors = dict.fromkeys(("nugget", "sill", "range"), math.nan) | dict.fromkeys(columns, math.nan)
    errors = {name: value for name, value in errors.items() if not name.startswith("shape")}
    if not free or len(bins.h) <= len(free):
        return errors
    fitted = bins.semivariance(model)
    scale = bins.weights(fitted)
    jacobian = scale[:, None] * np.column_stack([columns[name] for name in free])
    size = np.linalg.norm(jacobian, axis=0)
    if not size.all():  # equal ranges do not feel a turn
        return errors
    s2 = float(((scale * (bins.gamma - fitted)) ** 2).sum()) / (len(bins.h) - len(free))
    _, singular, right = np.linalg.svd(jacobian / size, full_matrices=False)
    if singular[-1] > 1e-10 * singular[0]:
        variance = s2 * ((right / singular[:, None]) ** 2).sum(axis=0) / size**2
        errors.update(zip(free, np.sqrt(variance).tolist(), strict=True))
    return errors
