"""Targets whose position is off the scale of the others, as if it were in another unit: they are refused.

A position in metres among others in millimetres lies a thousand times nearer to the origin of its frame. It is told by
three signs together: it lies apart from the others, in another unit it would lie among them, and it is one of a few.
Points near the origin are usual in frames of parts, and impossible in the base of the robot: in any other frame the
signs are stricter, and a position with less than two numbers other than zero is never off the scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.programs.core.columns import ProgramTargets
from truepose.programs.core.program import Program, linked
from truepose.programs.core.target import Target

_UNITS: Final = {"m": 1000.0, "mm": 1.0, "inch": 25.4}
"""Sizes of units [mm], the likeliest first."""
_LIKELY: Final = ("m", "mm")
"""Units so far apart that they are looked for in any frame; inches are in the base of the robot only."""
_LEAST: Final = 6  # targets of a frame
_FEW: Final = 0.4  # largest share of targets that are off the scale
_REACH: Final = 10e3  # [mm] from its base no robot reaches
_MARGIN: Final = 0.25  # of the extent of the others, around it
_APART: Final = 1.5  # times the distance of neighbours
_SHELL: Final = 10.0  # ratio of the distances from the origin, between those far off and the others
_SOME: Final = 2000  # targets that tell the distance of neighbours
_AT_ORIGIN: Final = 1.0  # [mm] of a frame from that of the base


class _Frame(NamedTuple):
    """Targets of a file in one frame: places (n,), positions (n, 3) [mm], unit [mm], and the base to the frame."""

    places: IntArray
    p: FloatArray
    unit: float
    tf_base_frame: FloatArray

    @property
    def is_base(self) -> bool:
        return bool(np.linalg.norm(self.tf_base_frame[:3, 3]) < _AT_ORIGIN)


def refuse_off_scale(program: Program) -> Program:
    """Return a program with those targets refused that are off the scale of the others in their frame."""
    targets = program.targets
    reasons = {i: why for frame in _frames(targets) for i, why in _off_scale(frame).items()}
    if not reasons:
        return program
    for i, k in linked(program.circles, reasons).items():
        other = targets[k]
        reasons[i] = f"its circle's other point {other.name} (line {other.line}) is left out: {reasons[k]}"
    again = None if program.again is None else partial(_read_again, program.again, reasons)
    return replace(program, targets=targets.refused(reasons), again=again)


def _read_again(again: Callable[[], Program], reasons: Mapping[int, str]) -> Program:
    """Read a program again, whose positions are judged already."""
    program = again()
    return replace(program, targets=program.targets.refused(reasons))


def _frames(targets: ProgramTargets) -> list[_Frame]:
    """Return the targets with a pose that would be corrected, by file and frame."""
    found: dict[object, list[tuple[IntArray, FloatArray]]] = {}
    likes: dict[object, Target] = {}
    for first, columns in targets.chunks():
        kinds, which = columns.shared()
        for k, like in enumerate(kinds):
            if like.verdict != "correct" or like.joint_form is not None or like.tf_base_frame is None or like.stands:
                continue
            rows = np.flatnonzero(which == k)
            key = like.path, like.frame, like.unit, like.tf_base_frame.tobytes()
            likes.setdefault(key, like)
            found.setdefault(key, []).append((first + rows, columns.values[rows, :3]))
    frames = []
    for kind, parts in found.items():
        tf = likes[kind].tf_base_frame
        assert tf is not None
        places, p = (np.concatenate(some) for some in zip(*parts, strict=True))
        order = np.argsort(places)
        frames.append(_Frame(places[order], p[order], likes[kind].unit, tf))
    return frames


def _off_scale(frame: _Frame) -> dict[int, str]:
    """Return why targets of a frame are off the scale of the others, by their places."""
    if len(frame.p) < _LEAST:
        return {}
    found = _too_far(frame)
    for name, size in _UNITS.items():
        if size > frame.unit and (frame.is_base or name in _LIKELY):
            found = _too_near(frame, name, size / frame.unit) | found
    return {int(frame.places[i]): why for i, why in found.items()}


def _too_far(frame: _Frame) -> dict[int, str]:
    """Return the targets that no robot reaches, although it reaches most others."""
    r = np.linalg.norm(frame.p @ frame.tf_base_frame[:3, :3].T + frame.tf_base_frame[:3, 3], axis=1)
    far = r > _REACH
    if not far.any() or far.mean() > _FEW:
        return {}
    others = frame.p[~far]
    units = {name: size / frame.unit for name, size in _UNITS.items() if size < frame.unit}
    found = {}
    for i in np.flatnonzero(far).tolist():
        unit = next((name for name, f in units.items() if _among(f * frame.p[i : i + 1], others)[0]), "")
        where = f"lies {r[i] / 1e3:.0f} m from the base of the robot, far off the other positions"
        found[i] = where + _likely(frame.p[i], unit, units.get(unit, 1.0))
    return found


def _too_near(frame: _Frame, name: str, f: float) -> dict[int, str]:
    """Return the targets near the origin that would lie among the others if they were in a unit f times as large."""
    r = np.linalg.norm(frame.p, axis=1)
    near = r <= r.max() / f
    if not near.any() or near.mean() > _FEW:
        return {}
    others, rows = np.unique(frame.p[~near], axis=0), np.flatnonzero(near)
    tree, step = cKDTree(others), max(1, len(others) // _SOME)
    if len(others) < 3:
        return {}
    spacing = float(np.quantile(np.asarray(tree.query(others[::step], 2)[0])[:, 1], 0.9))
    p = frame.p[rows]
    fits = _among(f * p, others) & (np.count_nonzero(p, axis=1) >= 2)
    beside = frame.is_base and bool((others.min(axis=0) > 0.0).any() or (others.max(axis=0) < 0.0).any())
    several = beside or len(np.unique(p[fits], axis=0)) > 1
    shell = f > _SHELL**2 and r[~near].min() > _SHELL * r[rows[fits]].max(initial=0.0)  # nothing lies between
    apart = tree.query(p)[0] > (1.0 if beside else _APART) * max(spacing, r.max() / f)
    fits &= (apart & (several or name == "m")) | (several & shell)
    return {i: "is off the scale of the other positions" + _likely(frame.p[i], name, f) for i in rows[fits].tolist()}


def _among(p: FloatArray, others: FloatArray) -> BoolArray:
    """Return whether positions lie in the box of others, with its margin, (n,)."""
    low, high = others.min(axis=0), others.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    among: BoolArray = ((p >= low - margin) & (p <= high + margin)).all(axis=1)
    return among


def _likely(p: FloatArray, unit: str, f: float) -> str:
    """Return the unit in which a position would lie among the others, and where; empty without one."""
    if not unit:
        return "; correct its numbers"
    where = ", ".join(f"{x:.1f}" for x in f * p + 0.0)
    return f"; in {unit} it would lie among them, at ({where}) mm: correct its unit"
