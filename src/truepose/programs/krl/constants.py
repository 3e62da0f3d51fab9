"""Constants of a module: whole numbers and frames that it declares as CONST, and frames that its .src sets once.

A name counts as a constant only if every statement that names it is one of a few forms which cannot change it. What
other modules may change (GLOBAL, PUBLIC) is none, and neither is a variable of the data list: the operator may set it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from truepose.programs.core.source import Source
from truepose.programs.krl.lexer import CARTESIAN, closing_brace, parse_aggregate

_CONST: Final = rb"(?:DECL[ \t]++)?+CONST[ \t]++"
_ITEM: Final = rb"([A-Za-z]\w*+)[ \t]*+(\[[ \t]*+\d{1,4}[ \t]*+\])?+[ \t]*+"
_INTEGER: Final = re.compile(
    rb"^[ \t]*+" + _CONST + rb"INT[ \t]++" + _ITEM + rb"=[ \t]*+(\d{1,4})[ \t]*+(?:;|\r?$)", re.I | re.M
)
_FRAME: Final = re.compile(
    rb"^[ \t]*+(?:(?:DECL[ \t]++)?+(?:CONST[ \t]++)?+FRAME[ \t]++)?+" + _ITEM + rb"=[ \t]*+(?=\{)", re.I | re.M
)
_BEHIND: Final = rb"FRAME[ \t]++([A-Za-z]\w*+)[ \t]*+(?:\[[^\]\r\n]*+\])?+[ \t]*+(?:=|;|\r?$)"
_OF_LIST: Final = re.compile(rb"^[ \t]*+" + _CONST + _BEHIND, re.I | re.M)
_LOCAL: Final = re.compile(rb"^[ \t]*+(?:DECL[ \t]++)?+" + _BEHIND, re.I | re.M)
"""The names of constant frames of a data list, and of other frames."""
_REST: Final = re.compile(rb"[^\r\n]++")
_COMPONENT: Final = re.compile(rb"^[ \t]*+" + _ITEM + rb"\.[ \t]*+\w++[ \t]*+=(?!=)", re.M)
_ASSIGNED: Final = re.compile(rb"[ \t]*+=[ \t]*+\{")
_DECLARES_FRAME: Final = re.compile(rb"[ \t]*+(?:DECL[ \t]++)?+FRAME[ \t]++", re.I)
_HARMLESS: Final = re.compile(
    rb"[ \t]*+(?:\$(?:BASE|TOOL)[ \t]*+=(?!=)|BAS[ \t]*+\([ \t]*+#|S?(?:PTP|LIN|CIRC)(?:_REL)?\b|SPL\b"
    rb"|[\w$.]++(?:\[[^\]=()]*+\])?+[ \t]*+=(?!=))[^()]*+",
    re.I,
)
"""The beginning of a statement that reads what follows, up to a name: no call to which it may be given."""


@dataclass(frozen=True)
class Constants:
    """The constants of a module by their names in upper case, an element of an array as ``F[1]``.

    Attributes
    ----------
    integers : dict of str to int
        The whole numbers.
    frames : dict of str to tuple of 6 float
        The frames, X, Y, Z [mm], A, B, C [deg].
    stored : dict of str to tuple of 6 float
        The values that the data list has of frames that are no constants; those that the .src sets to another value of
        its own are left out.
    """

    integers: dict[str, int] = field(default_factory=dict)
    frames: dict[str, tuple[float, ...]] = field(default_factory=dict)
    stored: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def integer(self, code: bytes) -> int | None:
        """Return the value of a number or of the name of a constant; None if it is neither."""
        code = code.strip()
        if re.fullmatch(rb"\+?\d{1,4}(?:\.0*)?", code):
            return int(float(code))
        return self.integers.get(key_of(code))

    def frame(self, code: bytes) -> tuple[float, ...] | None:
        """Return the value of the name of a constant frame."""
        return self.frames.get(key_of(code))


NO_CONSTANTS: Final = Constants()


def key_of(code: bytes) -> str:
    """Return a name as `Constants` holds it."""
    return re.sub(rb"[ \t]", b"", code).decode("latin-1").upper()


def find_constants(dat: Source | None, src: Source) -> Constants:
    """Return the constants of a module with a private data list."""
    found = Constants()
    declared = [(dat, _OF_LIST), (src, _LOCAL)]
    lists = [(file, {m[1].upper() for m in names.finditer(file.data)}) for file, names in declared if file]
    spoilt: set[str] = set()
    for source, known in lists:
        for m in _FRAME.finditer(source.data) if known else ():
            key = key_of(m[1] + (m[2] or b""))
            if m[1].upper() not in known:
                continue
            pose = _pose(source, m.end())
            if pose is None or key in found.frames:
                spoilt.add(key)
            else:
                found.frames[key] = pose
    for m in _INTEGER.finditer(dat.data if dat else b""):
        found.integers[key_of(m[1] + (m[2] or b""))] = int(m[3])
    _, local = lists[-1]
    names = {key.partition("[")[0].encode() for key in (*found.integers, *found.frames)}
    changed = _changed(names, local, src) if names else set()
    if dat is not None:
        found.stored.update(_stored(dat, src))
    for table in (found.integers, found.frames):
        for key in [key for key in table if key in spoilt or key.partition("[")[0].encode() in changed]:
            del table[key]
    return found


def _stored(dat: Source, src: Source) -> dict[str, tuple[float, ...]]:
    """Return the values of frames of a data list that the .src neither hides nor sets to a value of its own."""
    names = {m[1].upper() for m in _LOCAL.finditer(dat.data)}
    for pattern in (_FRAME, _LOCAL, _COMPONENT) if names else ():
        names -= {m[1].upper() for m in pattern.finditer(src.data)}
    found: dict[str, tuple[float, ...]] = {}
    for m in _FRAME.finditer(dat.data):
        if m[1].upper() in names and (pose := _pose(dat, m.end())) is not None:
            found[key_of(m[1] + (m[2] or b""))] = pose
    return found


def _pose(source: Source, start: int) -> tuple[float, ...] | None:
    """Return the frame that begins at a brace; None where it is not complete, or part of an expression."""
    end = _REST.match(source.data, start)
    assert end is not None  # it begins with the brace
    line = source.line(start)
    close = closing_brace(source, start, end.end(), line)
    aggregate = parse_aggregate(source, start, close, line)
    if (
        set(aggregate.values) != set(CARTESIAN)
        or aggregate.loose
        or source.data[close : end.end()].strip()[:1] not in (b"", b";")
    ):
        return None
    return tuple(aggregate.values[key] for key in CARTESIAN)


def _changed(names: set[bytes], local: set[bytes], src: Source) -> set[bytes]:
    """Return the names that a statement may change, in upper case; `local` are declared here and assigned once."""
    changed: set[bytes] = set()
    assigned: set[bytes] = set()
    pattern = re.compile(rb"(?<![\w$.#])(?:" + b"|".join(map(re.escape, sorted(names))) + rb")(?!\w)", re.I)
    for m in pattern.finditer(src.data):
        start = max(src.data.rfind(end, 0, m.start()) for end in (b"\n", b"\r")) + 1
        before, name = src.data[start : m.start()], m[0].upper()
        if b";" in before:
            continue
        continued = src.data[:start].rstrip(b"\r\n").endswith(b"\\")
        if continued or not _HARMLESS.fullmatch(before):
            kind = b"DECL " if _DECLARES_FRAME.fullmatch(before) else b""
            once = name in local and (kind or (not before.strip() and _ASSIGNED.match(src.data, m.end())))
            if continued or not once or kind + name in assigned:
                changed.add(name)
            assigned.add(kind + name)
    return changed
