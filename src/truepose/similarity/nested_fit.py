"""Fit of sums of structures, and of ranges along axes, to the bins of one or several semivariograms.

Weighted least squares as in `truepose.similarity.fit`, with the same weights. For given ranges, turns and shapes
the nugget and the sills are linear, none below zero (C. L. Lawson & R. J. Hanson, Solving Least Squares Problems, 1974,
ch. 23), so the search is over the others alone (variable projection: G. H. Golub & V. Pereyra, SIAM Journal on
Numerical Analysis 10, 1973).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import least_squares, nnls

from truepose._typing import FloatArray
from truepose.similarity.model import VariogramModel
from truepose.similarity.structures import Structures

ROUNDS: Final = 30
GRID: Final = 7
"""Practical ranges that the starts take, from the shortest lag to twice the longest."""
BEST: Final = 4
"""Starts that are refined."""
LONGEST: Final = 5.0
FLOOR: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of all variograms together.

    Attributes
    ----------
    h, gamma, pairs : (k,) arrays
        Lag, semivariance [mm²] and number of pairs.
    vectors : (k, d) or (k, 0) array
        The lag as a vector, where the variograms have directions.
    """

    h: FloatArray
    gamma: FloatArray
    pairs: FloatArray
    vectors: FloatArray

    def scaled(self, part: VariogramModel) -> FloatArray:
        """Return r of one structure at each lag, (k,)."""
        if isinstance(part.range, tuple):
            return np.asarray(np.linalg.norm(part.coordinates(self.vectors), axis=1))
        return self.h / part.range

    def semivariance(self, model: VariogramModel) -> FloatArray:
        """Return γ of a model at each lag, (k,)."""
        total = np.full(len(self.h), model.nugget)
        for part in model.structures:
            total += part.sill * (1 - part._correlation(self.scaled(part)))
        return total

    def derivatives(self, model: VariogramModel) -> dict[str, FloatArray]:
        """Return ∂γ/∂parameter at each lag, by name."""
        if not self.vectors.shape[1]:
            return model.derivatives(self.h)
        each = [model.derivatives(h, v) for h, v in zip(self.h[:, None], self.vectors, strict=True)]
        return {name: np.concatenate([one[name] for one in each]) for name in each[0]}

    def weights(self, fitted: FloatArray) -> FloatArray:
        """Return the square roots of Cressie's weights N/γ²."""
        return np.asarray(np.sqrt(self.pairs) / np.maximum(fitted, FLOOR * self.gamma.max()))


def fit_structures(structures: Structures, bins: Bins) -> tuple[VariogramModel, bool]:
    """Return the model that fits best, and whether its weights settled."""
    low, high = np.array(_bounds(structures, bins)).T
    weights = np.sqrt(bins.pairs) / bins.gamma.mean()
    starts = [np.clip(start, low, high) for start in _starts(structures, bins)]
    starts.sort(key=lambda start: float((_residual(start, structures, bins, weights) ** 2).sum()))
    fits = [_settle(structures, bins, start, (low, high)) for start in starts[:BEST]]

    def deviation(fit: tuple[VariogramModel, bool]) -> float:
        fitted = bins.semivariance(fit[0])
        return float(((bins.weights(fitted) * (bins.gamma - fitted)) ** 2).sum())

    return min(fits, key=deviation)


def at_bounds(structures: Structures, model: VariogramModel, bins: Bins) -> dict[str, str]:
    """Return the parameters of a fitted model that are at a bound: ranges, and nugget and sills of zero."""
    hit = {} if model.nugget > 1e-9 * model.partial_sill else {"nugget": "lower"}
    if len(model.structures) < len(structures.families):  # one of them is not needed
        return hit | {"sill": "lower"}
    searched = [name for name in structures.names if not name.startswith("sill")]
    bounds = dict(zip(searched, np.exp(_bounds(structures, bins)), strict=True))
    for k, part in enumerate(model.structures, 1):
        suffix = "" if k == 1 else f"_of_{k}"
        ranges = part.range if isinstance(part.range, tuple) else (part.range,)
        for axis, value in enumerate(ranges, 1):
            name = f"range_{axis}{suffix}" if isinstance(part.range, tuple) else f"range{suffix}"
            low, high = bounds[name]
            if not 1.001 * low < value < 0.999 * high:
                hit[name] = "lower" if value < (low * high) ** 0.5 else "upper"
    return hit


def _settle(
    structures: Structures, bins: Bins, theta: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> tuple[VariogramModel, bool]:
    """Return the model after Cressie's iteration from one start, and whether it settled."""
    weights, fitted = np.sqrt(bins.pairs) / bins.gamma.mean(), np.zeros_like(bins.h)
    settled = False
    for _ in range(ROUNDS):
        theta = least_squares(
            _residual, theta, bounds=bounds, args=(structures, bins, weights), x_scale=0.3, max_nfev=200
        ).x
        model = _model(theta, structures, bins, weights)
        previous, fitted = fitted, bins.semivariance(model)
        settled = bool(np.allclose(fitted, previous, rtol=1e-6, atol=0))
        if settled:
            break
        weights = bins.weights(fitted)
    return model, settled


def _residual(theta: FloatArray, structures: Structures, bins: Bins, weights: FloatArray) -> FloatArray:
    return weights * (bins.semivariance(_model(theta, structures, bins, weights)) - bins.gamma)


def _model(theta: FloatArray, structures: Structures, bins: Bins, weights: FloatArray) -> VariogramModel:
    """Return the model of given ranges, turns and shapes with the best nugget and sills."""
    full = np.zeros(len(structures.names))
    full[[not name.startswith("sill") for name in structures.names]] = theta
    parts = structures.parts(full)
    columns = np.column_stack([np.ones_like(bins.h), *(1 - part._correlation(bins.scaled(part)) for part in parts)])
    linear = nnls(weights[:, None] * columns, weights * bins.gamma)[0]
    nugget, first, *sills = linear.tolist()
    rest = tuple(replace(part, sill=sill) for part, sill in zip(parts[1:], sills, strict=True) if sill)
    return replace(parts[0], nugget=nugget, sill=first, plus=rest)


def _bounds(structures: Structures, bins: Bins) -> list[tuple[float, float]]:
    low, high = (np.full(structures.axes, value) for value in (bins.h.min() / 2, LONGEST * bins.h.max()))
    pairs = zip(structures.names, structures.bounds(low, high), strict=True)
    return [bound for name, bound in pairs if not name.startswith("sill")]


def _starts(structures: Structures, bins: Bins) -> list[FloatArray]:
    """Return starts with increasing ranges, in every combination, and with turned axes."""
    searched = [not name.startswith("sill") for name in structures.names]
    grid = np.geomspace(bins.h.min(), 2 * bins.h.max(), GRID)
    starts = []
    for reaches in combinations(grid, len(structures.families)):
        theta = structures.start(np.ones(structures.axes), spread=1.0)
        own = np.repeat(np.log(reaches), structures.axes)
        theta[[name.startswith("range") for name in structures.names]] += own
        starts += [start[searched] for start in structures.turned(theta)]
    return starts
