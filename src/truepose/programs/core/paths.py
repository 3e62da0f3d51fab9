"""Judge the bends that a correction makes in the paths of a program.

The errors of an arm change evenly in space, and so do the corrections of neighbouring targets. If one target stays
nominal between corrected ones, or if the map itself is uneven, the commanded path has a kink that the original does not
have. A path is a row of targets joined by straight, circular or spline motions. It ends at a joint motion, at a target
whose position is not known, and at the end of its routine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RefusedError
from truepose.programs.core.modules import RefusedModules
from truepose.programs.core.outcomes import DONE, Outcomes
from truepose.programs.core.program import IDENTITY, Program
from truepose.programs.core.smoothing import Bends, smoothed
from truepose.programs.core.source import printable

SMALLEST_LIMIT: Final = 0.1
"""The smallest default limit [mm]."""
STANDARD_DEVIATIONS: Final = 4.0
"""The default limit in standard deviations of the corrected targets."""
SLOPE: Final = 0.005
"""Bends below this [mm per mm of spacing] are allowed: the errors of an arm change by some millimetres per metre."""
_BACK: Final = -0.5  # cosine of the turn at a target beyond which the path goes back: the tool stops there
_BLOCK: Final = 1 << 16
_SMOOTHINGS: Final = 3  # a point may be in several paths
_TINY: Final = np.finfo(float).tiny
_SHOWN: Final = 3  # paths that a message names


@dataclass(frozen=True, eq=False)
class Continuity:
    """The changes that a correction makes to the paths through the targets.

    Attributes
    ----------
    bend : (n,) array [mm]
        The distance between the correction of a target and the interpolated correction of its neighbours, the largest
        of its motions. NaN where a target is in no path; this holds for all three arrays.
    direction : (n,) array [deg]
        The change of the turn of the path at the target.
    spacing : (n,) array [mm]
        The change of the distance from the target before.
    limit : float [mm]
        The largest allowed bend.
    slope : float
        The share of the spacing below which a bend is allowed, too.
    smoothed : dict of int to float [mm]
        The targets whose corrections were smoothed along their path, and by how much.
    """

    bend: FloatArray
    direction: FloatArray
    spacing: FloatArray
    limit: float
    slope: float
    smoothed: Mapping[int, float] = field(default_factory=dict)

    @classmethod
    def unknown(cls, n: int) -> Continuity:
        """Return the changes of `n` targets whose corrections are not known."""
        none = np.full(n, np.nan)
        return cls(none, none, none, np.nan, np.nan)

    def summary(self) -> dict[str, Any]:
        """Return the largest changes, None where there is no path, and the number of smoothed targets."""
        largest = {
            "largest_bend_mm": self.bend,
            "largest_change_of_direction_deg": self.direction,
            "largest_change_of_spacing_mm": self.spacing,
        }
        found = {key: float(np.nanmax(v)) if np.isfinite(v).any() else None for key, v in largest.items()}
        most = max(self.smoothed.values(), default=0.0)
        return {**found, "max_bend_mm": self.limit, "smoothed": len(self.smoothed), "largest_smoothing_mm": most}


@dataclass(frozen=True, eq=False)
class Kink:
    """A bend beyond the limit.

    Attributes
    ----------
    target : int
        The index of the target.
    bend : float [mm]
        The bend at the target.
    path : (k,) array of int
        The targets of its path.
    """

    target: int
    bend: float
    path: IntArray


class Paths:
    """The paths of a program.

    Parameters
    ----------
    program : Program
        The program.
    outcomes : Outcomes
        The outcomes, with the changes of targets in their own frames in `after`.
    limit : float [mm], optional
        The largest allowed bend. Default: four times the RMS standard deviation of the corrected targets, at least
        0.1 mm. With the default, a bend that is small for the spacing of its targets is allowed, too.
    """

    def __init__(self, program: Program, outcomes: Outcomes, limit: float | None = None) -> None:
        self._n, self._motions = len(program.targets), program.targets.motions
        self._p, self._change, self._held = _in_base(program, outcomes)
        self.limit, self._slope = limit or default_limit(outcomes), 0.0 if limit else SLOPE
        self._smoothed: dict[int, float] = {}

    @property
    def origin(self) -> str:
        """The origin of the default limit, for the record."""
        least = f"at least {SMALLEST_LIMIT:g} mm"
        return f"{STANDARD_DEVIATIONS:g} times the RMS standard deviation of the corrected targets, {least}"

    def segments(self, outcomes: Outcomes, longest: float) -> IntArray:
        """Return the targets at the ends of straight motions that are longer [mm] and lead to or from a correction.

        Motions from or to joint targets and derived targets are left out, and those of arcs. (s, 2).
        """
        row, path = self._rows(outcomes.moved)
        a, b = row[:-1], row[1:]
        usable = np.ones(self._n, bool)
        usable[list(outcomes.program.targets.follows)] = False
        if outcomes.joints is not None:
            usable &= np.isnan(outcomes.joints.p[:, 0])
        curved = np.zeros(self._n, bool)
        curved[sorted({i for circle in outcomes.program.circles for i in circle})] = True
        wanted = (path[1:] == path[:-1]) & usable[a] & usable[b] & ~curved[b]
        wanted &= outcomes.corrected[a] | outcomes.corrected[b]
        wanted &= np.linalg.norm(self._p[b] - self._p[a], axis=1) > longest
        return np.unique(np.column_stack([a, b])[wanted], axis=0)

    def settle(self, outcomes: Outcomes, on_guard: str, modules: RefusedModules | None = None) -> Continuity:
        """Smooth bends beyond the limit; refuse those that remain, or leave the whole paths that have one as they are.

        A point of such a path may be in other paths, which are then judged again. With `modules`, only the modules of
        such a path are refused.

        Raises
        ------
        RefusedError
            If a path bends too much and `on_guard` is ``refuse``.
        """
        for _ in range(_SMOOTHINGS):
            smoothed = [self._smooth(outcomes, kink) for kink in self.judge(outcomes.moved)[1]]
            if not any(smoothed):
                break
        while True:
            continuity, kinks = self.judge(outcomes.moved)
            if not kinks:
                self._tell_smoothed(outcomes)
                return continuity
            if on_guard == "refuse" and modules is not None:
                for kink in kinks:
                    modules.leave(dict.fromkeys(kink.path.tolist(), self._words(outcomes, kink)))
                continue
            if on_guard == "refuse":
                raise RefusedError(self._told(outcomes, kinks))
            for kink in kinks:
                outcomes.leave(kink.path, f"its whole path stays nominal: {self._words(outcomes, kink)}")
            outcomes.leave_circles()

    def _smooth(self, outcomes: Outcomes, kink: Kink) -> bool:
        """Smooth the corrections of a path within their uncertainty; return whether no bend is left in it."""
        row, path = self._rows(outcomes.moved)
        seq = row[path == path[np.flatnonzero(row == kink.target)[0]]]
        rows, place = np.unique(seq, return_inverse=True)
        moved = outcomes.moved[rows]
        change = np.where(moved[:, None], self._change[rows], 0.0)
        corner = _corners(self._p[seq], np.zeros(len(seq), np.int64))
        limit = np.maximum(self.limit, self._slope * corner.along)
        bends = Bends(place[corner.at], place[corner.at - 1], place[corner.at + 1], corner.share, limit)
        free = outcomes.code[rows] == DONE.index("correct")  # one that was clipped is at its own limit
        free &= ~np.isin(rows, list(outcomes.differences))  # compared with those of positions that share them
        free &= ~self._held[rows]  # their numbers are not the place on the part
        if outcomes.joints is not None:
            free &= np.isnan(outcomes.joints.p[rows, 0])  # their digits are joints
        found = smoothed(change, free, np.linalg.norm(outcomes.std[rows], axis=1), bends)
        if found is None:
            return False
        self._change[rows[free]] = found[free]
        for i, by in zip(rows[free].tolist(), (found - change)[free], strict=True):
            target = outcomes.program.targets[i]
            assert target.tf_base_frame is not None  # of a corrected target
            outcomes.after[i, :3] += target.tf_base_frame[:3, :3].T @ by
            self._smoothed[i] = self._smoothed.get(i, 0.0) + float(np.linalg.norm(by))
        return True

    def _tell_smoothed(self, outcomes: Outcomes) -> None:
        """Note the smoothing of each target that is still corrected."""
        for i, size in self._smoothed.items():
            if outcomes.corrected[i]:
                told = f"smoothed along its path by {size:.3f} mm"
                outcomes.notes[i] = "; ".join(filter(None, [outcomes.notes.get(i, ""), told]))

    def _words(self, outcomes: Outcomes, kink: Kink) -> str:
        target = outcomes.program.targets[kink.target]
        return (
            f"the correction would bend the path by {kink.bend:.3f} mm at {target.name} (line {target.line}), "
            f"limit {self.limit:.3f} mm"
        )

    def _told(self, outcomes: Outcomes, kinks: list[Kink]) -> str:
        places = [f"{outcomes.program.targets[k.target].where}: {self._words(outcomes, k)}" for k in kinks[:_SHOWN]]
        more = f" (and {len(kinks) - _SHOWN} more paths)" if len(kinks) > _SHOWN else ""
        return printable(
            f'{"; ".join(places)}{more}; leave such paths as they are with on_guard "skip", or state max_bend_mm in '
            "[correction]"
        )

    def judge(self, corrected: BoolArray) -> tuple[Continuity, list[Kink]]:
        """Return the changes of the paths by the corrections, and the worst bend of each path that bends too much."""
        bend, direction, spacing = np.full((3, self._n), np.nan)
        row, path = self._rows(corrected)
        worst: dict[int, tuple[float, int]] = {}
        for first in range(0, len(row), _BLOCK):
            here = slice(max(0, first - 1), first + _BLOCK + 1)  # with the neighbours
            seq = row[here]
            change = np.where(corrected[seq][:, None], self._change[seq], 0.0)
            measured = _measure(self._p[seq], change, path[here])
            at, size, turn, spaced, along = measured
            np.fmax.at(spacing, seq[1:], spaced)
            np.fmax.at(bend, seq[at], size)
            np.fmax.at(direction, seq[at], turn)
            for k in np.flatnonzero(size > np.maximum(self.limit, self._slope * along)).tolist():
                of = int(path[here][at[k]])
                worst[of] = max(worst.get(of, (0.0, 0)), (float(size[k]), int(seq[at[k]])))
        kinks = [Kink(target, size, np.unique(row[path == of])) for of, (size, target) in sorted(worst.items())]
        smoothed = {i: size for i, size in self._smoothed.items() if corrected[i]}
        return Continuity(bend, direction, spacing, self.limit, self._slope, smoothed), kinks

    def _rows(self, corrected: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the targets along all paths, and for each the number of its path; standing still counts once."""
        row, on_path, _ = self._motions
        known = np.isfinite(self._p[row, 0]) if len(row) else np.empty(0, bool)
        joined = on_path & known
        joined[1:] &= known[:-1] & (self._held[row[1:]] == self._held[row[:-1]])
        path = np.cumsum(~joined)
        same = np.zeros(len(row), bool)
        same[1:] = joined[1:] & (row[1:] == row[:-1])
        twins = np.flatnonzero(joined[1:] & ~same[1:] & (self._p[row[1:]] == self._p[row[:-1]]).all(axis=1)) + 1
        change = [np.where(corrected[k][:, None], self._change[k], 0.0) for k in (row[twins], row[twins - 1])]
        same[twins] = (change[0] == change[1]).all(axis=1)
        keep = known & ~same
        return row[keep], path[keep]


def default_limit(outcomes: Outcomes) -> float:
    """Return the largest bend [mm] that the predicted standard deviations of the corrected targets explain."""
    std = outcomes.std[outcomes.corrected]
    std = std[np.isfinite(std).all(axis=1)]
    rms = float(np.sqrt(np.einsum("ij,ij->", std, std) / max(len(std), 1)))
    return max(SMALLEST_LIMIT, STANDARD_DEVIATIONS * rms)


def _in_base(program: Program, outcomes: Outcomes) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return positions and changes of all targets in the base frame, (n, 3) [mm], and where a part is held, (n,).

    Positions are NaN where they are not known. Those of a tool on a held part are in the frame of the flange, in which
    the controller interpolates.
    """
    p, change = np.full((2, len(program.targets), 3), np.nan)
    held = np.zeros(len(program.targets), np.bool_)
    for first, columns in program.targets.chunks():
        here = slice(first, first + len(columns))
        tf = columns.tf_base_frame()
        p[here] = np.einsum("nij,nj->ni", tf[:, :3, :3], columns.values[:, :3]) + tf[:, :3, 3]
        change[here] = np.einsum("nij,nj->ni", tf[:, :3, :3], outcomes.after[here, :3])
        if len(on_parts := np.flatnonzero(columns.held & np.isfinite(columns.values).all(axis=1))):
            some, rows = columns.take(on_parts), first + on_parts
            on_part = some.tf_flange_tool(IDENTITY)
            moved = np.einsum("nji,nj->ni", some.base_to_frame(), outcomes.after[rows, :3])  # of the flange, base frame
            turn = on_part[:, :3, :3] @ np.swapaxes(some.poses_base()[:, :3, :3], 1, 2)
            held[rows], p[rows], change[rows] = True, on_part[:, :3, 3], -np.einsum("nij,nj->ni", turn, moved)
    if outcomes.joints is not None:
        joints = np.isfinite(outcomes.joints.p[:, 0])
        p[joints], change[joints] = outcomes.joints.p[joints], outcomes.joints.change[joints]
    for i, follow in program.targets.follows.items():
        if follow.shift is None:
            continue  # one of several positions
        (j,) = follow.sources
        source = program.targets[j]
        if source.rotation is not None and source.tf_base_frame is not None:
            p[i] = p[j] + source.tf_base_frame[:3, :3] @ follow.shift.vectors(source.rotation)[0][0]
            change[i] = change[j]
    return p, change, held


def _measure(
    p: FloatArray, change: FloatArray, path: IntArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Measure consecutive targets (m, 3) [mm].

    Returns
    -------
    at : (k,) array of int
        ProgramTargets with a neighbour on both sides in their path, but for those where the path goes back.
    bend, turn : (k,) arrays [mm], [deg]
        At these.
    spacing : (m − 1,) array [mm]
        Change of every distance; NaN between two paths.
    along : (k,) array [mm]
        Harmonic mean of the distances to both neighbours.
    """
    corner = _corners(p, path)
    changed = np.diff(p + change, axis=0)
    after, at = np.linalg.norm(changed, axis=1), corner.at - 1
    spacing = np.where(path[1:] == path[:-1], np.abs(after - corner.before), np.nan)
    u, v = (d / np.maximum(size, _TINY)[:, None] for d, size in ((np.diff(p, axis=0), corner.before), (changed, after)))
    between = change[at] + corner.share[:, None] * (change[at + 2] - change[at])
    bend = np.linalg.norm(change[at + 1] - between, axis=1)
    turn = np.linalg.norm((v[1:] - v[:-1])[at] - (u[1:] - u[:-1])[at], axis=1)
    turn = np.rad2deg(2.0 * np.arcsin(np.minimum(turn / 2.0, 1.0)))
    return corner.at, bend, turn, spacing, corner.along


class _Corners(NamedTuple):
    """Targets (k,) with a neighbour on both sides in their path, but for those where the path goes back.

    `share` is the place of each between its neighbours, `along` the harmonic mean of the distances to them [mm];
    `before` (m − 1,) are all distances [mm].
    """

    at: IntArray
    share: FloatArray
    along: FloatArray
    before: FloatArray


def _corners(p: FloatArray, path: IntArray) -> _Corners:
    """Return the corners of consecutive targets (m, 3) [mm], whose paths have the numbers (m,)."""
    step = np.diff(p, axis=0)
    before = np.linalg.norm(step, axis=1)
    one_path = path[1:] == path[:-1]
    u = step / np.maximum(before, _TINY)[:, None]
    goes_back = np.einsum("ij,ij->i", u[:-1], u[1:]) < _BACK
    at = np.flatnonzero(one_path[:-1] & one_path[1:] & ~goes_back)
    h1, h2 = before[at], before[at + 1]
    both = np.maximum(h1 + h2, _TINY)
    return _Corners(at + 1, np.where(h1 + h2 > 0, h1 / both, 0.5), 2.0 * h1 * h2 / both, before)
