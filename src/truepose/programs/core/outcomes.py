"""The outcomes of a program's targets as columns, and the corrected bytes."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RefusedError
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.digits import written
from truepose.programs.core.joint_digits import written_joints
from truepose.programs.core.joint_targets import JointOutcomes
from truepose.programs.core.orientations import DEGREES, STEPS, count
from truepose.programs.core.program import Program, linked
from truepose.programs.core.source import Source, Span, apply_patches
from truepose.programs.core.target import Target

DONE: Final = ("skip", "correct", "clip", "refuse", "below uncertainty")
"""Verdicts of outcomes by their codes."""
_CORRECTED: Final = (1, 2)
_FOLLOWS: Final = ": gets the correction of that point"
_GAP: Final = 1 << 16
"""Number of bytes without a correction that are a piece of their own."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The outcome of a target.

    Attributes
    ----------
    target : Target
        The target of the original program.
    verdict : {"correct", "clip", "skip", "below uncertainty"}
        The verdict on it.
    reason : str
        The reason of the verdict; empty where it is ``correct``.
    p_after : (3,) array [mm], the target's own frame
        The position that is written; NaN where the target has none.
    angles_after : (k,) array, the controller's angles
        The orientation that is written; NaN where the target has none.
    e, std : (3,) arrays [mm], base frame
        The predicted error at the command and its standard deviation; NaN where nothing was predicted.
    joints_after : (k,) array [the controller's unit]
        The joints that are written; NaN where none are.
    remaining : float [mm]
        The distance between the position of the written joints and the wanted one; NaN where no joints are written.
    """

    target: Target
    verdict: str
    reason: str
    p_after: FloatArray
    angles_after: FloatArray
    e: FloatArray
    std: FloatArray
    joints_after: FloatArray
    remaining: float

    @property
    def name(self) -> str:
        """The name of the target."""
        return self.target.name

    @property
    def line(self) -> int:
        """The line of the target."""
        return self.target.line

    @property
    def where(self) -> str:
        """The file and line of the target."""
        return self.target.where

    @property
    def p_before(self) -> FloatArray:
        """Position in the target's own frame, (3,) [mm]; NaN where it has none, as a joint target."""
        return self.target.p

    @property
    def correction(self) -> FloatArray:
        """The correction, (3,) [mm], the target's own frame."""
        return self.p_after - self.p_before


@dataclass(frozen=True, eq=False, repr=False)
class Outcomes(Sequence[Outcome]):
    """The outcomes of a program's targets.

    Attributes
    ----------
    program : Program
        The original program.
    code : (n,) array of int
        The verdicts by their places in `DONE`.
    after : (n, 3 or 3 + k) array [mm; the controller's angles], each target's own frame
        The positions, or positions and orientations, that are written; NaN where a target is not corrected.
    e, std : (n, 3) arrays [mm], base frame
        The predicted errors and their standard deviations; NaN where nothing was predicted.
    why : dict of int to str
        The reasons that the program itself does not give.
    joints : JointOutcomes, optional
        The outcomes of joint targets; None where none is to be corrected.
    differences : dict of int to float [mm]
        The largest difference between the correction of a target and those that the map gives at its derived positions
        and within the tolerance of its frame, where it has such.
    notes : dict of int to str
        What the correction of a target assumes, where it assumes something.
    """

    program: Program
    code: NDArray[np.int8]
    after: FloatArray
    e: FloatArray
    std: FloatArray
    why: dict[int, str] = field(default_factory=dict)
    joints: JointOutcomes | None = None
    differences: dict[int, float] = field(default_factory=dict)
    notes: dict[int, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {verdict}" for k, verdict in enumerate(DONE) if (n := int((self.code == k).sum())))
        return f"<Outcomes of {self.program.path}: {counts or 'no targets'}>"

    @classmethod
    def none(cls, program: Program, width: int = 3) -> Outcomes:
        """Return the outcomes before any correction; `width` numbers of each target may change."""
        n = len(program.targets)
        after, e, std = (np.full((n, columns), np.nan) for columns in (width, 3, 3))
        joints = JointOutcomes.none(n) if program.targets.corrects_joints else None
        return cls(program, np.zeros(n, np.int8), after, e, std, joints=joints)

    def __len__(self) -> int:
        return len(self.code)

    @overload
    def __getitem__(self, i: int) -> Outcome: ...
    @overload
    def __getitem__(self, i: slice) -> list[Outcome]: ...
    def __getitem__(self, i: int | slice) -> Outcome | list[Outcome]:
        if isinstance(i, slice):
            return [self[k] for k in range(*i.indices(len(self)))]
        target = self.program.targets[i]
        return self._outcome(i if i >= 0 else i + len(self), target)

    def __iter__(self) -> Iterator[Outcome]:
        for i, target in enumerate(self.program.targets):
            yield self._outcome(i, target)

    def _outcome(self, i: int, target: Target) -> Outcome:
        angles = np.full(count(target.controller), np.nan)
        before = np.concatenate([target.p, angles if target.angles is None else target.angles])
        after = np.where(np.isnan(row := self.after[i]), before[: len(row)], row)
        after = np.concatenate([after, before[len(row) :]])
        reason = self.why.get(i, target.reason)
        joints, remaining = np.full(len(target.joints or ()), np.nan), math.nan
        if self.joints is not None:
            joints, remaining = self.joints.after[i, : len(joints)], float(self.joints.remaining[i])
        found = (after[:3], after[3:], self.e[i], self.std[i], joints, remaining)
        return Outcome(target, DONE[self.code[i]], reason, *found)

    @property
    def corrected(self) -> BoolArray:
        """Whether each target is corrected, (n,)."""
        return np.isin(self.code, _CORRECTED)

    @property
    def moved(self) -> BoolArray:
        """Whether each target is corrected, or follows others that all are, (n,)."""
        moved = self.corrected
        for i, follow in self.program.targets.follows.items():
            moved[i] = all(DONE[self.code[j]] in ("correct", "clip") for j in follow.sources)
        return moved

    def leave(self, rows: IntArray, why: str) -> None:
        """Leave the corrected targets of some rows, and those that some of them follow, as they are, with a reason."""
        if follows := self.program.targets.follows:
            more = [j for i in rows.tolist() if i in follows for j in follows[i].sources]
            rows = np.concatenate([rows, np.array(more, np.int64)])
        for i in rows[self.corrected[rows]].tolist():
            self.code[i], self.after[i], self.why[i] = 0, 0.0, why

    def leave_circles(self) -> None:
        """Leave circles as they are where one of their points is not corrected."""
        corrected, circles = self.corrected, self.program.circles
        left_out = [i for i in sorted({i for circle in circles for i in circle}) if not corrected[i]]
        for j, i in linked(circles, left_out).items():
            self.code[j], self.after[j] = 0, 0.0
            self.why[j] = f"its circle's other point {self.program.targets[i].name} is not corrected"

    def tell_followers(self) -> None:
        """State of each target that follows others whether it gets their correction."""
        moved, targets = self.moved, self.program.targets
        for i, follow in targets.follows.items():
            names = ", ".join(dict.fromkeys(targets[j].name for j in follow.sources))
            if moved[i]:
                self.why[i] = f"derived from {names}{_FOLLOWS}"
                continue
            j = next(j for j in follow.sources if DONE[self.code[j]] not in ("correct", "clip"))
            cause = targets[j]
            reason = self.why.get(j, cause.reason)
            self.why[i] = f"derived from {cause.name} (line {cause.line}), which is not corrected: {reason}"

    def summary(self) -> dict[str, Any]:
        """Return the counts of the verdicts, and the largest correction and standard deviation [mm]."""
        skipped, correct, clipped, refused, below = (int(np.count_nonzero(self.code == k)) for k in range(len(DONE)))
        following = int(np.count_nonzero(self.moved & ~self.corrected))
        correction = std = 0.0
        for first, columns in self.program.targets.chunks():  # a million rows are not copied
            here = slice(first, first + len(columns))
            moved = self.after[here, :3] - columns.values[:, :3]
            if self.joints is not None:
                moved = np.where(np.isfinite(moved), moved, self.joints.change[here])
            correction = max(correction, _longest(moved[np.isfinite(moved).all(axis=1)]))
            std = max(std, _longest(self.std[here][np.isin(self.code[here], _CORRECTED)]))
        return {
            "targets": len(self),
            "corrected": correct + clipped,
            "clipped": clipped,
            "following": following,
            "skipped": skipped - following,
            "refused": refused,
            "below_uncertainty": below,
            "largest_correction_mm": correction,
            "largest_std_mm": std,
            **({} if self.joints is None else self.joints.summary()),
            "largest_difference_mm": max(
                (size for i, size in self.differences.items() if self.code[i] in _CORRECTED), default=0.0
            ),
        }

    def pieces(self, source: Source, resolution: float) -> Iterator[tuple[int, int, bytes, list[Span]]]:
        """Yield a corrected file in pieces: start and end in the original, the new bytes, and the spans that changed.

        Pieces end at a line end of the original, so that the lexer can read them one by one.
        """
        data, done = source.data, 0
        spans: list[Span] = []
        texts: list[bytes] = []
        for first, columns in self.program.targets.chunks(source.path):
            more, written_now = self._patches(source, first, columns, resolution)
            spans, texts = spans + more, texts + written_now
            if not spans:
                continue
            last = spans[-1][0]
            cut = max(data.rfind(b"\n", done, last), data.rfind(b"\r", done, last)) + 1
            if spans[0][0] - done > _GAP and (first_line := data.rfind(b"\n", done, spans[0][0]) + 1):
                yield done, first_line, data[done:first_line], []
                done = first_line
            ready = bisect.bisect_right(spans, cut, key=_end)
            if ready:
                yield done, cut, apply_patches(data, spans[:ready], texts[:ready], done, cut), spans[:ready]
                done, spans, texts = cut, spans[ready:], texts[ready:]
        cut = data.find(b"\n", spans[-1][1]) + 1 if spans else done
        if cut > done:
            yield done, cut, apply_patches(data, spans, texts, done, cut), spans
            done, spans, texts = cut, [], []
        yield done, len(data), apply_patches(data, spans, texts, done), spans

    def _patches(
        self, source: Source, first: int, columns: TargetColumns, resolution: float
    ) -> tuple[list[Span], list[bytes]]:
        """Return the spans and new texts of some targets, in the order of the file."""
        after = self.after[first : first + len(columns)]
        k = after.shape[1]
        before = columns.values[:, :k]
        rows, axes = np.nonzero(np.isfinite(after) & (after != before))
        spans: IntArray = columns.spans[rows, axes]
        texts = np.empty(len(rows), object)
        for axis in range(k):
            here = np.flatnonzero(axes == axis)
            unit, step = digit_step(columns, axis, resolution)
            old, new = before[rows[here], axis] / unit, after[rows[here], axis] / unit
            texts[here] = written(source.data, spans[here], old, new, step)
        if self.joints is not None and columns.joints is not None:
            more = written_joints(source.data, columns, self.joints.after[first : first + len(columns)])
            spans, texts = np.concatenate([spans, more[0]]), np.concatenate([texts, more[1]])
        order = np.argsort(spans[:, 0], kind="stable")
        return [(a, b) for a, b in spans[order].tolist()], texts[order].tolist()


def follows_corrected(reason: str) -> bool:
    """Return whether a reason says that a target gets the corrections of the points that it is derived from."""
    return reason.endswith(_FOLLOWS)


def _end(span: Span) -> int:
    return span[1]


def digit_step(columns: TargetColumns, axis: int, resolution: float) -> tuple[float, float]:
    """Return the unit of one of the target's numbers [mm; 1 for angles], and the step of its digits.

    The step is `resolution` [mm] in a power of ten of the digits' own unit.
    """
    if axis > 2:
        return 1.0, STEPS.get(columns.controller, DEGREES)
    step = resolution / columns.unit
    return columns.unit, step if columns.unit == 1.0 else float(f"1e{math.floor(math.log10(step) + 1e-9)}")


def _longest(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


class CorrectedShare(NamedTuple):
    """The number of motion targets, and of those that are corrected, or follow corrected ones."""

    corrected: int
    targets: int

    @classmethod
    def of(cls, programs: Iterable[Outcomes]) -> CorrectedShare:
        """Count the motion targets of programs; points that no motion goes to do not count."""
        corrected = targets = 0
        for outcomes in programs:
            done = outcomes.moved
            for first, columns in outcomes.program.targets.chunks():
                kinds, which = columns.shared()
                moved_to = np.array([bool(target.motions) for target in kinds])[which]
                targets += int(np.count_nonzero(moved_to))
                corrected += int(np.count_nonzero(moved_to & done[first : first + len(columns)]))
        return cls(corrected, targets)

    def __str__(self) -> str:
        nominal = self.targets - self.corrected
        stay = "stays" if nominal == 1 else "stay"
        return f"{self.corrected} of {self.targets} motion targets corrected, {nominal} {stay} nominal"

    def check(self, required: float, where: object) -> None:
        """Refuse a program with a smaller share of corrected targets than `required` (0 to 1).

        Raises
        ------
        RefusedError
            If fewer are corrected.
        """
        if self.corrected < required * self.targets - 1e-9:
            raise RefusedError(
                f"{where}: {self}, but {100 * required:g} % must be corrected (require); nothing is written: "
                "see why with 'truepose check', or require less"
            )
