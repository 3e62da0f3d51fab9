"""RAPID's data: robtargets, and the frames of tooldata and wobjdata."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry import euler, make_transform
from truepose.programs.core.joint_targets import ABB, JointNumbers
from truepose.programs.core.points import Frame, Point, Problem
from truepose.programs.core.program import ReadOptions
from truepose.programs.core.source import Source, is_broken, parse_number
from truepose.programs.rapid.syntax import Token, Value, is_list

_UNUSED_AXIS: Final = 8.9e9  # 9E9 means that there is no such axis


def robtarget(source: Source, options: ReadOptions, name: str, parsed: Value, line: int) -> Point:
    """Return the point of a literal robtarget; a FileError names the line if its numbers are broken."""
    groups = [group for group in parsed if isinstance(group, list)]
    sizes = [len(group) if is_list(group) else 0 for group in groups]
    if sizes != [3, 4, 4, 6]:
        if len(sizes) == 4 and 0 in sizes:
            return Point(name, source, line, problem=Problem("skip", "an expression, known at run time only"))
        raise source.error(line, f"{name}: a robtarget has [3, 4, 4, 6] numbers, this has {sizes}; correct the file")
    leaves: list[list[Token]] = [leaf for group in groups for leaf in group]  # type: ignore[misc]  # by sizes
    if any(not isinstance(token, Token) for leaf in leaves for token in leaf):
        raise source.error(line, f"{name}: a list inside the numbers of a robtarget; correct the file")
    line = source.line(leaves[0][0].start) if leaves[0] else line
    point = Point(name, source, line)
    texts = [source.data[leaf[0].start : leaf[-1].end] if leaf else b"" for leaf in leaves]
    for text in texts:
        if is_broken(text):
            raise source.error(line, f"{name}: {text[:20].decode('latin-1')!r} is not a number; correct the file")
    simple = [len(leaf) == 1 and leaf[0].kind == "number" for leaf in leaves]
    point.configuration = ",".join(text.decode("latin-1").strip() for text in texts[7:11])
    if not all(simple[:7]):
        point.problem = Problem("skip", "an expression in its numbers, known at run time only")
        return point
    try:
        point.values = tuple([parse_number(text) for text in texts[:7]])
        euler("abb", np.array(point.values[3:]))
    except DataError as error:
        raise source.error(line, f"{name}: {error}") from None
    except ValueError as error:
        raise source.error(line, f"{name}: {error}; correct the file") from None
    point.spans = tuple([(leaf[0].start, leaf[0].end) for leaf in leaves[:7]])
    point.problem = _external(texts[11:], simple[11:], options)
    return point


def jointtarget(source: Source, options: ReadOptions, name: str, parsed: Value, line: int) -> Point:
    """Return the point of a literal jointtarget."""
    groups = [group for group in parsed if isinstance(group, list) and is_list(group)]
    leaves = [leaf for group in groups for leaf in group]
    point = Point(name, source, line)
    if [len(group) for group in groups] != [6, 6] or any(not isinstance(t, Token) for leaf in leaves for t in leaf):
        point.problem = Problem("skip", "joint target: an expression, known at run time only")
        return point
    tokens: list[list[Token]] = leaves  # type: ignore[assignment]  # the lines above leave tokens only
    texts = [source.data[leaf[0].start : leaf[-1].end] if leaf else b"" for leaf in tokens]
    simple = [len(leaf) == 1 and leaf[0].kind == "number" for leaf in tokens]
    if not all(simple[:6]):
        point.problem = Problem("skip", "joint target: an expression in its numbers, known at run time only")
        return point
    try:
        values = tuple([parse_number(text) for text in texts[:6]])
    except ValueError as error:
        point.problem = Problem("skip", f"joint target: {error}")
        return point
    point.line = source.line(tokens[0][0].start)
    point.joints = JointNumbers(values, tuple([(leaf[0].start, leaf[0].end) for leaf in tokens[:6]]), ABB)
    point.problem = _external(texts[6:], simple[6:], options)
    return point


def _external(texts: Sequence[bytes], simple: Sequence[bool], options: ReadOptions) -> Problem | None:
    """Return the reason why external axes forbid a correction."""
    used = [i for i, text in enumerate(texts, 1) if not simple[i - 1] or 0 < abs(float(text)) < _UNUSED_AXIS]
    if not used or options.external_axes:
        return None
    reason = f"external axis {used[0]} is in use and has no model; allow external_axes if it moves neither"
    return Problem("refuse", reason)


def frame_data(kind: str, text: str, parsed: Value) -> tuple[str, Frame, Problem | None]:
    """Return a tool or workobject that a module declares, and the reason why it cannot be used."""
    problem = None
    head = [_word(item) for item in parsed] if is_list(parsed) else []
    if kind == "tooldata":
        poses, held = parsed[1:2] if head else [], head[:1] == ["FALSE"]
    else:
        poses, held = parsed[3:5] if head else [], head[:1] == ["TRUE"]
        if len(head) > 2 and (head[1] == "FALSE" or head[2].strip('"')):
            problem = Problem("refuse", f"workobject {text} is moved by a mechanical unit; it has no model")
    if head and head[0] not in ("TRUE", "FALSE"):
        problem = Problem("refuse", f"whether the robot holds {text} is known at run time only")
    wanted = 1 if kind == "tooldata" else 2
    tfs = [_pose(pose) for pose in poses]
    known = len(tfs) == wanted and all(tf is not None for tf in tfs)
    tf = functools.reduce(np.matmul, [tf for tf in tfs if tf is not None]).tobytes() if known else None
    return kind, Frame(text, text, tf, stands="tool" if held else ""), problem


def _word(item: Value | Token) -> str:
    return item[0].text if isinstance(item, list) and item and isinstance(item[0], Token) else ""


def _pose(item: Value | Token) -> FloatArray | None:
    """Return the transform of ``[[x,y,z],[q1,q2,q3,q4]]``; None if it is no pose of numbers."""
    if not isinstance(item, list) or not is_list(item):
        return None
    leaves = [_word(leaf) for group in item if isinstance(group, list) for leaf in group]
    try:
        values = [parse_number(leaf.encode("latin-1")) for leaf in leaves]
        return make_transform(euler("abb", values[3:]), values[:3]) if len(values) == 7 else None
    except ValueError:
        return None
