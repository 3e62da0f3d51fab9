"""The experimental semivariogram, theory (4): half the mean squared difference of errors a distance h apart.

The estimator Matheron is theory (4). The others resist gross errors; with N differences z of a bin:

========= ============================================================== ======================================
cressie   (1/N Σ |z|^½)⁴ / (0.457 + 0.494/N + 0.045/N²) / 2              N. Cressie & D. Hawkins, Math. Geology 12
                                                                         (1980)
dowd      2.198 median(|z|)² / 2                                         P. A. Dowd, in: Geostatistics for Natural
                                                                         Resources Characterization (1984)
genton    (2.2191 {|z_i − z_j|; i < j}_(k))² / 2, k = C(⌊N/2⌋ + 1, 2)    M. G. Genton, Math. Geology 30 (1998)
========= ============================================================== ======================================

Genton's z have signs: here each pair is taken in the order in which its first coordinate that differs rises, so that
the order of the samples does not matter. Genton needs all differences at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._io.tables import data_frame, html_table
from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError, KrigingError

if TYPE_CHECKING:
    from pandas import DataFrame

WEAK_PAIRS: Final = 30
"""A bin with fewer pairs than this is reported as weak (Journel & Huijbregts 1978)."""
ESTIMATORS: Final = ("matheron", "cressie", "dowd", "genton")
MOST_POINTS: Final = 5000
"""Points whose pairs are held in memory: some 12 million."""
Cone = tuple[FloatArray, float, float]
"""The unit vector of a direction (empty for all directions), its tolerance [rad], and its bandwidth."""


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction along which pairs are counted.

    Parameters
    ----------
    axis : (d,) array_like
        The direction; its length and sign do not matter.
    tolerance : float [rad]
        The largest angle between a pair and the axis.
    bandwidth : float
        The largest distance of one point from the axis through the other, in the unit of the coordinates.
    """

    axis: ArrayLike
    tolerance: float = np.pi / 8
    bandwidth: float = np.inf


@dataclass(frozen=True, eq=False, repr=False)
class ExperimentalVariogram:
    """An experimental semivariogram of k bins and c components.

    Attributes
    ----------
    lag : (k,) array
        The mean distance of the pairs of each bin, in the unit of the coordinates; NaN in an empty bin.
    semivariance : (k, c) array [mm²]
        The semivariance (4) of each component; NaN in an empty bin.
    vector : (k,) array [mm²]
        Theory (4) with the squared norm of the vector difference: the sum over the components.
    pairs : (k,) array of int
        The number of pairs N(h).
    edges : (k + 1,) array
        The edges of the bins; bin b holds edges[b] < h <= edges[b + 1].
    repeats : int
        Pairs at or below edges[0], which no bin holds: with the default bins, repeats of one point.
    repeat_semivariance : (c,) array [mm²]
        Their semivariance: the variance of the noise alone; NaN without repeats.
    dimensions : int
        The number of coordinates d of the points.
    estimator : str
        The estimator.
    cross : (k, c, c) array [mm²]
        The cross-semivariances of the component pairs, if requested (else empty); the diagonal is `semivariance`.
    axis : (d,) array
        The unit vector of the direction of its pairs, in the coordinates that the distances are of; empty for all.
    """

    lag: FloatArray
    semivariance: FloatArray
    vector: FloatArray
    pairs: IntArray
    edges: FloatArray
    repeats: int
    repeat_semivariance: FloatArray
    dimensions: int
    estimator: str = "matheron"
    cross: FloatArray = field(default_factory=lambda: np.empty((0, 0, 0)))
    axis: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def weak(self) -> BoolArray:
        """Bins with fewer than 30 pairs, (k,)."""
        return self.pairs < WEAK_PAIRS

    def __repr__(self) -> str:
        """Return sizes, the range of lags, and the semivariance at the shortest and the longest."""
        filled = np.flatnonzero(self.pairs)
        size = f"{len(self.pairs)} bins, {self.semivariance.shape[1]} components, {self.pairs.sum()} pairs"
        text = f"ExperimentalVariogram({size}, {self.weak.sum()} weak bins, {self.estimator}"
        if filled.size:
            first, last = filled[[0, -1]]
            text += f"; γ = {self.vector[first]:.4g} mm² at lag {self.lag[first]:.4g}"
            text += f", {self.vector[last]:.4g} mm² at lag {self.lag[last]:.4g}"
        return text + ")"

    def _repr_html_(self) -> str:
        header = ["lag", "pairs", *(f"γ{k} [mm²]" for k in range(1, self.semivariance.shape[1] + 1)), "vector [mm²]"]
        columns = zip(self.lag, self.pairs, *self.semivariance.T, self.vector, strict=True)
        return html_table(f"Experimental semivariogram ({self.estimator})", header, columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the bins as plain values, units in the names."""
        return {
            "lag": self.lag.tolist(),
            "semivariance_mm2": self.semivariance.tolist(),
            "vector_mm2": self.vector.tolist(),
            "pairs": self.pairs.tolist(),
            "edges": self.edges.tolist(),
            "estimator": self.estimator,
        }

    def to_frame(self) -> DataFrame:
        """Return a pandas table with one row for each bin; needs pandas. `from_frame` reads it."""
        components = {f"gamma_{k}_mm2": column for k, column in enumerate(self.semivariance.T, 1)}
        bins = {"from": self.edges[:-1], "to": self.edges[1:], "lag": self.lag, "pairs": self.pairs}
        return data_frame({**bins, **components}, dimensions=self.dimensions, estimator=self.estimator)

    @classmethod
    def from_frame(cls, frame: DataFrame, dimensions: int | None = None) -> Self:
        """Return the semivariogram of a pandas table, for example of one that another program computed.

        Parameters
        ----------
        frame : pandas.DataFrame
            A table with the columns ``lag``, ``pairs``, and ``gamma_1_mm2`` … for each component; ``from`` and ``to``,
            the edges of the bins, if they are known.
        dimensions : int, optional
            The number of coordinates of the points; by default that of `to_frame`, or 3.

        Raises
        ------
        DataError
            If a column is missing.

        Examples
        --------
        >>> import pandas as pd
        >>> table = pd.DataFrame({"lag": [10.0, 20.0], "pairs": [80, 150], "gamma_1_mm2": [0.2, 0.3]})
        >>> ExperimentalVariogram.from_frame(table).vector
        array([0.2, 0.3])
        """
        names = [name for name in map(str, frame.columns) if name.startswith("gamma_") and name.endswith("_mm2")]
        if missing := [name for name in ("lag", "pairs") if name not in frame] + ["gamma_1_mm2"] * (not names):
            raise DataError(f"the table has no column {', '.join(missing)}; expected lag, pairs, gamma_1_mm2 …")
        lag, gamma = (np.asarray(frame[key], dtype=np.float64) for key in ("lag", names))
        middles = np.concatenate([[0.0], (lag[1:] + lag[:-1]) / 2, lag[-1:]])
        known = {"from", "to"} <= set(frame.columns)
        return cls(
            lag=lag,
            semivariance=gamma,
            vector=gamma.sum(axis=1),
            pairs=np.asarray(frame["pairs"], dtype=np.int64),
            edges=np.append(frame["from"].to_numpy(), frame["to"].to_numpy()[-1:]) if known else middles,
            repeats=0,
            repeat_semivariance=np.full(len(names), np.nan),
            dimensions=dimensions or frame.attrs.get("dimensions", 3),
            estimator=frame.attrs.get("estimator", "unknown"),
        )


def experimental_variogram(
    x: ArrayLike,
    e: ArrayLike,
    bins: int | ArrayLike = 20,
    max_lag: float | None = None,
    estimator: str = "matheron",
    direction: Direction | ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
    cross: bool = False,
) -> ExperimentalVariogram:
    """Return the semivariogram of e over the distances of x, theory (4).

    Parameters
    ----------
    x : (n, d) array_like
        Positions (n, 3) [mm] or joints (n, dof) [rad].
    e : (n, c) or (n,) array_like [mm]
        The errors at x.
    bins : int or (k + 1,) array_like
        The number of equal bins between 0 and `max_lag`, or the increasing edges of the bins. A bin is closed on the
        right.
    max_lag : float, optional
        The largest distance, in the unit of x; half the largest distance between two points when not given.
    estimator : {"matheron", "cressie", "dowd", "genton"}
        Matheron is theory (4). The others resist gross errors: Cressie and Hawkins by fourth powers of mean square
        roots, Dowd by the median, Genton by the quartile of the differences' differences.
    direction : Direction or (d,) array_like, optional
        The direction, if only pairs along it are counted.
    weights : (d,) array_like, optional
        w of the joint-space distance sqrt(Σ w_k (x_k - x'_k)²), not negative.
    cross : bool
        Also return the cross-semivariances ½ mean (Δe_a Δe_b), as (γ(e_a + e_b) − γ(e_a − e_b))/4.

    Raises
    ------
    DataError
        If arrays, bins or direction are invalid.
    KrigingError
        If all points are the same.

    Examples
    --------
    >>> ev = experimental_variogram([[0.0], [1.0], [2.0]], [0.0, 2.0, 2.0], bins=[0.0, 1.0, 2.0])
    >>> ev.lag, ev.semivariance[:, 0], ev.pairs
    (array([1., 2.]), array([1., 2.]), array([2, 1]))
    >>> ev
    ExperimentalVariogram(2 bins, 1 components, 3 pairs, 2 weak bins, matheron; γ = 1 mm² at lag 1, 2 mm² at lag 2)
    """
    points, errors = check_points(x, e, weights)
    edges = bin_edges(points, bins, max_lag)
    cone = direction_cone(direction, weights, points.shape[1])
    c = errors.shape[1]
    duos = list(combinations(range(c), 2)) if cross else []
    sides = [errors[:, a] + sign * errors[:, b] for a, b in duos for sign in (1, -1)]
    pairs, distance, gamma = estimate(estimator, points, np.column_stack([errors, *sides]), edges, cone)
    with np.errstate(invalid="ignore"):
        lag = distance[1:] / pairs[1:]
    semivariance = gamma[:, :c]
    return ExperimentalVariogram(
        lag=lag,
        semivariance=semivariance[1:],
        vector=semivariance[1:].sum(axis=1),
        pairs=pairs[1:],
        edges=edges,
        repeats=int(pairs[0]),
        repeat_semivariance=semivariance[0],
        dimensions=points.shape[1],
        estimator=estimator,
        cross=_cross(semivariance[1:], gamma[1:, c:], duos) if cross else np.empty((0, 0, 0)),
        axis=cone[0],
    )


class VariogramCloud(NamedTuple):
    """Every pair of points by itself: which two samples make a bin high.

    Attributes
    ----------
    first, second : (N,) arrays of int
        The rows of the samples.
    distance : (N,) array
        The distances, in the unit of the coordinates.
    semivariance : (N, c) array [mm²]
        Half the squared difference of each component.
    """

    first: IntArray
    second: IntArray
    distance: FloatArray
    semivariance: FloatArray


def variogram_cloud(
    x: ArrayLike,
    e: ArrayLike,
    max_lag: float | None = None,
    direction: Direction | ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
) -> VariogramCloud:
    """Return all pairs up to a distance, for at most 5,000 points.

    Parameters are those of `experimental_variogram`; all pairs when `max_lag` is not given.

    Examples
    --------
    >>> variogram_cloud([[0.0], [1.0], [3.0]], [0.0, 2.0, 1.0], max_lag=2.0).semivariance.ravel()
    array([2. , 0.5])
    """
    points, errors = check_points(x, e, weights)
    cone = direction_cone(direction, weights, points.shape[1])
    first, second, distance = _cloud(points, cone, np.inf if max_lag is None else max_lag)
    return VariogramCloud(first, second, distance, (errors[second] - errors[first]) ** 2 / 2)


def _cross(direct: FloatArray, sides: FloatArray, duos: list[tuple[int, int]]) -> FloatArray:
    k, c = direct.shape
    out = np.empty((k, c, c))
    out[:, range(c), range(c)] = direct
    for number, (a, b) in enumerate(duos):
        out[:, a, b] = out[:, b, a] = (sides[:, 2 * number] - sides[:, 2 * number + 1]) / 4
    return out


def check_points(x: ArrayLike, e: ArrayLike, weights: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return x as (n, d), scaled by the weights, and e as (n, c); raise DataError where they are invalid."""
    points, errors = np.asarray(x, dtype=np.float64), np.asarray(e, dtype=np.float64)
    if errors.ndim == 1:
        errors = errors[:, None]
    if points.ndim != 2 or errors.ndim != 2 or 0 in points.shape or errors.shape[1] == 0:
        raise DataError(
            f"x has shape {points.shape} and e {errors.shape}; a variogram needs x (n, d) and e (n, c) or (n,)"
        )
    if len(points) != len(errors):
        raise DataError(f"x has {len(points)} rows and e has {len(errors)}; give one error for each point")
    if len(points) < 2:
        raise DataError("a variogram needs pairs of points, but there is one point; measure more")
    for name, array in (("x", points), ("e", errors)):
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if bad.size:
            raise DataError(f"{name} has NaN or infinity in row {bad[0]} ({bad.size} rows in all); remove these rows")
    if weights is not None:
        w = np.asarray(weights, dtype=np.float64)
        if w.shape != (points.shape[1],) or not (np.isfinite(w).all() and (w >= 0).all() and w.any()):
            raise DataError(
                f"weights are {w}; expected a number >= 0 for each of the {points.shape[1]} coordinates of x"
            )
        points = points * np.sqrt(w)
    return points, errors


def bin_edges(points: FloatArray, bins: int | ArrayLike, max_lag: float | None) -> FloatArray:
    """Return the bin edges (k + 1,): as given, or equal bins up to `max_lag`."""
    from truepose.numerics.pairs import largest_distance

    if np.ndim(bins) > 0:
        edges = np.asarray(bins, dtype=np.float64)
        if (
            edges.ndim != 1
            or len(edges) < 2
            or not np.isfinite(edges).all()
            or edges[0] < 0
            or (np.diff(edges) <= 0).any()
        ):
            raise DataError("bin edges must be two or more increasing finite distances, the first not negative")
        if max_lag is not None:
            raise DataError("bins gives the edges already; leave max_lag out, or give the number of bins")
        return edges
    count = float(np.asarray(bins, dtype=np.float64))
    if not (count >= 1 and count.is_integer()):
        raise DataError(f"bins is {count:g}; give a number of bins of at least 1, or an array of edges")
    if max_lag is None:
        max_lag = largest_distance(points) / 2
        if max_lag == 0:
            raise KrigingError(f"all {len(points)} points are the same; a variogram needs points that are apart")
    if not (np.isfinite(max_lag) and max_lag > 0):
        raise DataError(f"max_lag is {max_lag}; give a distance above 0 in the unit of x")
    return np.linspace(0, max_lag, int(count) + 1)


def direction_cone(direction: Direction | ArrayLike | None, weights: ArrayLike | None, d: int) -> Cone:
    """Return the cone of a direction in weighted coordinates."""
    if direction is None:
        return np.empty(0), 0.0, 0.0
    cone = direction if isinstance(direction, Direction) else Direction(direction)
    axis = np.asarray(cone.axis, dtype=np.float64)
    if axis.shape == (d,) and weights is not None:
        axis = axis * np.sqrt(np.asarray(weights, dtype=np.float64))
    length = np.linalg.norm(axis)
    if axis.shape != (d,) or not np.isfinite(length) or length == 0:
        raise DataError(f"direction has the axis {axis}; give a vector of {d} numbers that is not zero")
    if not 0 < cone.tolerance <= np.pi / 2 or not cone.bandwidth > 0:
        raise DataError(
            f"direction has tolerance {cone.tolerance} rad and bandwidth {cone.bandwidth}; "
            "expected a tolerance above 0 and up to pi/2, and a bandwidth above 0"
        )
    return axis / length, cone.tolerance, cone.bandwidth


# --- estimators -------------------------------------------------------------------------------------------------------


def estimate(
    estimator: str,
    x: FloatArray,
    e: FloatArray,
    edges: FloatArray,
    cone: Cone,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return by bin, entry 0 at or below edges[0], the pairs, the sum of distances, and the semivariance (k + 1, c)."""
    if estimator not in ESTIMATORS:
        raise DataError(f"variogram estimator {estimator!r} is not known; use one of {', '.join(ESTIMATORS)}")
    if estimator in ("matheron", "cressie"):
        from truepose.numerics.pairs import pair_sums

        pairs, distance, sums = pair_sums(x, e, edges, *cone, roots=estimator == "cressie")
        with np.errstate(invalid="ignore", divide="ignore"):
            mean, n = sums / pairs[:, None], pairs[:, None]
            return pairs, distance, mean / 2 if estimator == "matheron" else mean**4 / (0.914 + 0.988 / n + 0.09 / n**2)
    if estimator == "dowd":
        from truepose.numerics.pairs import middle_gaps, pair_sums

        pairs, distance, _ = pair_sums(x, e, edges, *cone)
        return pairs, distance, 2.198 * middle_gaps(x, e, edges, *cone) ** 2 / 2
    return _of_all_differences(x, e, edges, cone)


def _cloud(x: FloatArray, cone: Cone, longest: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the points and the distance of all pairs within a cone, up to a distance.

    The points of a pair are ordered so that the first coordinate that differs rises.
    """
    n, (axis, tolerance, bandwidth) = len(x), cone
    if n > MOST_POINTS:
        raise DataError(
            f"{n} points have too many pairs to be held at once (at most {MOST_POINTS} points); "
            "use the estimators matheron, cressie or dowd, or a part of the points"
        )
    i, j = np.triu_indices(n, 1)
    step = x[j] - x[i]
    distance = np.sqrt(np.einsum("nd,nd->n", step, step))
    keep = distance <= longest
    if axis.size:
        along2 = (step @ axis) ** 2
        square = distance**2
        inside = (along2 >= np.cos(tolerance) ** 2 * square) & (square - along2 <= bandwidth**2)
        keep &= inside | (distance == 0)
    turned = np.take_along_axis(step, (step != 0).argmax(axis=1)[:, None], axis=1)[:, 0] < 0
    i, j = np.where(turned, j, i)[keep], np.where(turned, i, j)[keep]
    return i, j, distance[keep]


def _of_all_differences(
    x: FloatArray, e: FloatArray, edges: FloatArray, cone: Cone
) -> tuple[IntArray, FloatArray, FloatArray]:
    first, second, h = _cloud(x, cone, float(edges[-1]))
    bins = np.searchsorted(edges, h, side="left")
    order = np.argsort(bins, kind="stable")
    count = np.bincount(bins, minlength=len(edges))
    limits = np.concatenate([[0], np.cumsum(count)])
    distance = np.bincount(bins, h, minlength=len(edges))
    gamma = np.full((len(edges), e.shape[1]), np.nan)
    for c in range(e.shape[1]):
        z = (e[second, c] - e[first, c])[order]
        for b in np.flatnonzero(count):
            gamma[b, c] = _genton(z[limits[b] : limits[b + 1]])
    return count.astype(np.int64), distance.astype(np.float64), gamma


def _genton(z: FloatArray) -> float:
    from truepose.numerics.pairs import smallest_gap

    n = len(z)
    if n < 2:
        return np.nan
    half = n // 2 + 1
    return float((2.2191 * smallest_gap(np.sort(z), half * (half - 1) // 2)) ** 2 / 2)
