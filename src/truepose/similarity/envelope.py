"""Is there similarity at all? A permutation envelope of the semivariogram, and the answer in words.

When the errors are shuffled among the points, nothing is left of their dependence on the distance. At the lags at which
the semivariance is below nearly all shuffled ones, near points are more alike than by chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truepose._io.tables import html_table
from truepose._typing import BoolArray, FloatArray
from truepose.errors import DataError
from truepose.similarity.experimental import (
    Direction,
    ExperimentalVariogram,
    check_points,
    direction_cone,
    estimate,
    experimental_variogram,
)
from truepose.similarity.model import VariogramModel
from truepose.similarity.words import Words, english


@dataclass(frozen=True, eq=False, repr=False)
class Envelope:
    """Pointwise band of the semivariance under shuffling; k bins, c components.

    Attributes
    ----------
    variogram : ExperimentalVariogram
        The semivariogram of the errors without shuffling.
    lower, upper : (k, c) arrays [mm²]
        The band of each component.
    vector_lower, vector_upper : (k,) arrays [mm²]
        The band of the vector.
    p_value : float
        The share of all permutations in which near points are at least as alike, over the shortest quarter
        of the lags: the test of "is there similarity at all".
    level : float
        The share of the shuffles inside the band at one lag.
    permutations : int
        The number of shuffles.
    """

    variogram: ExperimentalVariogram
    lower: FloatArray
    upper: FloatArray
    vector_lower: FloatArray
    vector_upper: FloatArray
    p_value: float
    level: float
    permutations: int

    @property
    def by_chance(self) -> bool:
        """Whether the similarity does not differ from that of shuffled errors, at the level of the band."""
        return self.p_value > 1 - self.level

    @property
    def structured(self) -> BoolArray:
        """Lags at which the vector semivariance is below the band, (k,)."""
        below: BoolArray = self.variogram.vector < self.vector_lower
        return below

    @property
    def structured_components(self) -> BoolArray:
        """The same for each component, (k, c)."""
        below: BoolArray = self.variogram.semivariance < self.lower
        return below

    def __repr__(self) -> str:
        """Return the test's p-value and the number of lags below the band."""
        lags = f"{self.structured.sum()} of {len(self.structured)} lags below the {100 * self.level:g} % band"
        return f"Envelope(p = {self.p_value:.3g} of {self.permutations} permutations; {lags}; {self.variogram!r})"

    def _repr_html_(self) -> str:
        band = f"band of {100 * self.level:g} % of {self.permutations} permutations"
        rows = zip(self.variogram.lag, self.variogram.vector, self.vector_lower, self.vector_upper, strict=True)
        header = ["lag", "γ [mm²]", "lower", "upper"]
        return html_table(
            f"Similarity p = {self.p_value:.3g}; {band}", header, [tuple(map(float, row)) for row in rows]
        )

    def to_dict(self) -> dict[str, Any]:
        """Return test and band as plain values, units in the names."""
        return {
            "p_value": self.p_value,
            "level": self.level,
            "permutations": self.permutations,
            "structured": self.structured.tolist(),
            "lower_mm2": self.lower.tolist(),
            "upper_mm2": self.upper.tolist(),
            "vector_lower_mm2": self.vector_lower.tolist(),
            "vector_upper_mm2": self.vector_upper.tolist(),
            "variogram": self.variogram.to_dict(),
        }


def permutation_envelope(
    x: ArrayLike,
    e: ArrayLike,
    bins: int | ArrayLike = 20,
    max_lag: float | None = None,
    *,
    permutations: int = 199,
    level: float = 0.95,
    estimator: str = "matheron",
    direction: Direction | ArrayLike | None = None,
    weights: ArrayLike | None = None,
    rng: np.random.Generator | int = 0,
) -> Envelope:
    """Return the pointwise band of the semivariance when e is shuffled among the points.

    The rows of e are shuffled whole, so that the components keep their dependence. All shuffles are summed in one visit
    of each pair; its distance is computed once.

    Parameters
    ----------
    x, e, bins, max_lag, estimator, direction, weights
        The arguments of `experimental_variogram`.
    permutations : int
        The number of shuffles, at least 2/(1 − level) − 1.
    level : float
        The share of shuffles within the band: 0.95 gives the 2.5 and 97.5 % quantiles.
    rng : Generator or int
        The source, or seed, of the shuffles.

    Raises
    ------
    DataError
        If arrays or bins are invalid, or there are too few permutations for the level.

    Examples
    --------
    >>> x = np.linspace(0, 1000, 100)[:, None]
    >>> envelope = permutation_envelope(x, np.sin(x / 200))
    >>> bool(envelope.structured[0]), envelope.p_value
    (True, 0.005)
    """
    if not 0 < level < 1:
        raise DataError(f"level is {level}; expected a share between 0 and 1")
    if permutations < round(2 / (1 - level)) - 1:
        raise DataError(
            f"{permutations} permutations cannot give a band of {level:g}; use at least {round(2 / (1 - level)) - 1}"
        )
    points, errors = check_points(x, e, weights)
    cone = direction_cone(direction, weights, points.shape[1])
    along = None if direction is None else Direction(*cone)
    variogram = experimental_variogram(points, errors, bins, max_lag, estimator, along)
    n, c = errors.shape
    order = np.random.default_rng(rng).permuted(np.tile(np.arange(n), (permutations, 1)), axis=1)
    shuffled = errors[order.T].reshape(n, permutations * c)
    pairs, _, gamma = estimate(estimator, points, shuffled, variogram.edges, cone)
    semivariance = gamma[1:].reshape(-1, permutations, c)
    tails = [(1 - level) / 2, (1 + level) / 2]
    lower, upper = np.quantile(semivariance, tails, axis=1)
    vector = semivariance.sum(axis=2)
    vector_lower, vector_upper = np.quantile(vector, tails, axis=1)
    filled = np.flatnonzero(variogram.pairs)
    short = filled[: max(1, len(variogram.pairs) // 4)]
    alike, observed = pairs[1:][short] @ vector[short], pairs[1:][short] @ variogram.vector[short]
    p_value = float((1 + np.count_nonzero(alike <= observed)) / (permutations + 1))
    return Envelope(variogram, lower, upper, vector_lower, vector_upper, p_value, level, permutations)


def verdict(
    model: VariogramModel,
    envelope: Envelope,
    unit: str = "mm",
    *,
    nugget: float | None = None,
    words: Words = english,
) -> str:
    """Return one sentence: is there similarity, how far it reaches, how much is noise.

    Parameters
    ----------
    model : VariogramModel
        The model fitted to `envelope.variogram`.
    envelope : Envelope
        The permutation envelope.
    unit : str
        The unit of the distances, for the text.
    nugget : float [mm²], optional
        The nugget, as for `sampled`.
    words : callable
        The words of another language; see `truepose.similarity.words`.

    Examples
    --------
    >>> from truepose.similarity import fit_variogram
    >>> x = np.linspace(0, 1000, 100)[:, None]
    >>> band = permutation_envelope(x, np.sin(x / 200))
    >>> verdict(fit_variogram(band.variogram, "gaussian"), band).split(" (")[0]
    'Yes, near points have similar errors'
    """
    lag = envelope.variogram.lag
    filled = np.flatnonzero(envelope.variogram.pairs > 0)
    below = envelope.structured[filled]
    count = words("count", below=int(below.sum()), lags=filled.size, percent=100 * envelope.level)
    if envelope.by_chance or model.sill == 0:
        return words("chance", p=envelope.p_value, count=count)
    first_above = int(np.argmin(below)) if not below.all() else filled.size
    reach = words("reach", lag=float(lag[filled[first_above - 1]]), unit=unit) if first_above else words("short")
    found = sampled(model, envelope.variogram, nugget)
    extent = words("extent", range=model.practical_range, unit=unit) if found.sill else words("trend")
    structure: dict[str, float | str] = {"structure": found.structure_percent, "lag": found.lag, "unit": unit}
    return words("similar", p=envelope.p_value, count=count, reach=reach, extent=extent, **structure)


@dataclass(frozen=True)
class Sampled:
    """The variance and the nugget of a model within the sampled distances: nothing is extrapolated.

    Attributes
    ----------
    lag : float
        The largest lag of the semivariogram.
    variance : float [mm²]
        The semivariance γ at that lag: sill and nugget where the sill is reached within it.
    nugget : float [mm²]
        The nugget.
    sill : bool
        Whether the sill is reached within it.
    """

    lag: float
    variance: float
    nugget: float
    sill: bool

    @property
    def noise_share(self) -> float:
        """Nugget over variance."""
        return min(self.nugget / self.variance, 1.0) if self.variance > 0 else 1.0

    @property
    def structure_percent(self) -> float:
        """The share of the structure, rounded to the digits of the noise share, at least to whole percents."""
        noise = float(f"{100 * self.noise_share:.2g}")
        return round(100.0 - noise, max(0, 1 - math.floor(math.log10(noise))) if 0 < noise < 1 else 0)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, units in the names."""
        return {
            "largest_lag": self.lag,
            "variance_mm2": self.variance,
            "nugget_mm2": self.nugget,
            "noise_share": self.noise_share,
            "sill_within_samples": self.sill,
        }


def sampled(model: VariogramModel, variogram: ExperimentalVariogram, nugget: float | None = None) -> Sampled:
    """Return variance and nugget of a model within the distances of a semivariogram.

    Parameters
    ----------
    model : VariogramModel
        Fitted to `variogram`. Of an anisotropic model the variance is the mean over the axes.
    variogram : ExperimentalVariogram
        The experimental semivariogram.
    nugget : float [mm²], optional
        The nugget where it is known better than from the model, as from `fit_likelihood`; the model's when not given.
    """
    lag = float(variogram.lag[variogram.pairs > 0].max())
    axes = [None] if model.isotropic else list(np.eye(variogram.dimensions))
    variance = float(np.mean([model.semivariance(lag, axis) for axis in axes]))
    return Sampled(lag, variance, model.nugget if nugget is None else nugget, model.practical_range <= lag)
