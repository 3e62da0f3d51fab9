"""Targets as columns: shared data are held once, numbers in arrays, and runs of a file are read when needed.

So a program of a million targets fits in memory: `ProgramTargets` makes a `Target` only for the one that is asked for,
and code that works on all of them takes `TargetColumns`, some thousand at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from pathlib import Path
from typing import Final, NamedTuple, Protocol, overload

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.geometry import invert_transform, make_transform
from truepose.programs.core import orientations
from truepose.programs.core.joint_targets import MOST_JOINTS
from truepose.programs.core.target import Shifts, Target

CHUNK: Final = 2048
"""Number of targets that are processed at a time."""
VERDICTS: Final = ("correct", "skip", "refuse")


class Stretch(Protocol):
    """Consecutive targets of one file that differ only in their numbers, which are read from its bytes when needed."""

    @property
    def like(self) -> Target:
        """The first of them."""

    @property
    def likes(self) -> Sequence[Target]:
        """One of each kind, the first of them first; all have one verdict."""

    def __len__(self) -> int: ...

    def columns(self, alike: Sequence[Target], kinds: Sequence[int]) -> TargetColumns:
        """Return the targets; `kinds` are the places of the data that they share, those of `likes`, in `alike`."""


@dataclass(frozen=True, eq=False)
class TargetColumns:
    """Consecutive targets of one file.

    Attributes
    ----------
    alike : sequence of Target
        The data that targets share, without name, line and numbers.
    kind : (n,) array of int
        The place of each target's shared data in `alike`.
    line, status, turn : (n,) arrays of int
        The line, and the Status and Turn; −1 where the target does not name them.
    values : (n, k) array [mm; the controller's angles]
        The positions and orientations; NaN where there are none.
    spans : (n, k, 2) array of int
        The first and last byte of each number; −1 where there is none.
    names : sequence of n str or None
        The names; None where the target is named by its motion and line.
    joints : (n, 6) array [the controller's unit], optional
        The joints of joint targets, whose `spans` come first; NaN where there are none. None where none has joints.
    derived : mapping of int to tuple of Shifts
        The positions that the program derives from some of them, by their places here.
    follows : mapping of int to tuple of str
        The names of what some of them follow, by their places here.
    """

    alike: Sequence[Target]
    kind: IntArray
    line: IntArray
    status: IntArray
    turn: IntArray
    values: FloatArray
    spans: IntArray
    names: Sequence[str | None]
    joints: FloatArray | None = None
    derived: Mapping[int, tuple[Shifts, ...]] = field(default_factory=dict)
    follows: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, targets: Sequence[Target], alike: list[Target], known: dict[object, int]) -> TargetColumns:
        """Pack targets; add their shared data to `alike`, whose places are kept in `known`."""
        kinds = np.empty(len(targets), np.int64)
        width = 3 + orientations.count(targets[0].controller)
        values = np.full((len(targets), width), np.nan)
        spans = np.full((len(targets), width, 2), -1, np.int64)
        for i, target in enumerate(targets):
            kinds[i] = _kind(target, alike, known)
            if target.xyz is not None and target.angles is not None:
                values[i] = (*target.xyz, *target.angles)
            if target.spans:
                spans[i, : len(target.spans)] = target.spans
        return cls(
            alike,
            kinds,
            np.array([t.line for t in targets]),
            np.array([-1 if t.status is None else t.status for t in targets]),
            np.array([-1 if t.turn is None else t.turn for t in targets]),
            values,
            spans,
            [None if t.name == _name(t.motions, t.line) else t.name for t in targets],
            _joints(targets),
            {i: t.derived for i, t in enumerate(targets) if t.derived},
            {i: t.follows for i, t in enumerate(targets) if t.follows},
        )

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def like(self) -> Target:
        """What the first one shares with others."""
        return self.alike[int(self.kind[0])]

    @property
    def path(self) -> Path:
        """The file."""
        return self.like.path

    @property
    def unit(self) -> float:
        """Of the position's digits [mm]."""
        return self.like.unit

    @property
    def controller(self) -> str:
        """Whose angles they are."""
        return self.like.controller

    @property
    def verdict(self) -> NDArray[np.str_]:
        """Verdicts, (n,)."""
        return np.array([target.verdict for target in self.alike])[self.kind]

    @property
    def on_paths(self) -> BoolArray:
        """Whether every motion to each target, and to what is derived from it, follows a path in space, (n,)."""
        on_paths: BoolArray = np.array([target.on_paths for target in self.alike])[self.kind]
        for i in self.derived:
            on_paths[i] = self.target(i).on_paths
        return on_paths

    @property
    def commands_joints(self) -> BoolArray:
        """Whether each is a joint target, (n,)."""
        if self.joints is None:
            return np.zeros(len(self), np.bool_)
        return np.array([target.joint_form is not None for target in self.alike])[self.kind]

    def shared(self) -> tuple[list[Target], IntArray]:
        """Return the few kinds of target among these, and for each target which of them it is, (n,)."""
        kinds, which = np.unique(self.kind, return_inverse=True)
        return [self.alike[kind] for kind in kinds], which

    def take(self, rows: IntArray) -> TargetColumns:
        """Return some of them, also one several times."""
        few = {**self.derived, **self.follows}
        places = [(k, i) for k, i in enumerate(rows.tolist()) if i in few] if few else []
        return TargetColumns(
            self.alike,
            self.kind[rows],
            self.line[rows],
            self.status[rows],
            self.turn[rows],
            self.values[rows],
            self.spans[rows],
            [self.names[i] for i in rows.tolist()],
            None if self.joints is None else self.joints[rows],
            {k: self.derived[i] for k, i in places if i in self.derived},
            {k: self.follows[i] for k, i in places if i in self.follows},
        )

    def name(self, i: int) -> str:
        """Return the name of one."""
        return self.names[i] or _name(self.alike[int(self.kind[i])].motions, int(self.line[i]))

    def target(self, i: int) -> Target:
        """Return one of them."""
        known = not np.isnan(self.values[i, 0])
        status, turn = int(self.status[i]), int(self.turn[i])
        like = self.alike[int(self.kind[i])]
        joints = None if self.joints is None or like.joint_form is None else self.joints[i, : like.joint_form.count]
        return replace(
            like,
            name=self.name(i),
            line=int(self.line[i]),
            xyz=tuple(self.values[i, :3].tolist()) if known else None,
            angles=tuple(self.values[i, 3:].tolist()) if known else None,
            status=None if status < 0 else status,
            turn=None if turn < 0 else turn,
            spans=tuple([(a, b) for a, b in self.spans[i].tolist()][: None if joints is None else len(joints)])
            if self.spans[i, 0, 0] >= 0
            else (),
            joints=None if joints is None else tuple(joints.tolist()),
            derived=self.derived.get(i, ()),
            follows=self.follows.get(i, ()),
        )

    @property
    def held(self) -> BoolArray:
        """Whether the robot holds the part and the tool stands, (n,)."""
        kinds, which = self.shared()
        return np.array([bool(target.stands) for target in kinds], np.bool_)[which]

    def tf_base_frame(self) -> FloatArray:
        """Return their frames, (n, 4, 4) [mm]; NaN where not known. Where the tool stands, they are on the flange."""
        unknown = np.full((4, 4), np.nan)
        kinds, which = self.shared()
        return np.array([unknown if t.tf_base_frame is None else t.tf_base_frame for t in kinds])[which]

    def tf_flange_tool(self, measured: FloatArray) -> FloatArray:
        """Return their tools, (n, 4, 4) [mm]; `measured` where the program names none.

        Where a part is held, it is the place on the part that comes to the tool: the error there counts.
        """
        kinds, which = self.shared()
        tools: FloatArray = np.array([measured if t.tf_flange_tool is None else t.tf_flange_tool for t in kinds])[which]
        for k, rows in self._held_rows():
            some = self.take(rows)
            own = make_transform(some.rotation(), some.values[:, :3])
            frame, tool = self.alike[k].tf_base_frame, self.alike[k].tf_flange_tool
            assert frame is not None  # as `_held_rows` yields none without
            assert tool is not None
            tools[rows] = frame @ own if self.alike[k].stands == "tool" else tool @ invert_transform(own)
        return tools

    def rotation(self) -> Rotation:
        """Return their orientations in their own frames; all must have one."""
        return orientations.rotation(self.controller, self.values[:, 3:])

    def poses_base(self) -> FloatArray:
        """Return their poses, base to tool, (n, 4, 4) [mm]; all must have one."""
        poses: FloatArray = self.tf_base_frame() @ make_transform(self.rotation(), self.values[:, :3])
        for k, rows in self._held_rows():
            like = self.alike[k]
            poses[rows] = like.tf_flange_tool if like.stands == "tool" else like.tf_base_frame
        return poses

    def base_to_frame(self) -> FloatArray:
        """Return the matrices, (n, 3, 3), that turn changes of position in the base frame into those of the numbers.

        Where the program states the place of a standing tool on a part, that moves the other way. All targets must have
        a pose.
        """
        turns = np.swapaxes(self.tf_base_frame()[:, :3, :3], 1, 2).copy()
        for k, rows in self._held_rows():
            if self.alike[k].stands == "tool":
                some = self.take(rows)
                turns[rows] = -some.rotation().as_matrix() @ np.swapaxes(some.poses_base()[:, :3, :3], 1, 2)
        return turns

    def _held_rows(self) -> Iterator[tuple[int, IntArray]]:
        """Yield the kinds of targets where the robot holds the part, with their targets that have a pose."""
        for k in np.unique(self.kind).tolist():
            like = self.alike[k]
            if like.stands and like.tf_base_frame is not None and like.tf_flange_tool is not None:
                yield k, np.flatnonzero((self.kind == k) & np.isfinite(self.values).all(axis=1))


class Motions(NamedTuple):
    """The motions of a program in the order of the text.

    Attributes
    ----------
    target : (m,) array of int
        The target of each.
    on_path : (m,) array of bool
        Whether the tool comes to it on a straight, circular or spline path from the target of the motion before.
    goes_on : (m,) array of bool
        Whether it certainly starts at the target of the motion before, on a path or by a joint motion: nothing that
        moves the robot, and no other way through the program, is between them.
    """

    target: IntArray
    on_path: BoolArray
    goes_on: BoolArray


class Follow(NamedTuple):
    """What a target without numbers of its own follows.

    Attributes
    ----------
    sources : tuple of int
        The targets that it is derived from.
    shift : Shifts, optional
        Its shift, where it is one shift from one target.
    """

    sources: tuple[int, ...]
    shift: Shifts | None


NO_MOTIONS: Final = Motions(np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool))


class ProgramTargets(Sequence[Target]):
    """The targets of a program, in the order of the text, file by file.

    Parameters
    ----------
    items : iterable of Target or Stretch
        The targets in that order.
    motions : Motions
        The motions to them.
    follows : mapping of int to Follow
        What targets without numbers of their own follow.
    """

    def __init__(
        self,
        items: Iterable[Target | Stretch] = (),
        motions: Motions = NO_MOTIONS,
        follows: Mapping[int, Follow] | None = None,
    ) -> None:
        self.motions, self.follows = motions, dict(follows or {})
        self._alike: list[Target] = []
        self._pieces: list[tuple[TargetColumns | Stretch, list[int]]] = []
        known: dict[object, int] = {}
        waiting: list[Target] = []
        for item in items:
            first = item if isinstance(item, Target) else item.like
            if waiting and (first is not item or len(waiting) == CHUNK or first.path != waiting[0].path):
                self._pieces.append((TargetColumns.of(waiting, self._alike, known), []))
                waiting = []
            if isinstance(item, Target):
                waiting.append(item)
            else:
                self._pieces.append((item, [_kind(like, self._alike, known) for like in item.likes]))
        if waiting:
            self._pieces.append((TargetColumns.of(waiting, self._alike, known), []))
        self._starts = [0, *accumulate(len(piece) for piece, _ in self._pieces)]

    def __len__(self) -> int:
        return self._starts[-1]

    @overload
    def __getitem__(self, i: int) -> Target: ...
    @overload
    def __getitem__(self, i: slice) -> list[Target]: ...
    def __getitem__(self, i: int | slice) -> Target | list[Target]:
        if isinstance(i, slice):
            return [self[k] for k in range(*i.indices(len(self)))]
        i = i + len(self) if i < 0 else i
        if not 0 <= i < len(self):
            raise IndexError(i)
        k = int(np.searchsorted(self._starts, i, side="right")) - 1
        return self._columns(k).target(i - self._starts[k])

    def __iter__(self) -> Iterator[Target]:
        for _, columns in self.chunks():
            yield from map(columns.target, range(len(columns)))

    def _columns(self, k: int) -> TargetColumns:
        piece, kinds = self._pieces[k]
        return piece if isinstance(piece, TargetColumns) else piece.columns(self._alike, kinds)

    def chunks(self, path: Path | None = None) -> Iterator[tuple[int, TargetColumns]]:
        """Yield the targets as columns, each with the place of its first; never beyond a file or some thousands.

        `path`: of this file only.
        """
        waiting: list[TargetColumns] = []
        first = size = 0
        for k, (piece, _) in enumerate(self._pieces):
            place = piece.like.path
            if waiting and (size + len(piece) > CHUNK or place != waiting[0].path):
                yield first, _join(waiting)
                waiting = []
            if path is None or place == path:
                first, size = (first, size + len(piece)) if waiting else (self._starts[k], len(piece))
                waiting.append(self._columns(k))
        if waiting:
            yield first, _join(waiting)

    def refused(self, reasons: Mapping[int, str]) -> ProgramTargets:
        """Return the same targets with some refused, by their places, each with its reason."""
        found = ProgramTargets((), self.motions, self.follows)
        found._alike, found._starts = list(self._alike), self._starts
        known: dict[object, int] = {}
        for k, (piece, kinds) in enumerate(self._pieces):
            rows = [i for i in reasons if self._starts[k] <= i < self._starts[k + 1]]
            if not rows:
                alike = replace(piece, alike=found._alike) if isinstance(piece, TargetColumns) else piece
                found._pieces.append((alike, kinds))
                continue
            columns = self._columns(k)
            kind = columns.kind.copy()
            for i in rows:
                like = replace(columns.target(i - self._starts[k]), verdict="refuse", reason=reasons[i])
                kind[i - self._starts[k]] = _kind(like, found._alike, known)
            found._pieces.append((replace(columns, alike=found._alike, kind=kind), []))
        return found

    @property
    def kinds(self) -> Sequence[Target]:
        """The data that targets share, without name, line and numbers."""
        return self._alike

    def with_kinds(self, change: Callable[[Target], Target]) -> ProgramTargets:
        """Return the same targets with other shared data."""
        found = ProgramTargets((), self.motions, self.follows)
        found._alike, found._starts = [change(like) for like in self._alike], self._starts
        found._pieces = [
            (replace(piece, alike=found._alike) if isinstance(piece, TargetColumns) else piece, kinds)
            for piece, kinds in self._pieces
        ]
        return found

    @property
    def names_joints(self) -> bool:
        """Whether there are joint targets."""
        return any(target.joint_form is not None for target in self._alike)

    @property
    def corrects_joints(self) -> bool:
        """Whether there are joint targets whose verdict is ``correct``."""
        return any(target.joint_form is not None and target.verdict == "correct" for target in self._alike)

    def verdicts(self) -> NDArray[np.int8]:
        """Return the places of the verdicts in `VERDICTS`, (n,)."""
        codes = np.array([VERDICTS.index(target.verdict) for target in self._alike], np.int8)
        parts = [
            codes[piece.kind] if isinstance(piece, TargetColumns) else np.full(len(piece), codes[kinds[0]])
            for piece, kinds in self._pieces
        ]
        return np.concatenate(parts) if parts else np.empty(0, np.int8)


def _kind(target: Target, alike: list[Target], known: dict[object, int]) -> int:
    """Return the place of the data that a target shares with others."""
    key = (
        target.path, target.motions, target.verdict, target.reason, target.frame, target.tool, target.frame_number,
        target.tool_number, target.controller, target.configuration, target.unit, target.joint_form,
        target.frame_changed, target.tool_changed, target.stands,
        None if target.tf_base_frame is None else target.tf_base_frame.tobytes(),
        None if target.tf_flange_tool is None else target.tf_flange_tool.tobytes(),
    )  # fmt: skip
    if key not in known:
        known[key] = len(alike)
        own = {"xyz": None, "angles": None, "status": None, "turn": None, "spans": (), "joints": None}
        alike.append(replace(target, name="", line=0, derived=(), follows=(), **own))  # type: ignore[arg-type]  # of many types
    return known[key]


def _name(motions: Sequence[str], line: int) -> str:
    return f"{motions[0] if motions else ''}:{line}"


def _join(parts: list[TargetColumns]) -> TargetColumns:
    if len(parts) == 1:
        return parts[0]
    starts = [0, *accumulate(map(len, parts))]
    return TargetColumns(
        parts[0].alike,
        np.concatenate([part.kind for part in parts]),
        np.concatenate([part.line for part in parts]),
        np.concatenate([part.status for part in parts]),
        np.concatenate([part.turn for part in parts]),
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.spans for part in parts]),
        [name for part in parts for name in part.names],
        _joined_joints(parts),
        {first + i: one for first, part in zip(starts, parts, strict=False) for i, one in part.derived.items()},
        {first + i: one for first, part in zip(starts, parts, strict=False) for i, one in part.follows.items()},
    )


def _joints(targets: Sequence[Target]) -> FloatArray | None:
    """Return the joints of targets, (n, 6); None where none has joints."""
    if all(target.joints is None for target in targets):
        return None
    joints = np.full((len(targets), MOST_JOINTS), np.nan)
    for row, target in zip(joints, targets, strict=True):
        if target.joints is not None:
            row[: len(target.joints)] = target.joints
    return joints


def _joined_joints(parts: Sequence[TargetColumns]) -> FloatArray | None:
    if all(part.joints is None for part in parts):
        return None
    none = (np.full((len(part), MOST_JOINTS), np.nan) for part in parts)
    return np.concatenate([n if p.joints is None else p.joints for n, p in zip(none, parts, strict=True)])
