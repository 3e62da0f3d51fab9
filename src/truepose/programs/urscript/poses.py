"""Expressions that give poses: literals, variables, elements of lists, and the functions that join poses."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry import euler, make_transform
from truepose.programs.core.joint_targets import UR, JointNumbers
from truepose.programs.core.points import Point, Problem
from truepose.programs.core.source import NUMBER, Source, is_broken, parse_number, shown, strip
from truepose.programs.urscript.syntax import ARGUMENT, POSE, VARIABLE, arguments

_KEYS: Final = ("X", "Y", "Z", "RX", "RY", "RZ")
_ITEM: Final = re.compile(rb"([A-Za-z_]\w*)\s*\[\s*([\w+*/%. -]+?)\s*\]")
_JOINTS: Final = re.compile(rb"\[\s*" + rb"\s*,\s*".join([b"(" + NUMBER + b")"] * 6) + rb"\s*\]")
_JOIN: Final = re.compile(rb"(pose_trans|pose_add|pose_inv)\s*\(")
INVERSE: Final = re.compile(rb"get_inverse_kin\s*\(")
"""The function that gives the joints of a pose, with the TCP in force."""
POSE_FUNCTIONS: Final = (b"pose_trans", b"pose_add", b"pose_inv", b"get_inverse_kin")
"""The functions that are followed."""
_CALL: Final = re.compile(rb"(?!get_(?:actual|target)_joint_positions\b)\b[A-Za-z_]\w*\s*\(")
_INDEX: Final = re.compile(rb"\w\s*\[")
_OTHER_TCP: Final = re.compile(rb",\s*tcp\s*=")
_NO_ROTATION: Final = 1e-9
"""The largest rotation [rad] of a shift."""


class Literal(NamedTuple):
    """A pose ``p[…]``."""

    point: Point


class Name(NamedTuple):
    """A variable or parameter: its key among all of the program, and its name."""

    key: str
    text: str


class Item(NamedTuple):
    """An element of a list; `place` is None where it is known at run time only."""

    key: str
    place: int | None
    text: str


class Join(NamedTuple):
    """``pose_trans(first, second)``, or ``pose_add`` where `adds`."""

    adds: bool
    first: Pose
    second: Pose
    text: str


class Inverse(NamedTuple):
    """``pose_inv(of)``."""

    of: Pose
    text: str


class Offset(NamedTuple):
    """A shift (x, y, z) [mm] that statements add to the coordinates of a pose."""

    shift: tuple[float, float, float]
    text: str = "shift"


class Unknown(NamedTuple):
    """Any other expression."""

    text: str


Pose = Literal | Name | Item | Join | Inverse | Offset | Unknown


def read_literal(source: Source, name: str, start: int, end: int, line: int) -> Point | None:
    """Return the pose of ``p[…]`` that fills a span of a file; None if it is anything else.

    Raises
    ------
    FileError
        If it is broken.
    """
    data = source.data
    m = POSE.match(data, start, end)
    if m is None or data[end - 1 : end] != b"]" or b"]" in data[m.end() : end - 1]:
        return None
    cuts = [m.end() - 1, *(m.end() + k for k, c in enumerate(data[m.end() : end - 1]) if c == 0x2C), end - 1]
    spans = [strip(data, a + 1, b) for a, b in itertools.pairwise(cuts)]
    if len(spans) != 6:
        raise source.error(line, f"{name}: a pose has 6 numbers, this has {len(spans)}; correct the file")
    line = source.line(spans[0][0])
    values = []
    for key, (a, b) in zip(_KEYS, spans, strict=True):
        token = data[a:b]
        if b"{{" not in token and is_broken(token):
            raise source.error(line, f"{name}: {key} {shown(token)!r} is not a number; correct the file")
        try:
            values.append(parse_number(token))
        except ValueError as error:
            if (len(token) > 40 and token[:20].isdigit()) or "beyond" in str(error):
                raise source.error(line, f"{name}: {key}: {error}; correct the file") from None
            return Point(name, source, line, problem=Problem("skip", f"{key}: an expression, known at run time only"))
    try:
        euler("ur", values[3:])
    except DataError as error:
        raise source.error(line, f"{name}: {error}") from None
    return Point(name, source, line, tuple(values), tuple(spans))


def read_joints(source: Source, name: str, start: int, end: int, line: int) -> Point | None:
    """Return the joints of ``[…]`` that fills a span of a file; None if it is no list of six numbers."""
    m = _JOINTS.fullmatch(source.data, start, end)
    if m is None:
        return None
    try:
        values = tuple([parse_number(token) for token in m.groups()])
    except ValueError:
        return None  # too long or too large for a joint
    return Point(name, source, line, joints=JointNumbers(values, tuple([m.span(k) for k in range(1, 7)]), UR))


def parse(
    code: bytes, start: int, end: int, literal: Callable[[int, int], Point | None], key: Callable[[str], str]
) -> Pose:
    """Return the expression that fills a span of a statement.

    Parameters
    ----------
    code : bytes
        The statement.
    start, end : int
        The span, without blanks at its ends.
    literal : callable
        A function that returns the point of a ``p[…]`` in a span; None if it is anything else.
    key : callable
        A function that returns the key of a name.
    """
    text = code[start:end]
    if POSE.match(text):
        point = literal(start, end)
        return Unknown(shown(text)) if point is None else Literal(point)
    if VARIABLE.fullmatch(text):
        return Name(key(text.decode()), text.decode())
    # other arguments of get_inverse_kin choose the branch only
    if (m := INVERSE.match(code, start, end)) and (spans := arguments(code, m.end())):
        named = ARGUMENT.match(code, *spans[0])
        whole = code[spans[-1][1] : end].strip() == b")" and (named is None or named[1] == b"x")
        others = code[spans[0][1] : end]
        pose = parse(code, spans[0][0] if named is None else named.end(), spans[0][1], literal, key)
        unread = any(pattern.search(others) for pattern in (_OTHER_TCP, _CALL, _INDEX))
        return pose if whole and len(spans) < 5 and not unread and _is_plain(pose) else Unknown(shown(text))
    if m := _ITEM.fullmatch(text):
        return Item(key(m[1].decode()), int(m[2]) if m[2].isdigit() and len(m[2]) < 7 else None, shown(text))
    if m := _JOIN.match(code, start, end):
        spans = arguments(code, m.end())
        count = 1 if m[1] == b"pose_inv" else 2
        if len(spans) == count and code[spans[-1][1] : end].strip() == b")":
            parts = [parse(code, a, b, literal, key) for a, b in spans]
            if not all(map(_is_plain, parts)):  # what else it may call or read is for the reader to see
                return Unknown(shown(text))
            if count == 1:
                return Inverse(parts[0], shown(text))
            return Join(m[1] == b"pose_add", parts[0], parts[1], shown(text))
    return Unknown(shown(text))


def _is_plain(pose: Pose) -> bool:
    """Return whether an expression consists of names, numbers and the functions that join poses."""
    return not isinstance(pose, Unknown) and not (isinstance(pose, Literal) and pose.point.problem is not None)


def keys(pose: Pose) -> Iterator[str]:
    """Yield the keys of the variables in an expression."""
    match pose:
        case Name() | Item():
            yield pose.key
        case Join():
            yield from keys(pose.first)
            yield from keys(pose.second)
        case Inverse():
            yield from keys(pose.of)


def has_literal(pose: Pose) -> bool:
    """Return whether a pose is written in an expression."""
    match pose:
        case Literal():
            return True
        case Join():
            return has_literal(pose.first) or has_literal(pose.second)
        case Inverse():
            return has_literal(pose.of)
    return False


def text_of(pose: Pose) -> str:
    """Return the text of an expression, shortened."""
    return "p[…]" if isinstance(pose, Literal) else pose.text


def transform(values: tuple[float, ...]) -> FloatArray:
    """Return the transform (4, 4) [mm] of the numbers of a pose [m, rad]."""
    return make_transform(euler("ur", values[3:]), 1000.0 * np.array(values[:3]))


def added(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return ``pose_add`` of two transforms, (4, 4) [mm]: positions add up, rotations follow each other."""
    return make_transform(first[:3, :3] @ second[:3, :3], first[:3, 3] + second[:3, 3])


def is_shift(tf: FloatArray) -> bool:
    """Return whether a transform does not rotate."""
    return bool(np.abs(tf[:3, :3] - np.eye(3)).max() < _NO_ROTATION)
