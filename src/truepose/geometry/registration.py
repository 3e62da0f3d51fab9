"""Registration of tracker readings to the robot base frame: rigid, or together with the tool offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.arrays import as_floats, as_rows, check_finite, name_rows
from truepose.geometry.plausibility import check_units, explain_misfit, find_swapped, median_radius, write_hint
from truepose.geometry.robust import OUTLIER_LIMIT, robust_scale, tukey_weights
from truepose.geometry.station import (
    MINIMAL,
    MINIMAL_LINEAR,
    Station,
    StationPoses,
    ToolPrior,
    check_identifiable,
    covariance,
    open_directions,
    refine_station,
    start,
    weak_hint,
)
from truepose.geometry.transforms import apply_transform, check_transforms, invert_transform, make_transform

_ROUNDING: Final = 1e-12  # relative rounding of coordinates
_REWEIGHTINGS: Final = 100


@dataclass(frozen=True, eq=False, repr=False)
class Registration:
    """The tracker's station, its uncertainty, and the residuals.

    Attributes
    ----------
    tf_base_tracker : (4, 4) array [mm]
        The transform from tracker coordinates to the robot base frame.
    residuals : (n, 3) array [mm], base frame
        The measured minus the commanded positions after registration: the positional errors e.
    outliers : (n,) bool array
        Whether each reading was left out of the fit.
    covariance : (6, 6) or (9, 9) array
        The covariance of translation [mm], rotation vector [rad] and, when fitted, tool offset [mm]. The true transform
        is (exp(δω) R, t + δt).
    noise_std : float [mm]
        The standard deviation of one axis of the residuals without outliers.
    p_flange_tool : (3,) array [mm], flange frame, or None
        The fitted tool offset.
    swapped : (k, 2) int array
        The pairs of outliers that match each other: row of a command, row of the reading.
    hint : str
        A hint if rows seem swapped, many readings are outliers, or tool and station are poorly separated; otherwise
        empty.
    """

    tf_base_tracker: FloatArray
    residuals: FloatArray
    outliers: BoolArray
    covariance: FloatArray
    noise_std: float
    p_flange_tool: FloatArray | None
    swapped: IntArray
    hint: str = ""

    def __repr__(self) -> str:
        rows, _ = self.outlier_rows()
        outliers = f"{len(rows)} outlier{'s' * (len(rows) > 1)} ({name_rows(rows)})" if len(rows) else "no outliers"
        std = np.sqrt(np.diag(self.covariance))
        station = f"tracker at {_millimetres(self.tf_base_tracker[:3, 3])} ± {_largest(std[:3])}"
        tool = ""
        if self.p_flange_tool is not None:
            tool = f"; tool at {_millimetres(self.p_flange_tool)} ± {_largest(std[6:])}"
        hint = f"; {self.hint}" if self.hint else ""
        return (
            f"<Registration of {len(self.residuals)} readings, {outliers}; noise {self.noise_std:.4g} mm per axis; "
            f"{station}{tool}{hint}>"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}

    @property
    def tf_tracker_base(self) -> FloatArray:
        """The transform from base coordinates to the tracker frame: (4, 4) [mm]."""
        return invert_transform(self.tf_base_tracker)

    def apply(self, p_tracker: ArrayLike) -> FloatArray:
        """Return points (n, 3) [mm] of the tracker frame in the base frame: (n, 3) [mm]."""
        return apply_transform(self.tf_base_tracker, as_rows("points", p_tracker, 3))

    def outlier_rows(self) -> tuple[IntArray, FloatArray]:
        """Return the rows of the outliers, counted from 0, and the size of each residual [mm], largest first."""
        rows = np.flatnonzero(self.outliers)
        size = np.linalg.norm(self.residuals[rows], axis=1)
        order = np.argsort(-size, kind="stable")
        return rows[order], size[order]


def register(
    p_commanded: ArrayLike, p_measured: ArrayLike, robust: bool = True, rng: int | np.random.Generator = 0
) -> Registration:
    """Fit the tracker's station: the rigid transform from measured to commanded positions.

    The fit is least squares (Kabsch 1976, Umeyama 1991). With `robust` it leaves outliers out: it starts from random
    subsets (least quantile of squares), reweights with Tukey's biweight, and ends with least squares on all readings
    within `OUTLIER_LIMIT` robust standard deviations.

    Parameters
    ----------
    p_commanded : (n, 3) array [mm], base frame
        The commanded positions of the TCP, n >= 3.
    p_measured : (n, 3) array [mm], tracker frame
        The readings.
    robust : bool
        Whether outliers (up to nearly half of the readings) are found and left out.
    rng : int or Generator
        The seed, or source, of the random subsets.

    Returns
    -------
    Registration
        The station, with a covariance of shape (6, 6).

    Raises
    ------
    DataError
        If shapes are wrong, values are NaN, there are fewer than 3 points, positions are in another unit, an axis is
        mirrored, or rows do not belong together.
    IdentifiabilityError
        If the points lie on a line.

    Notes
    -----
    Errors of the tool in `p_commanded` are seen as residuals when the orientation changes: use `register_with_tool`
    then.

    Examples
    --------
    >>> import numpy as np
    >>> p_commanded = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100.0]])
    >>> register(p_commanded, p_commanded + [10, 20, 30]).tf_base_tracker[:3, 3].round(6)
    array([-10., -20., -30.])
    """
    commanded = as_rows("p_commanded", p_commanded, 3)
    measured = as_rows("p_measured", p_measured, 3)
    _check_count(len(commanded), len(measured), MINIMAL)
    check_units(commanded, measured, ("m", "cm", "in"), tolerance=1.25)
    return _register(StationPoses(commanded, measured), None, robust, rng)


def register_with_tool(
    tf_base_flange: ArrayLike,
    p_measured: ArrayLike,
    p_flange_tool: ArrayLike | None = None,
    robust: bool = True,
    rng: int | np.random.Generator = 0,
    tool_std: float | None = None,
) -> Registration:
    """Fit the tracker's station and the reflector's position in the flange frame together.

    Parameters
    ----------
    tf_base_flange : (n, 4, 4) array [mm]
        The commanded flange poses, n >= 5, with rotations about at least two axes.
    p_measured : (n, 3) array [mm], tracker frame
        The readings.
    p_flange_tool : (3,) array [mm], flange frame, optional
        An estimate of the tool offset. It adds a start; the result does not depend on it but for `tool_std`.
    robust : bool
        Whether outliers are found and left out.
    rng : int or Generator
        The seed, or source, of the random subsets.
    tool_std : float [mm], optional
        The standard deviation of the estimate in each direction. If the readings leave one direction of station and
        tool open within their noise, it is taken from the estimate, and the hint says so; otherwise it is not used.

    Returns
    -------
    Registration
        The station and the tool in `p_flange_tool`, with a covariance of shape (9, 9).

    Raises
    ------
    DataError
        As for `register`, and if a matrix is not a rigid transform.
    IdentifiabilityError
        If the poses cannot separate station and tool; the message names the directions.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial.transform import Rotation
    >>> rng = np.random.default_rng(0)
    >>> flange = make_transform(Rotation.random(10, rng=rng), rng.uniform(-500, 500, (10, 3)))
    >>> reading = apply_transform(flange, np.array([10.0, 20.0, 150.0])) - [1000, 0, 0]
    >>> register_with_tool(flange, reading).p_flange_tool.round(6)
    array([ 10.,  20., 150.])
    """
    flange = check_transforms("tf_base_flange", tf_base_flange, single=False)
    measured = as_rows("p_measured", p_measured, 3)
    _check_count(len(flange), len(measured), MINIMAL_LINEAR)
    check_units(flange[:, :3, 3], measured, ("m",), tolerance=5.0)  # the tool offset enlarges one of the sets
    guess = None
    if p_flange_tool is not None:
        guess = as_floats("p_flange_tool", p_flange_tool)
        if guess.shape != (3,):
            raise DataError(f"p_flange_tool has shape {guess.shape}, expected (3,)")
        check_finite("p_flange_tool", guess[None])
    known = None if guess is None or tool_std is None else ToolPrior(guess, tool_std)
    return _register(StationPoses(flange[:, :3, 3], measured, flange[:, :3, :3]), guess, robust, rng, known)


def register_known(
    tf_base_tracker: ArrayLike, p_commanded: ArrayLike, p_measured: ArrayLike, robust: bool = True
) -> Registration:
    """Return residuals and outliers for a stated station of the tracker; nothing is fitted.

    Parameters
    ----------
    tf_base_tracker : (4, 4) array [mm]
        The station, taken as exact: its covariance is zero.
    p_commanded : (n, 3) array [mm], base frame
        The commanded positions of the TCP, n >= 3.
    p_measured : (n, 3) array [mm], tracker frame
        The readings.
    robust : bool
        Whether outliers are marked.

    Returns
    -------
    Registration

    Raises
    ------
    DataError
        If shapes are wrong, values are NaN, or there are fewer than 3 points.

    Examples
    --------
    >>> import numpy as np
    >>> p = np.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100.0]])
    >>> register_known(np.eye(4), p, p + [0.1, 0, 0]).residuals[0].round(6)
    array([0.1, 0. , 0. ])
    """
    tf = check_transforms("tf_base_tracker", tf_base_tracker)
    commanded = as_rows("p_commanded", p_commanded, 3)
    measured = as_rows("p_measured", p_measured, 3)
    _check_count(len(commanded), len(measured), MINIMAL)
    residuals = apply_transform(tf, measured) - commanded
    norms = np.linalg.norm(residuals, axis=1)
    floor = _ROUNDING * max(np.abs(commanded).max(), np.abs(measured).max(), np.finfo(float).tiny)
    outliers = norms > OUTLIER_LIMIT * robust_scale(norms, MINIMAL, floor) if robust else np.zeros(len(norms), np.bool_)
    return Registration(
        tf_base_tracker=tf,
        residuals=residuals,
        outliers=outliers,
        covariance=np.zeros((6, 6)),
        noise_std=float(np.sqrt(np.mean(norms[~outliers] ** 2) / 3.0)),
        p_flange_tool=None,
        swapped=np.empty((0, 2), dtype=np.intp),
        hint=write_hint(outliers, np.empty((0, 2), dtype=np.intp)),
    )


def _millimetres(p: FloatArray) -> str:
    return f"({', '.join(f'{value:.3f}' for value in p)}) mm"


def _largest(std: FloatArray) -> str:
    return f"{std.max():.2g} mm"


def _check_count(n_commanded: int, n_measured: int, least: int) -> None:
    if n_commanded != n_measured:
        raise DataError(f"{n_commanded} commanded and {n_measured} measured positions; expected one reading for each")
    if n_commanded < least:
        raise DataError(
            f"{n_commanded} readings are too few to register; expected at least {least} (20 or more recommended)"
        )


def _register(
    poses: StationPoses,
    p_flange_tool: FloatArray | None,
    robust: bool,
    rng: int | np.random.Generator,
    known: ToolPrior | None = None,
) -> Registration:
    floor = _ROUNDING * max(np.abs(poses.p_commanded).max(), np.abs(poses.p_measured).max(), np.finfo(float).tiny)
    station, outliers = _fit(poses, p_flange_tool, robust, floor, rng)
    inliers = poses[~outliers]
    check_identifiable(inliers, station)

    def refit(other: StationPoses) -> float:
        return float(np.median(_fit(other, p_flange_tool, robust, floor, rng)[0].norms(other)))

    norms = station.norms(poses)
    explain_misfit(poses, float(np.median(norms)), refit)
    n_parameters = 6 if poses.rotations is None else 9
    freedom = 3 * len(inliers.p_measured) - n_parameters
    noise_std = float(np.sqrt((norms[~outliers] ** 2).sum() / freedom)) if freedom else 0.0
    limit = OUTLIER_LIMIT * max(noise_std, floor)
    radius = median_radius(poses.p_measured)
    found = open_directions(inliers, station, noise_std, radius)
    if known is None or found.rank < n_parameters - 1:
        check_identifiable(inliers, station, noise_std, limit=radius)
    prior = known if found.names else None
    if prior is not None:
        station = refine_station(poses, np.where(outliers, 0.0, 1.0), station, prior=prior, noise_std=noise_std)
        weak = f"{found.names}: not determined by these poses, taken from the tool of the cell, ± {prior.std:.0f} mm"
    else:
        weak = weak_hint(inliers, station, noise_std)
    swapped = find_swapped(station.tcp(poses), station.measured(poses), outliers, limit)
    return Registration(
        tf_base_tracker=make_transform(station.rotation, station.translation),
        residuals=station.residuals(poses),
        outliers=outliers,
        covariance=covariance(inliers, station, noise_std, prior),
        noise_std=noise_std,
        p_flange_tool=None if poses.rotations is None else station.p_flange_tool,
        swapped=swapped,
        hint="; ".join(filter(None, (write_hint(outliers, swapped), weak))),
    )


def _fit(
    poses: StationPoses, p_flange_tool: FloatArray | None, robust: bool, floor: float, rng: int | np.random.Generator
) -> tuple[Station, BoolArray]:
    """Return the least-squares station and the outliers left out of it (MM-estimation, Yohai 1987, for the latter)."""
    n = len(poses.p_measured)
    station = start(poses, p_flange_tool, robust, np.random.default_rng(rng))
    outliers = np.zeros(n, dtype=np.bool_)
    if robust:
        norms = station.norms(poses)
        for _ in range(_REWEIGHTINGS):
            scale = robust_scale(norms, MINIMAL, floor)
            station = refine_station(poses, tukey_weights(norms, scale), station, steps=2)
            before, norms = norms, station.norms(poses)
            if np.abs(norms - before).max() <= 1e-6 * scale:
                break
        outliers = norms > OUTLIER_LIMIT * robust_scale(norms, MINIMAL, floor)
    return refine_station(poses, np.where(outliers, 0.0, 1.0), station), outliers
