"""Match readings with a plan; missing, repeated, swapped and gross readings are found and named."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.transforms import apply_transform
from truepose.samples import Mask, Poses, Samples, check, check_turns, set_aside
from truepose.trackers.assignment import Assignment, assign
from truepose.trackers.by_name import BY_NAME, match_names
from truepose.trackers.readings import Readings
from truepose.trackers.station import describe_move

_REPEAT_MM: Final = 1.0
_FEWEST_REPEATS: Final = 5  # for an estimate of the standard deviation
_UNITS: Final = {1e-3: ("metres", "m"), 1 / 25.4: ("inches", "in"), 0.1: ("centimetres", "cm")}


@dataclass(frozen=True)
class ImportSummary:
    """The summary of an import.

    Attributes
    ----------
    layout, unit, frame, source : str
        The layout, the unit of length, the frame and the path of the file.
    readings, plan, samples : int
        The numbers of readings in the file, points of the plan, and resulting samples.
    averaged : int
        The number of repeated readings, which were averaged.
    missing, reordered, outliers : tuple of int
        The rows of the plan, from 0, without a reading, read in another order, and with a residual outside the gate
        (kept).
    scatter_mm : float, optional
        The pooled standard deviation of repeats per axis.
    median_mm, max_mm : float [mm]
        The residuals after a rigid registration, including the error of the tool, which is not fitted here.
    notes : tuple of str
        Further sentences on the file.
    missing_points, reordered_points, outlier_points : tuple of str
        The points of `missing`, `reordered` and `outliers` as messages name them: "P12 (line 13)".
    """

    layout: str
    unit: str
    frame: str
    source: str
    readings: int
    plan: int
    samples: int
    averaged: int
    missing: tuple[int, ...]
    reordered: tuple[int, ...]
    outliers: tuple[int, ...]
    scatter_mm: float | None
    median_mm: float
    max_mm: float
    notes: tuple[str, ...] = ()
    missing_points: tuple[str, ...] = ()
    reordered_points: tuple[str, ...] = ()
    outlier_points: tuple[str, ...] = ()

    def sentences(self) -> list[str]:
        """Return the summary as sentences, the most important first."""
        frame = f", frame {self.frame}" if self.frame else ""
        unit = "inches" if self.unit == "in" else self.unit
        lines = [
            f"{self.source}: {self.layout}, lengths in {unit}{frame}.",
            f"{self.readings} readings for {self.plan} points of the plan gave {self.samples} samples.",
        ]
        if self.averaged:
            scatter = (
                "" if self.scatter_mm is None else f"; standard deviation of repeats {self.scatter_mm:.3g} mm per axis"
            )
            repeat = "reading repeats another and was" if self.averaged == 1 else "readings repeat another and were"
            lines.append(f"{self.averaged} {repeat} averaged with it{scatter}.")
        for points, what in (
            (self.missing_points, "Points of the plan without a reading, left out"),
            (self.reordered_points, "Points of the plan read in another order, and reordered"),
            (
                self.outlier_points,
                "Points of the plan whose readings lie far from the expected positions, to be checked",
            ),
        ):
            if points:
                lines.append(f"{what}: {', '.join(points)}.")
        residuals = f"median {self.median_mm:.3f} mm, at most {self.max_mm:.3f} mm"
        lines += self.notes
        lines.append(f"Residuals after rigid registration, tool not fitted: {residuals}.")
        return lines


def match(
    readings: Readings,
    plan: Poses,
    *,
    reorder: bool = False,
    missing: bool = False,
    two_stations: bool = False,
    repeat_mm: float = _REPEAT_MM,
    mask: Mask | None = None,
) -> tuple[Samples, ImportSummary]:
    """Match readings with the plan of their measurement: by the names of points where both have them, else by position.

    Parameters
    ----------
    readings : Readings
        The readings.
    plan : Poses
        The plan, with commanded positions.
    reorder : bool
        Whether points may have been read in another order than planned; not needed where they are matched by name.
    missing : bool
        Whether points may lack a reading; they are left out.
    two_stations : bool
        Whether the readings may come from two tracker stations.
    repeat_mm : float [mm]
        The largest distance of repeated readings of one point; they are averaged, and their standard deviation is kept
        as `p_std` unless the file states one.
    mask : Mask, optional
        The points to leave out later, which are not checked and may lack a reading.

    Returns
    -------
    samples : Samples
        The samples in the order of the plan, with the masked ones.
    summary : ImportSummary
        The summary of the import.

    Raises
    ------
    DataError
        If readings are missing or swapped without permission, if some match no point, if one name stands for distant
        readings, or if the file does not match the plan; with the points and lines.
    """
    if plan.p_cmd is None:
        raise plan.error("has no commanded positions (x_cmd_mm …); compute them from the joints and the robot first")
    count = f"{int((~readings.missing).sum())} readings for {len(plan)} points of the plan"
    found, move, note = _assign(readings, plan, plan.p_cmd, count, two_stations, repeat_mm)
    absent = found.reading < 0
    moved = np.zeros_like(absent) if note == BY_NAME else _moved(found)
    extra = (found.owner < 0) & ~readings.missing
    if extra.any():
        strangers = f"{readings.points(extra)} fit{'s' if extra.sum() == 1 else ''} no point of the plan"
        raise DataError(f"{readings.source}: {count}; {strangers}; remove, or complete the plan")
    lacking = absent if mask is None else absent & (mask.of(plan) == "")
    if lacking.any() and not missing:
        remedy = "measure again, or leave out with --missing (missing=True in Python)"
        raise DataError(
            f"{readings.source}: {count}; without a reading: {plan.rows(lacking)} of {plan.source}; {remedy}"
        )
    if moved.any() and not reorder:
        described = _describe_moved(found, readings, plan, moved)
        remedy = "correct the file, or reorder with --reorder (reorder=True in Python)"
        raise DataError(f"{readings.source}: {described}; {remedy}")
    swapped = _swapped_names(found, readings, plan.p_cmd) if note == BY_NAME else []
    samples, scatter, averaged = _join(readings, plan[~absent], found.owner, np.flatnonzero(~absent))
    counted = samples if mask is None else set_aside(samples, mask.of(samples, plan))
    check(counted)
    check_turns(counted)
    rows = np.asarray(plan.row)
    summary = ImportSummary(
        layout=readings.layout,
        unit=readings.unit,
        frame=readings.frame,
        source=readings.source,
        readings=len(readings),
        plan=len(plan),
        samples=len(samples),
        averaged=averaged,
        missing=tuple(rows[absent].tolist()),
        reordered=tuple(rows[moved].tolist()),
        outliers=tuple(rows[found.outlier].tolist()),
        scatter_mm=scatter,
        median_mm=float(np.nanmedian(found.residual)),
        max_mm=float(np.nanmax(found.residual)),
        notes=(*readings.notes, *filter(None, [note, f"It seems that {move}." if move else ""]), *swapped),
        missing_points=_named(plan, absent),
        reordered_points=_named(plan, moved),
        outlier_points=_named(plan, found.outlier),
    )
    return samples, summary


def _swapped_names(found: Assignment, readings: Readings, p_plan: FloatArray) -> list[str]:
    """Return a sentence for each two readings far from their points, each of which lies where the other should."""
    far = np.flatnonzero(found.outlier & (found.reading >= 0))
    p = apply_transform(found.tf_base_tracker, readings.p[found.reading[far]])
    fits = np.linalg.norm(p[:, None] - p_plan[far], axis=2) <= found.gate
    pairs = found.reading[far][np.argwhere(np.triu(fits & fits.T, 1))]
    return [f"The names of {readings.points(pair)} of {readings.source} seem to be swapped." for pair in pairs]


def _named(plan: Poses, which: BoolArray) -> tuple[str, ...]:
    return tuple(plan.rows(np.array([i])).removeprefix("point ") for i in np.flatnonzero(which))


def _assign(
    readings: Readings, plan: Poses, p_cmd: FloatArray, count: str, two_stations: bool, repeat_mm: float
) -> tuple[Assignment, str, str]:
    """Return the assignment of readings to points, the description of a move of the tracker, and a note on names."""
    p_read = np.where(readings.missing[:, None], np.nan, readings.p)
    if np.isfinite(p_read).all(axis=1).sum() < 3 or len(plan) < 3:
        raise DataError(f"{readings.source}: {count}; at least 3 are required to match them by distances")
    _refuse_other_units(readings, p_cmd)
    named = match_names(readings, plan, p_cmd, repeat_mm)
    found, move = named.assignment, ""
    if found is None:
        move = describe_move(readings, plan, None, repeat_mm) if len(readings) == len(plan) else ""
        _refuse_move(readings, move, two_stations)
        try:
            found = assign(p_cmd, p_read, repeat_mm)
        except DataError as error:
            raise _stranger(readings, plan, str(error)) from None
    move = move or describe_move(readings, plan, found, repeat_mm)
    _refuse_move(readings, move, two_stations)
    fitting = (found.reading >= 0) & ~found.outlier
    spread = float(np.sqrt(p_cmd.var(axis=0).sum()))
    if fitting.sum() < 0.5 * min(len(plan), (~readings.missing).sum()) or found.gate > max(spread, 2.0):
        raise _stranger(readings, plan, f"only {int(fitting.sum())} fit a point under any one registration")
    return found, move, named.note


def _refuse_move(readings: Readings, move: str, allowed: bool) -> None:
    if move and not allowed:
        remedy = "import the readings before and after the move as two files, each with its points of the plan"
        allow = "pass --two-stations (two_stations=True in Python) if the tracker did not move"
        raise DataError(f"{readings.source}: {move}; {remedy}, or {allow}")


def _refuse_other_units(readings: Readings, p_cmd: FloatArray) -> None:
    """Refuse readings whose mutual distances are those of the plan in another unit."""
    p = readings.p[~readings.missing]
    commanded, measured = (float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1))) for x in (p_cmd, p))
    for factor, (unit, short) in _UNITS.items():
        if commanded > 0 and abs(measured / commanded / factor - 1.0) < 0.2:
            option = f'pass --unit {short} (unit="{short}" in Python)'
            message = f"the readings spread {1 / factor:g} times less than the plan; {unit}? If so, {option}"
            raise DataError(f"{readings.source}: {message}")


def _stranger(readings: Readings, plan: Poses, why: str) -> DataError:
    """Return the error for readings that do not match the plan."""
    count = int((~readings.missing).sum())
    if count >= 2 * len(plan) and count % len(plan) == 0:
        why = f"{count // len(plan)} for each point, and no repeats; several reflectors per pose?"
        why += " State their positions on the tool with --reflectors, or which to keep with --keep"
    else:
        why += "; is it this plan, in this order, and did the tracker stand still?"
    return DataError(f"{readings.source}: {count} readings for {len(plan)} points of the plan: {why}")


def _moved(found: Assignment) -> BoolArray:
    """Return the rows read out of order: the smallest set whose removal restores the order, and their swap partners."""
    moved = np.zeros(len(found.reading), dtype=np.bool_)
    rows = np.flatnonzero((found.reading >= 0) & ~found.outlier)
    rank = np.argsort(np.argsort(found.reading[rows]))
    out = np.setdiff1d(np.flatnonzero(rank != np.arange(len(rows))), _longest_increasing(rank))
    partner = rank[out]
    moved[rows[out]] = True
    moved[rows[partner[rank[partner] == out]]] = True  # of two swapped neighbours only one is out of order
    return moved


def _longest_increasing(rank: IntArray) -> list[int]:
    """Return the places of a longest increasing subsequence (Fredman 1975, Discrete Math. 11: patience sorting)."""
    tops: list[int] = []  # the smallest value that ends a subsequence of each length, and its place
    places: list[int] = []
    before = [-1] * len(rank)
    for place, value in enumerate(rank.tolist()):
        length = bisect_left(tops, value)
        before[place] = places[length - 1] if length else -1
        tops[length : length + 1], places[length : length + 1] = [value], [place]
    chain = [places[-1]] if places else []
    while chain and before[chain[-1]] >= 0:
        chain.append(before[chain[-1]])
    return chain[::-1]


def _describe_moved(found: Assignment, readings: Readings, plan: Poses, moved: BoolArray) -> str:
    """Describe the rows read out of order with their lines; for two swapped rows, with the residuals of both orders."""
    assert plan.p_cmd is not None
    rows = np.flatnonzero(moved)
    lines = f"read in {readings.lines(found.reading[rows])}"
    if len(rows) != 2:
        return f"{plan.rows(rows)} of {plan.source} {'was' if len(rows) == 1 else 'were'} read out of order ({lines})"
    p_base = apply_transform(found.tf_base_tracker, readings.p[found.reading[rows[::-1]]])
    as_read = np.linalg.norm(p_base - plan.p_cmd[rows], axis=1).max()
    exchanged = found.residual[rows].max()
    found_at = f"{lines}; residual {as_read:.4g} mm as read, {exchanged:.3g} mm exchanged"
    return f"{plan.rows(rows)} of {plan.source} are swapped ({found_at})"


def _join(readings: Readings, plan: Poses, owner: IntArray, rows: IntArray) -> tuple[Samples, float | None, int]:
    """Average the readings of each plan row; return the samples, the pooled scatter and the number of repeats."""
    used = np.flatnonzero(owner >= 0)
    group = np.searchsorted(rows, owner[used])
    count = np.bincount(group, minlength=len(plan))
    averaged = int((count - 1).sum())
    p = _mean(readings.p[used], group, count)
    variance = ((readings.p[used] - p[group]) ** 2).sum(axis=0) / averaged if averaged else np.zeros(3)
    first = used[np.unique(group, return_index=True)[1]]
    p_std = None
    if readings.p_std is not None:
        p_std = np.sqrt(_mean(readings.p_std[used] ** 2, group, count) / count[:, None])
    elif averaged >= _FEWEST_REPEATS:
        p_std = np.sqrt(variance / count[:, None])
    optional: dict[str, Any] = {}
    if readings.rotation is not None:
        optional["rotation_meas"] = _mean_rotation(readings.rotation[used], group, count)
    if readings.rotation_std is not None:
        optional["rotation_std"] = np.sqrt(_mean(readings.rotation_std[used] ** 2, group, count) / count[:, None])
    if readings.time is not None:
        optional["time"] = _mean(readings.time[used, None], group, count)[:, 0]
    commanded = {name: getattr(plan, name) for name in plan.columns()} | {"line": readings.line[first]}
    if plan.name is None and readings.name is not None and len(set(readings.name[first])) == len(plan):
        commanded["name"] = readings.name[first]
    scatter = float(np.sqrt(variance.mean())) if averaged else None
    return Samples(p_meas=p, p_std=p_std, source=readings.source, **commanded, **optional), scatter, averaged


def _mean(values: FloatArray, group: IntArray, count: IntArray) -> FloatArray:
    total = np.zeros((len(count), values.shape[1]))
    np.add.at(total, group, values)
    mean: FloatArray = total / count[:, None]
    return mean


def _mean_rotation(rotation: Rotation, group: IntArray, count: IntArray) -> Rotation:
    """Average quaternions of equal sign: exact to second order in the scatter, which is far below a degree."""
    quaternion = rotation.as_quat()
    first = np.zeros((len(count), 4))
    first[group[::-1]] = quaternion[::-1]
    sign = np.where(np.einsum("ni,ni->n", quaternion, first[group]) < 0, -1.0, 1.0)
    return Rotation.from_quat(_mean(sign[:, None] * quaternion, group, count))
