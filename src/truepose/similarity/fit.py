"""Fit of a variogram model to experimental semivariograms by weighted least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.experimental import ExperimentalVariogram
from truepose.similarity.least_squares import ITERATIONS, WEIGHTS, Bins, Fitted, fit_one, fit_several, standard_errors
from truepose.similarity.model import FitRecord, VariogramModel, warn_of_remarks
from truepose.similarity.parametrisation import Parametrisation
from truepose.similarity.structure import FAMILIES

USUAL: Final = ("spherical", "exponential", "gaussian", "matern32", "matern52")
"""Families that "best" tries: monotonic, with nugget, sill and range."""
PARAMETERS: Final = {"nugget": 1, "linear": 2, "power": 2}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class VariogramFit(FitRecord):
    """The record of a fit by weighted least squares.

    The criterion in `candidates` is the objective. Standard errors [mm², and the unit of the range] are from the
    weighted Jacobian at the shape that was chosen; NaN for a parameter at a bound or held, and for all where there are
    no more bins than parameters. Bins share points, so these errors are lower than the true ones.

    Attributes
    ----------
    objective : float
        The criterion by which families are compared. With Cressie's weights Σ N (γ/γ_model − 1)² / Σ N, the mean
        squared relative deviation; with others Σ w (γ − γ_model)² / Σ w over the squared mean of γ.
    bins : int
        The number of bins used.
    converged : bool
        Whether the weights settled.
    weights : str
        The weights of the bins.
    held : mapping of str to float
        The parameters that were not fitted.
    """

    objective: float
    bins: int
    converged: bool
    weights: str = "cressie"
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def remarks(self) -> tuple[str, ...]:
        """The meaning of bounds and range, in words."""
        return super().remarks + (() if self.converged else (f"the weights did not settle in {ITERATIONS} iterations",))


def fit_variogram(
    ev: ExperimentalVariogram | Sequence[ExperimentalVariogram],
    family: str | Sequence[str] = "spherical",
    *,
    component: int | None = None,
    shape: float | None = None,
    ranges: str = "one",
    weights: str = "cressie",
    fixed: Mapping[str, float] | None = None,
) -> VariogramModel:
    """Fit a variogram model to an experimental variogram.

    Parameters
    ----------
    ev : ExperimentalVariogram or sequence of ExperimentalVariogram
        The experimental variogram; or several along different directions, as needed by `ranges`.
    family : str or sequence of str
        A name of `VariogramModel`; several names, or "best" for the usual ones with a sill that are valid in the
        points' dimension, all with three parameters: the smallest `VariogramFit.objective` wins. A name such as
        "spherical+exponential" has several structures, the shorter range first in the starts.
    component : int, optional
        The column of the errors; the vector (sum over the components) when not given.
    shape : float, optional
        The shape of a family that has one; the best of several when not given.
    ranges : {"one", "each", "rotated"}
        The ranges of each structure: one; one for each coordinate; or one for each axis of a rotation that is fitted
        too, of 2 or 3 coordinates.
    weights : {"cressie", "pairs", "pairs/h2", "equal"}
        The weights of the bins: N(h)/γ(h)² with the fitted γ, iterated (Cressie 1985; gstat's method 2); N(h) (gstat's
        1); N(h)/h² (gstat's default, 7); or 1 (gstat's 6, the default of GSTools).
    fixed : mapping of str to float, optional
        The values of parameters that are not fitted, such as ``{"nugget": 0.01}``: ``nugget`` [mm²], ``sill`` [mm²]
        (the partial sill), ``range`` (the range parameter, in the unit of the lags). With several structures or ranges
        the names are those of `VariogramModel.derivatives`, as in ``range_of_2``. For a shape use `shape`.

    Returns
    -------
    VariogramModel
        The model, with its `fit` record.

    Warns
    -----
    VariogramWarning
        Once, with all `VariogramFit.remarks`: a parameter at its bound, or no sill within the samples.

    Raises
    ------
    KrigingError
        If fewer bins than fitted parameters hold pairs, if the errors do not vary, or if the family is not known.
    DataError
        If the weights are not known, or a fixed parameter does not exist or is out of its range.

    Examples
    --------
    >>> from truepose.similarity import experimental_variogram
    >>> x = np.linspace(0, 1000, 200)[:, None]
    >>> vm = fit_variogram(experimental_variogram(x, np.sin(x / 50)), "gaussian")
    >>> vm.structural_ratio > 0.99
    True
    >>> fit_variogram(experimental_variogram(x, np.sin(x / 50)), weights="pairs/h2", fixed={"nugget": 0.01}).nugget
    0.01
    """
    evs = [ev] if isinstance(ev, ExperimentalVariogram) else list(ev)
    names = _families(family, evs)
    if weights not in WEIGHTS:
        raise DataError(f"weights is {weights!r}; expected one of {', '.join(WEIGHTS)}")
    bins = replace(_bins(evs, component, ranges), weighting=weights, held=dict(fixed or {}))
    for name in names:
        _check_held(bins.held, name, ranges, evs[0].dimensions)
    parameters = min(_parameters(name, ranges, evs[0].dimensions) for name in names) - len(bins.held)
    if len(bins.h) < parameters:
        raise KrigingError(
            f"{len(bins.h)} bins hold pairs, but a variogram model has {parameters} parameters; "
            "use more bins or a larger max_lag, or measure more points"
        )
    if not bins.gamma.max() > 0:
        raise KrigingError("the errors do not vary within the lags; use a larger max_lag, or check the column of e")
    fits = {name: _fit(name, shape, ranges, bins, evs[0].dimensions) for name in names}
    candidates = {name: bins.objective(fitted.model) for name, fitted in fits.items()}
    best = min(candidates, key=candidates.__getitem__)
    model = fits[best].model
    record = VariogramFit(
        objective=candidates[best],
        standard_error=standard_errors(fits[best], bins),
        bounds_hit=fits[best].bounds_hit,
        bins=len(bins.h),
        converged=fits[best].converged,
        weights=weights,
        held=bins.held,
        candidates=candidates,
        fitted=model.to_dict(),
        practical_range=model.practical_range,
        longest=float(bins.h.max()),
    )
    warn_of_remarks(model.family, record)
    return replace(model, fit=record)


def _bins(evs: Sequence[ExperimentalVariogram], component: int | None, ranges: str) -> Bins:
    """Return the bins that hold pairs, of all variograms."""
    if not evs:
        raise DataError("expected a semivariogram, or several along different directions, got an empty sequence")
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


def _check_held(held: Mapping[str, float], family: str, ranges: str, dimensions: int) -> None:
    """Raise DataError where a model has no such parameter, or not with this value."""
    known: tuple[str, ...] = ("nugget",) if family == "nugget" else ("nugget", "sill", "range")
    if ranges != "one" or "+" in family:
        known = ("nugget", "sill", *Parametrisation.of(family, ranges, dimensions).names)
    known = tuple(name for name in known if not name.startswith("shape"))
    for name, value in held.items():
        if name not in known:
            raise DataError(f"fixed: a {family} variogram has no parameter {name!r}; expected {', '.join(known)}")
        positive = name.startswith("range")
        least = -math.inf if name.startswith("rotation") else 0.0
        if not math.isfinite(value) or value < least or (positive and value == 0):
            expected = "above 0" if positive else "of 0 or more" if least == 0 else ""
            raise DataError(f"fixed: {name} is {value}; expected a finite number {expected}".rstrip())


def _parameters(name: str, ranges: str, dimensions: int) -> int:
    if ranges == "one" and "+" not in name:
        return PARAMETERS.get(name, 3)
    return 2 + len(Parametrisation.of(name, ranges, dimensions).names)


def _fit(name: str, shape: float | None, ranges: str, bins: Bins, dimensions: int) -> Fitted:
    """Fit a family, or several structures."""
    if ranges == "one" and "+" not in name:
        return fit_one(name, shape, bins)
    return fit_several(Parametrisation.of(name, ranges, dimensions, shape), bins)


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
