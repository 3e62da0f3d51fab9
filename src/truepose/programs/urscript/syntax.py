"""The words and statements of URScript."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator
from typing import Final, NamedTuple

from truepose.programs.core.forms import BLANKS, NUMBER, Lines
from truepose.programs.core.source import Source, Span, strip

_BRACKET: Final = re.compile(rb"[()\[\]]")
_HEAD: Final = rb"(?:def|thread|sec|if|elif|else|while)"
_WORDS: Final = rb"(?<![\w.])(?:" + _HEAD + rb"|end|break|continue|return|halt)(?!\w)"
_SEVERAL: Final = re.compile(rb";|:\s*\S|(?<=[^\s.])\s*" + _WORDS)
"""What a line with several statements has."""
_CUT: Final = re.compile(rb"[()\[\]:;]|" + _WORDS)
_PIECE = re.compile(
    rb"#[^\r\n]*|\"[^\"\r\n]*\"|'[^'\r\n]*'|(?P<open>[\"'])|(?P<end>\r\n|[\r\n])|(?P<bracket>[()\[\]])", re.S
)
ROUTINE = re.compile(rb"\s*(def|thread|sec)\s+(\w+)\s*\(")
BLOCK = re.compile(rb"\s*(if|elif|else\s+if|else|while)\b.*:\s*$", re.S)
WORD = re.compile(rb"\s*(\w+)")
ASSIGN = re.compile(rb"\s*(?:(global|local)\s+)?([A-Za-z_]\w*)\s*(\[[^\]]*\])?\s*=(?!=)\s*")
VARIABLE = re.compile(rb"[A-Za-z_]\w*")
NAME = re.compile(rb"(?<![\w.])([A-Za-z_]\w*)(\s*\()?")
KEYWORD = re.compile(rb"(?<=[(,])\s*[A-Za-z_]\w*\s*=(?!=)")
ARGUMENT = re.compile(rb"([A-Za-z_]\w*)\s*=(?!=)\s*")
"""The name of an argument of a call."""
COUNT = re.compile(rb"(?<![\w.])(size|length|get_list_length)\s*\(\s*[A-Za-z_]\w*\s*\)")
"""The length of a list."""
MOTION = re.compile(rb"(?<![\w.])(move[jlpc]|servo[jclp]|speed[jl]|optimove[jl])\s*\(")
STRANGE = re.compile(rb"(?<![\w.])(\w*(?:move|servo)\w*)\s*\(\s*p\s*\[")
AT_RUN_TIME: Final = frozenset(["servoj", "servol", "servop", "servoc", "speedl", "speedj"])
_OPERATORS: Final = frozenset([b"if", b"elif", b"while", b"return", b"and", b"or", b"xor", b"not"])
SHORTENED: Final = re.compile(rb"(?<![\w.])(?:and|or)(?!\w)")
"""Behind these words an expression may be left out."""
POSE = re.compile(rb"p\s*\[")
TAKES_POSES: Final = re.compile(
    r"add_frame|attach_frame|convert_pose|end_force_mode|force_mode|get_forward_kin|get_inverse_kin|"
    r"get_inverse_kin_has_solution|get_list_length|get_pose|interpolate_pose|is_within_safety_limits|length|"
    r"move_frame|norm|path_offset_set|point_dist|popup|pose_add|pose_dist|pose_inv|pose_sub|pose_trans|"
    r"set_gravity|set_payload|set_target_payload|set_tcp|size|socket_send_line|socket_send_string|str_cat|"
    r"textmsg|to_str|track_conveyor_circular|track_conveyor_linear|wrench_trans"
)
"""The language's own functions that may be given a pose and move nowhere; motions apart."""
RUN: Final = re.compile(
    BLANKS
    + rb"move[lpj]"
    + BLANKS
    + rb"\("
    + BLANKS
    + rb"p\["
    + rb",".join([BLANKS + b"(" + NUMBER + b")" + BLANKS] * 6)
    + rb"\]"
    + (rb"(?:[ \t]*+,[ \t]*+[avtr][ \t]*+=[ \t]*+([0-9]{1,6}+(?:\.[0-9]{0,15}+)?+))?+" * 4)
    + BLANKS
    + rb"\)[ \t]*+\r?+\n"
)
"""A motion to a pose in the motion itself, which may be one of many; the general reader reads the first of them."""


class Statement(NamedTuple):
    """A statement: a line, or several where brackets are open."""

    line: int
    start: int
    end: int
    code: bytes
    """With texts and comments blanked, byte by byte in place."""
    run: Lines | None = None
    """The run whose first line this is."""


def statements(
    source: Source, find: Callable[[int], Lines | None] = lambda _: None, start: int = 0, end: int | None = None
) -> Iterator[Statement]:
    """Yield the statements between two bytes: a line, or several where brackets are open, or the first line of a run.

    `find` is a function of a line's start that returns the run that starts there.
    """
    position, end = start, len(source.data) if end is None else end
    while position < end:
        position, lines = yield from _to_next_run(source, find, position, end)
        while lines is not None:
            behind = source.data.find(b"\n", lines.start) + 1
            yield next(statements(source, start=lines.start, end=behind))._replace(run=lines)
            position = lines.end
            lines = find(position)


def _to_next_run(
    source: Source, find: Callable[[int], Lines | None], start: int, end: int
) -> Generator[Statement, None, tuple[int, Lines | None]]:
    """Yield the statements before the next run; return the byte behind them, and the run."""
    data = source.data
    depth = opened = 0
    done = start
    parts: list[bytes] = []
    for m in _PIECE.finditer(data, start, end):
        if m["open"]:
            raise source.error(
                source.line(m.start()), f"a text that starts with {m[0].decode()} is not closed; close it"
            )
        if m["bracket"]:
            depth += 1 if m[0] in b"([" else -1
            opened = m.start() if depth == 1 and m[0] in b"([" else opened
            if depth < 0:
                raise source.error(source.line(m.start()), f"{m[0].decode()} closes nothing; correct the file")
            continue
        parts += [data[done : m.start()], b" " * len(m[0])]
        done = m.end()
        if m["end"] and depth == 0:
            code = b"".join(parts)
            if code.strip():
                yield Statement(source.line(start + len(code) - len(code.lstrip())), start, m.end(), code)
            start, parts = m.end(), []
            if (lines := find(start)) is not None:
                return start, lines
    if depth:
        raise source.error(source.line(opened), "a bracket is not closed: the file is truncated or broken")
    code = b"".join([*parts, data[done:end]])
    if code.strip():
        yield Statement(source.line(start + len(code) - len(code.lstrip())), start, end, code)
    return end, None


def split(statement: Statement) -> Iterator[Statement]:
    """Yield the statements of a line that holds several, such as ``if x: set_tcp(t) end``; usually the line itself."""
    code = statement.code
    if not _SEVERAL.search(code):
        yield statement
        return
    start = depth = 0
    for m in _CUT.finditer(code):
        before = code[start : m.start()].strip()
        if m[0] in b"()[]":
            depth += 1 if m[0] in b"([" else -1
        elif (
            depth
            or (m[0] == b":" and not re.match(_HEAD + rb"(?!\w)", before))
            or (m[0] == b"if" and before == b"else")
        ):
            continue
        else:
            cut = m.end() if m[0] in b":;" else m.start()
            if before:
                yield _piece(statement, start, cut if m[0] == b":" else m.start())
            start = cut
    if code[start:].strip():
        yield _piece(statement, start, len(code))


def _piece(statement: Statement, start: int, end: int) -> Statement:
    return statement._replace(start=statement.start + start, code=statement.code[start:end])


def calls(code: bytes) -> list[re.Match[bytes]]:
    """Return the calls in a statement in the order in which they are made: arguments before their function."""
    at = {m.end() - 1: m for m in NAME.finditer(code) if m[2] and m[1] not in _OPERATORS}
    found: list[re.Match[bytes]] = []
    opened: list[re.Match[bytes] | None] = []
    for bracket in _BRACKET.finditer(code) if at else ():
        if bracket[0] in b"([":
            opened.append(at.get(bracket.start()))
        elif opened and (m := opened.pop()) is not None:
            found.append(m)
    return found


def arguments(code: bytes, start: int) -> list[Span]:
    """Return the spans of a call's arguments, `start` behind its bracket."""
    depth, begin, spans = 0, start, []
    for k in range(start, len(code)):
        c = code[k : k + 1]
        if c in b"([":
            depth += 1
        elif c in b")]" and depth:
            depth -= 1
        elif c == b")":
            spans.append(strip(code, begin, k))
            break
        elif c == b"," and depth == 0:
            spans.append(strip(code, begin, k))
            begin = k + 1
    return spans
