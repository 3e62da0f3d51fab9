"""Verify a predictor on poses that it has not seen (theory, verification).

Errors of poses near each other, on one branch or in one hour are correlated, so an interval from resampling single
poses is too narrow. Whole groups of poses are therefore resampled as well.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._typing import FloatArray
from truepose.errors import DataError, TrueposeError
from truepose.predictors.folds import block_folds, branch_folds
from truepose.robots import Robot
from truepose.verification.accuracy import Accuracy, IntervalCoverage, accuracy, coverage, mean_noise, summary

RP_PER_STD: Final = 2.0 * np.sqrt(2.0 / np.pi) + 3.0 * np.sqrt(3.0 - 8.0 / np.pi)
"""RP of ISO 9283 for isotropic normal scatter, over its standard deviation in each direction."""

_BOOTSTRAPS: Final = 2000
_FEWEST_GROUPS: Final = 10
"""The least number of groups from which an interval is resampled; with fewer it is a matter of luck."""
_BLOCKS: Final = 10
_PER_BLOCK: Final = 6
_TIMES: Final = 4


@dataclass(frozen=True, repr=False)
class HeldOut:
    """The held-out accuracy of a predictor; the result of `held_out`.

    Attributes
    ----------
    accuracy : Accuracy
        The accuracy without and with the predictor.
    coverage : IntervalCoverage, optional
        The check of the predicted standard deviations, if there are any.
    noise_floor : dict
        ``mean_mm``, the mean length of the noise, which is the lower limit of any predictor; ``ratio`` of the mean
        after to it, and ``ratio_interval_95``. Empty if the noise is not known.
    groups : dict
        For each grouping: ``interval_95_mean_mm`` of the mean after, with whole groups resampled (None with fewer than
        ten), and ``parts``, each with ``name``, ``before`` and ``after``.
    """

    accuracy: Accuracy
    coverage: IntervalCoverage | None
    noise_floor: dict[str, Any]
    groups: dict[str, dict[str, Any]]

    def __repr__(self) -> str:
        lines = [repr(self.accuracy)]
        if self.coverage is not None:
            lines.append(f"inside the predicted 95 % intervals: {100 * self.coverage.within_95:.0f} % of components")
        if self.noise_floor:
            mean, ratio = self.noise_floor["mean_mm"], self.noise_floor["ratio"]
            lines.append(f"noise floor: mean {mean:.3f} mm; mean after is {ratio:.2f} times that")
        for name, group in self.groups.items():
            lines.append(words_of_groups(name, group))
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return {
            **self.accuracy.to_dict(),
            **({} if self.coverage is None else {"coverage": asdict(self.coverage)}),
            **({"noise_floor": self.noise_floor} if self.noise_floor else {}),
            "groups": self.groups,
        }


def held_out(
    before: ArrayLike,
    after: ArrayLike,
    std: ArrayLike | None = None,
    *,
    noise: ArrayLike | None = None,
    groups: Mapping[str, ArrayLike] | None = None,
    rng: np.random.Generator | int = 0,
) -> HeldOut:
    """Return the accuracy on held-out poses with intervals, coverage and noise floor.

    Parameters
    ----------
    before, after : (n, 3) arrays [mm]
        The errors without the predictor, and the residuals with it.
    std : (n, 3) array [mm], optional
        The predicted standard deviations of `after`, noise included.
    noise : (n, 3, 3) or (n, 3) array [mm²] or [mm], optional
        The covariances of repeatability and reading together, or their standard deviations in each direction.
    groups : mapping of str to (n,) labels, optional
        The groupings of the poses, see `usual_groups`.
    rng : Generator or int
        The random generator of the bootstrap, or its seed.

    Returns
    -------
    HeldOut

    Raises
    ------
    DataError
        If shapes differ or values are not finite.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> e = rng.normal(size=(100, 3))
    >>> figures = held_out(10 * e, e, np.ones((100, 3)), noise=np.ones((100, 3)))
    >>> round(figures.accuracy.reduction_mean_percent), 0.9 < figures.noise_floor["ratio"] < 1.1
    (90, True)
    """
    figures = accuracy(before, after, rng=rng)
    e, left = np.asarray(before, float), np.asarray(after, float)
    length = np.linalg.norm(left, axis=1)
    known: dict[str, Any] = {}
    if noise is not None:
        floor = float(mean_noise(_covariance(noise, left.shape)).mean())
        if floor > 0.0:
            ends = [end / floor for end in figures.intervals["after_mean_mm"]]
            known = {"mean_mm": floor, "ratio": float(length.mean()) / floor, "ratio_interval_95": ends}
    return HeldOut(
        accuracy=figures,
        coverage=None if std is None else coverage(left, std),
        noise_floor=known,
        groups={name: _grouped(e, left, np.asarray(labels), rng) for name, labels in (groups or {}).items()},
    )


def words_of_groups(name: str, group: Mapping[str, Any]) -> str:
    """Return the interval of the mean from resampling groups in words, or that they are too few for one."""
    if group["interval_95_mean_mm"] is None:
        return f"mean after, {name}: {len(group['parts'])} are too few for an interval; that by pose counts"
    low, high = group["interval_95_mean_mm"]
    return f"mean after, {name} resampled: {low:.3f} to {high:.3f} mm (95 %)"


def usual_groups(
    p_cmd: FloatArray, *, q: FloatArray | None = None, robot: Robot | None = None, time: FloatArray | None = None
) -> dict[str, NDArray[Any]]:
    """Return the groupings that the poses allow: blocks of space, branches of the arm, parts of time.

    Parameters
    ----------
    p_cmd : (n, 3) array [mm], base frame
        The commanded positions.
    q : (n, dof) array [rad], optional
        The joints, for branches.
    robot : Robot, optional
        The nominal robot, for branches.
    time : (n,) array [s], optional
        The times of the readings.

    Returns
    -------
    dict of str to (n,) array
        The labels of each grouping.
    """
    groups: dict[str, NDArray[Any]] = {}
    blocks = min(_BLOCKS, len(p_cmd) // _PER_BLOCK)
    if blocks > 1:
        groups["blocks"] = block_folds(p_cmd, blocks)
    if q is not None and robot is not None:
        with contextlib.suppress(TrueposeError):  # all on one branch, or branches not known for this robot
            groups["branches"] = branch_folds(robot, q)
    if time is not None and blocks > 1 and np.ptp(time) > 0.0:
        rank = np.argsort(np.argsort(time, kind="stable"))
        groups["time"] = rank * _TIMES // len(time)
    return groups


def _covariance(noise: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    given = np.asarray(noise, float)
    if given.shape not in (shape, (*shape, 3)):
        raise DataError(
            f"noise has shape {given.shape}; expected {shape} standard deviations or {(*shape, 3)} covariances"
        )
    return given if given.ndim == 3 else given[..., None] ** 2 * np.eye(3)


def _grouped(
    before: FloatArray, after: FloatArray, labels: NDArray[Any], rng: np.random.Generator | int
) -> dict[str, Any]:
    """Return the figures of each group, and the interval of the mean from resampling whole groups."""
    if labels.shape != after.shape[:1]:
        raise DataError(f"labels have shape {labels.shape}, expected ({len(after)},): one for each pose")
    names, group = np.unique(labels, return_inverse=True)
    interval: list[float] | None = None
    if len(names) >= _FEWEST_GROUPS:
        total, count = np.bincount(group, np.linalg.norm(after, axis=1)), np.bincount(group)
        drawn = np.random.default_rng(rng).integers(0, len(names), size=(_BOOTSTRAPS, len(names)))
        means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
        interval = np.percentile(means, [2.5, 97.5]).tolist()
    parts = [
        {"name": str(name), "before": summary(before[rows]), "after": summary(after[rows])}
        for name, rows in ((name, group == k) for k, name in enumerate(names))
    ]
    return {"interval_95_mean_mm": interval, "parts": parts}
