"""KRL's words: a lossless lexer, statements, and aggregates such as ``{X 812.5,Y -40.25,…}``.

A statement ends with its line, unless the line ends with a backslash. ``;`` starts a comment, ``&`` a header line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from truepose.programs.core.source import (
    LARGEST,
    LONGEST,
    NUMBER,
    UNICODE_BLANK,
    Source,
    Span,
    is_broken,
    parse_number,
    shown,
    strip,
)

LEXER: Final = re.compile(
    rb"\r\n|[\r\n]|[ \t]++|;[^\r\n]*+|\"[^\"\r\n]*+\"?|'[^'\r\n]*+'?|" + NUMBER + rb"|[A-Za-z_$][\w$]*+|\w++|[^\r\n]"
)
"""The whole file as tokens, every byte in one."""

_EOL = rb"(?:\r\n|\n|\r)"
_WS = rb"(?:[ \t]|\\[ \t]*+" + _EOL + rb")*+"
STATEMENT: Final = re.compile(
    rb"[ \t]*+(?:" + UNICODE_BLANK + rb"[ \t]*+)*+(?:&[^\r\n]*+|(?P<word>[A-Za-z_$][\w$]*+)?"
    rb"(?P<rest>(?:[^;\"\r\n\\]++|\"[^\"\r\n]*+\"|\\[ \t]*+" + _EOL + rb"|\\)*+)"
    rb"(?P<open>\"[^\r\n]*+)?(?:;[^\r\n]*+)?)(?:" + _EOL + rb"|\Z)"
)
"""One statement with its comment and line end: the first word, and the rest of the code."""

_COMPONENT = re.compile(
    _WS
    + rb"([A-Za-z_]\w*+)(?:\[\])?+"
    + _WS
    + rb"(?:("
    + NUMBER
    + rb")"
    + _WS
    + rb"|(\"[^\"]*+\"|[^,{}\"]*+)"
    + _WS
    + rb")(,|\})"
)
FindRun = Callable[[bytes, int], tuple[int, int]]
_COMMON_KEYS: Final = ("X", "Y", "Z", "A", "B", "C", "S", "T", "E1", "E2", "E3", "E4", "E5", "E6")
_COMMON = re.compile(
    rb"\{"
    + rb",[ \t]*+".join(key.encode() + rb"(?:[ \t]++|(?=[-+.]))(" + NUMBER + rb")" for key in _COMMON_KEYS[:6])
    + b"".join(rb"(?:,[ \t]*+" + key.encode() + rb"[ \t]++(" + NUMBER + rb")" for key in _COMMON_KEYS[6:])
    + rb")?+" * len(_COMMON_KEYS[6:])
    + rb"\}",
    re.I,
)
"""Fast path for the usual form of a point, cut off behind any key from C on; `parse_aggregate` reads all forms."""
_PREFIX = re.compile(rb"\{" + _WS + rb"(?:([A-Za-z_]\w*+)" + _WS + rb":)?")
_LITERAL = re.compile(rb"'\s*(?:B\s*([01]+)|H\s*([0-9A-F]+))\s*'", re.I)
_BRACE = re.compile(rb"[{}]|\"[^\"]*\"")
_FLAT = rb"\{(?:[^{}()\[\]\"']++|\[\]|\"[^\"]*+\")*+\}"
"""Braces around plain components, at once for speed."""
_PLAIN = re.compile(_FLAT)
_SEPARATOR = re.compile(_FLAT + rb"|[{}()\[\],]|\"[^\"]*\"|'[^']*'")

POSE_KEYS: Final = frozenset(["X", "Y", "Z", "A", "B", "C", "S", "T", "E1", "E2", "E3", "E4", "E5", "E6"])
BLANK: Final = b" \t\r\n\\"
"""Blanks, and continued line ends."""
JOINT_KEYS: Final = frozenset(["A1", "A2", "A3", "A4", "A5", "A6", "E1", "E2", "E3", "E4", "E5", "E6"])
CARTESIAN: Final = ("X", "Y", "Z", "A", "B", "C")


class Statement(NamedTuple):
    """The first word of a statement in upper case (empty if there is none), and the place of its code."""

    word: str
    line: int
    start: int
    rest: int
    end: int


class Aggregate(NamedTuple):
    """A literal structure.

    Attributes
    ----------
    prefix : str
        The type before a colon, in upper case.
    values : dict of str to float
        The components that are numbers, by name in upper case.
    spans : dict of str to (start, end)
        The bytes of these numbers.
    loose : dict of str to bytes
        All other components: expressions, enumerations, texts.
    """

    prefix: str
    values: dict[str, float]
    spans: dict[str, Span]
    loose: dict[str, bytes]

    @property
    def is_joint(self) -> bool:
        """Whether it holds joint values."""
        keys = self.values.keys() | self.loose.keys()
        return self.prefix in ("AXIS", "E6AXIS") or not keys.isdisjoint(JOINT_KEYS - POSE_KEYS)

    def integer(self, key: str) -> int | None:
        """Return an integer, decimal or as ``'B010'`` or ``'H0A'``; None if it is absent or an expression."""
        if key in self.values:
            value = self.values[key]
            return int(value) if value == int(value) else None
        found = _LITERAL.fullmatch(self.loose.get(key, b"").strip())
        if not found or found.end() > 40:
            return None
        return int(found[1], 2) if found[1] else int(found[2], 16)


class Lines(NamedTuple):
    """Whole lines of motions of one form; see `truepose.programs.krl.runs`."""

    line: int
    start: int
    end: int
    lines: int


def statements(source: Source) -> Iterator[Statement]:
    """Yield the statements with code; comments and headers have none."""
    for statement in pieces(source, lambda _, position: (position, 0), 1):
        assert isinstance(statement, Statement)
        yield statement


def pieces(source: Source, find_run: FindRun, fewest: int) -> Iterator[Statement | Lines]:
    """Yield the statements as `statements` does, but runs of lines of one form as one piece.

    Parameters
    ----------
    source : Source
        The file.
    find_run : callable
        A function of the bytes and a position that returns the end of a run that starts there, and its number of lines.
    fewest : int
        The smallest number of lines of a run.
    """
    data, line = source.data, 0
    position = looked = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while position < len(data):
        if position >= looked:
            looked, count = find_run(data, position)
            if count >= fewest:
                yield Lines(line + 1, position, looked, count)
                position, line = looked, line + count
                continue
        m = STATEMENT.match(data, position)
        assert m is not None  # it matches at every byte
        position = m.end()
        line += 1
        rest, end = m.span("rest")
        if rest < 0:
            continue
        if m["open"] is not None:
            raise source.error(line, 'a text that starts with " is not closed on this line; close it')
        word = m["word"]
        if word is not None:
            yield Statement(word.decode().upper(), line, m.start("word"), rest, end)
        elif end > rest:
            yield Statement("", line, rest, rest, end)
        if data.find(b"\\", rest, end) >= 0:
            line += len(re.findall(_EOL, data[rest:end]))


def parse_aggregate(source: Source, start: int, end: int, line: int) -> Aggregate:
    """Read the aggregate between two braces, `start` at the first and `end` behind the last."""
    data = source.data
    prefix = _PREFIX.match(data, start, end)
    assert prefix is not None
    values: dict[str, float] = {}
    spans: dict[str, Span] = {}
    loose: dict[str, bytes] = {}
    position = prefix.end()
    while position < end:
        m = _COMPONENT.match(data, position, end)
        if m is None or (m[4] == b"}") != (m.end() == end):
            raise source.error(
                line, f"broken aggregate {shown(data, start, end)}: expected name and value, comma, … }}"
            )
        key = m[1].decode().upper()
        if key in values or key in loose:
            raise source.error(line, f"aggregate {shown(data, start, end)} names {key} twice; keep one")
        if m[2] is not None:
            try:
                values[key] = parse_number(m[2])
            except ValueError as error:
                raise source.error(line, f"{key}: {error}; correct the file") from None
            spans[key] = m.span(2)
        else:
            text = m[3].strip()
            if is_broken(text) and not _LITERAL.fullmatch(text):
                raise source.error(line, f"{key} {shown(text, 0, len(text))} is not a number; correct the file")
            loose[key] = text
        position = m.end()
    if not values and not loose:
        raise source.error(line, "an aggregate without components; correct the file")
    return Aggregate(prefix[1].decode().upper() if prefix[1] else "", values, spans, loose)


def parse_point(source: Source, start: int, end: int, line: int) -> Aggregate:
    """Read an aggregate that is a pose or joint values; see `parse_aggregate`."""
    if (common := _COMMON.fullmatch(source.data, start, end)) is not None:
        count = common.lastindex or 0
        tokens = common.groups()[:count]
        values = list(map(float, tokens))
        if max(map(len, tokens)) <= LONGEST and min(values) >= -LARGEST and max(values) <= LARGEST:
            spans = map(common.span, range(1, count + 1))
            return Aggregate(
                "", dict(zip(_COMMON_KEYS, values, strict=False)), dict(zip(_COMMON_KEYS, spans, strict=False)), {}
            )
    aggregate = parse_aggregate(source, start, end, line)
    keys = aggregate.values.keys() | aggregate.loose.keys()
    known = JOINT_KEYS if aggregate.is_joint else POSE_KEYS
    if not keys <= known:
        names = ", ".join(sorted(keys - known))
        raise source.error(line, f"broken aggregate {shown(source.data, start, end)}: no point has {names} here")
    return aggregate


def closing_brace(source: Source, start: int, end: int, line: int) -> int:
    """Return the position behind the brace that closes the one at `start`, before `end`."""
    if plain := _PLAIN.match(source.data, start, end):
        return plain.end()
    depth = 0
    for m in _BRACE.finditer(source.data, start, end):
        depth += {b"{": 1, b"}": -1}.get(m[0], 0)
        if depth == 0:
            return m.end()
    raise source.error(line, f"the brace of {shown(source.data, start, end)} is not closed; correct the file")


def split_commas(data: bytes, start: int, end: int) -> list[Span]:
    """Return the pieces between commas outside brackets, without blanks at their ends.

    Raises
    ------
    ValueError
        If brackets do not pair.
    """
    cuts, depth = [start - 1], 0
    for m in _SEPARATOR.finditer(data, start, end):
        if m[0] == b"," and depth == 0:
            cuts.append(m.start())
        elif m[0] in b"{([":
            depth += 1
        elif m[0] in b"})]":
            depth -= 1
        if depth < 0:
            raise ValueError("brackets do not pair")
    if depth:
        raise ValueError("brackets do not pair")
    return [strip(data, a + 1, b, BLANK) for a, b in zip(cuts, [*cuts[1:], end], strict=True)]
