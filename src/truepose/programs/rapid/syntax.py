"""RAPID's words: tokens, statements, arguments, and bracketed values.

A statement ends at ``;``, or where a structure opens or closes: THEN, DO, ELSE, the colon of CASE, ENDIF and the like.
A placeholder, such as ``<SMT>`` where the teach pendant got nothing, is a statement of its own and empty.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator
from typing import Final, NamedTuple

from truepose.errors import FileError
from truepose.programs.core.forms import Lines
from truepose.programs.core.source import BLANK, NUMBER, Source

_LETTER: Final = rb"(?!" + BLANK + rb")[\x80-\xff]"
_TOKEN: Final = re.compile(
    rb"(?P<blank>[ \t\r\n\f\v\x00\x1a]++|![^\r\n]*+|" + BLANK + rb")"
    rb"|(?P<text>\"(?:[^\"\r\n]|\"\")*+\")|(?P<open>\"[^\r\n]*+)"
    rb"|(?P<number>" + NUMBER + rb")|(?P<word>(?:[A-Za-z_]|" + _LETTER + rb")\w*+(?:" + _LETTER + rb"\w*+)*+)"
    rb"|(?P<placeholder><[A-Za-z]{2,4}+>)|(?P<mark>:=|<>|<=|>=|\w+|.)",
    re.S,
)
_HEADER = re.compile(rb"\s*%%%.*?%%%|(?:\xef\xbb\xbf)?", re.S)
_CLOSING: Final = ["MODULE", "PROC", "FUNC", "TRAP", "IF", "FOR", "WHILE", "TEST", "RECORD"]
_ALONE: Final = frozenset([*("END" + word for word in _CLOSING), "ELSE", "UNDO", "BACKWARD"])
_FIRST: Final = frozenset([*("END" + word for word in _CLOSING), "PROC", "FUNC", "TRAP", "RECORD", "ELSE", "ELSEIF"])
"""Words that begin a statement, whatever is in front of them; outside of brackets those of `_DATA`, too."""
_DATA: Final = frozenset(["CONST", "PERS", "VAR"])
_OPENS: Final = {"(": ")", "[": "]", "{": "}"}
_INDENT: Final = 64
"""Largest number of blanks in front of the first line of a run."""
_OPERATORS: Final = frozenset(["AND", "OR", "NOT", "XOR", "DIV", "MOD"])


FindLines = Callable[[int], Lines | None]


class Token(NamedTuple):
    """A word (in upper case), number, text, placeholder or mark, and its place."""

    kind: str
    text: str
    start: int
    end: int


class Argument(NamedTuple):
    r"""An argument of a call: positional, ``\Name:=value``, or (`required`) ``Name:=value``."""

    name: str
    tokens: list[Token]
    required: bool = False


Value = list["Value"] | list[Token]
"""A bracketed value: a list of values; or the tokens between two commas."""


def tokens(source: Source, start: int = 0, end: int | None = None) -> Iterator[Token]:
    """Yield all tokens between two bytes but blanks and comments."""
    data = source.data
    header = None if start else _HEADER.match(data)
    for m in _TOKEN.finditer(data, header.end() if header else start, len(data) if end is None else end):
        kind = m.lastgroup
        if kind == "blank":
            continue
        if kind == "open":
            raise source.error(source.line(m.start()), 'a text that starts with " is not closed on this line; close it')
        text = m[0].decode("latin-1")
        yield Token(kind or "mark", text.upper() if kind == "word" else text, m.start(), m.end())


def statements(source: Source, start: int = 0, end: int | None = None) -> Iterator[list[Token]]:
    """Yield the statements between two bytes, without their semicolons."""
    for piece in pieces(source, lambda _: None, start, end):
        assert isinstance(piece, list)
        yield piece


def pieces(source: Source, find: FindLines, start: int = 0, end: int | None = None) -> Iterator[list[Token] | Lines]:
    """Yield the statements as `statements` does, but runs of lines of one form as one piece.

    `find` is a function of a line's start that returns the run that starts there.
    """
    position = start
    while position >= 0:
        position = yield from _to_next_run(source, find, position, end)


def _to_next_run(
    source: Source, find: FindLines, start: int, end: int | None
) -> Generator[list[Token] | Lines, None, int]:
    """Yield the statements before the next run, and that; return the byte behind it, −1 where there is no run."""
    now: list[Token] = []
    brackets: list[Token] = []
    for token in tokens(source, start, end):
        if token.text in ("CASE", "DEFAULT", "ENDTEST") and token.kind == "word" and now and now[0].text == "TEST":
            _closed(source, brackets)
            yield now
            now = []
        if _header_done(now, brackets, token):
            yield now
            now = []
        if not now and (lines := _run_at(source, find, token.start)) is not None:
            yield lines
            return lines.end
        if token.kind == "placeholder" and not brackets and (not now or token.text.upper() == "<SMT>"):
            if now:
                yield now
            now = []
            continue
        first = token.kind == "word" and (token.text in _FIRST or (token.text in _DATA and not brackets))
        if first and _is_cut(now):
            raise _unfinished(source, now)
        if token.kind == "mark" and token.text in _OPENS:
            brackets.append(token)
        elif (
            token.kind == "mark"
            and token.text in _OPENS.values()
            and (not brackets or _OPENS[brackets.pop().text] != token.text)
        ):
            raise source.error(source.line(token.start), f"{token.text} closes nothing; correct the file")
        if token.text == ";" and token.kind == "mark":
            _closed(source, brackets)
            if now:
                yield now
            now = []
            continue
        now.append(token)
        if not brackets and _ends(now):
            yield now
            now = []
    _closed(source, brackets)
    if now:
        raise source.error(
            source.line(now[0].start), f"the statement {now[0].text} … has no end: the file is truncated"
        )
    return -1


def _is_cut(now: list[Token]) -> bool:
    """Return whether a statement is open that another one cannot be part of; LOCAL and TASK stand before others."""
    return bool(now) and not (len(now) == 1 and now[0].text in ("LOCAL", "TASK"))


def _unfinished(source: Source, now: list[Token]) -> FileError:
    return source.error(source.line(now[0].start), f"the statement {now[0].text} … has no semicolon; correct the file")


def _run_at(source: Source, find: FindLines, start: int) -> Lines | None:
    """Return the run that starts with the line of a byte, if nothing but blanks is in front of the byte."""
    line = source.data.rfind(b"\n", max(0, start - _INDENT), start) + 1
    return find(line) if line and not source.data[line:start].strip(b" \t") else None


def _closed(source: Source, brackets: list[Token]) -> None:
    if brackets:
        raise source.error(source.line(brackets[-1].start), f"{brackets[-1].text} is not closed; correct the file")


def _header_done(now: list[Token], brackets: list[Token], token: Token) -> bool:
    """Return whether a routine's or module's head is complete before this token."""
    if not now or brackets:
        return False
    words = [t.text for t in now[:2] if t.kind == "word"]
    if now[0].text == "ERROR" and len(now) == 1:
        return token.text != "(" and token.text != ":="
    if now[0].text == "ERROR":
        return now[1].text == "(" and now[-1].text == ")"
    head = 1 if words and words[0] in ("LOCAL", "TASK") else 0
    if len(words) <= head or words[head] not in ("MODULE", "PROC", "FUNC", "TRAP", "RECORD"):
        return False
    if words[head] in ("PROC", "FUNC") or now[-1].text == ")":
        return now[-1].text == ")"
    return len(now) == head + 2 and token.text != "("


def _ends(now: list[Token]) -> bool:
    first, last = now[0].text, now[-1].text
    if now[0].kind != "word":
        return False
    if len(now) == 1 and first in _ALONE:
        return True
    if first in ("IF", "ELSEIF") and last == "THEN":
        return True
    if first in ("FOR", "WHILE") and last == "DO":
        return True
    return last == ":" and now[-1].kind == "mark" and (first in ("CASE", "DEFAULT") or len(now) == 2)


def split_compact_if(statement: list[Token]) -> tuple[list[Token], list[Token]]:
    """Return condition and instruction of ``IF condition instruction``; the latter may start with ``%``."""
    depth = 0
    for i, token in enumerate(statement[1:], 1):
        if token.kind == "mark":
            depth += (token.text in _OPENS) - (token.text in _OPENS.values())
        before = statement[i - 1]
        operand = (
            before.kind in ("number", "text", "placeholder")
            or before.text in (")", "]", "}")
            or before.text[0].isdigit()  # such as 0xFF
            or (before.kind == "word" and before.text not in _OPERATORS and i > 1)
        )
        starts = (token.kind == "word" and token.text not in _OPERATORS) or token.text == "%"
        if depth == 0 and starts and operand:
            return statement[1:i], statement[i:]
    return statement[1:], []


def runs_on(statement: list[Token]) -> bool:
    """Return whether a value follows another one without a mark between them, as where a semicolon is missing."""
    ended = False
    for i, token in enumerate(statement[1:]):
        kind, text = token.kind, token.text
        if kind == "word" and (text in _OPERATORS or text == "WITH"):
            ended = False
            continue
        opens = text == "[" if kind == "mark" and not text[0].isdigit() else text[0] not in "+-"  # the sign of a number
        if ended and opens and i:
            return True
        ended = kind != "mark" or text in (")", "]", "}") or text[0].isdigit()
    return False


def split(items: list[Token]) -> list[list[Token]]:
    """Return the pieces between commas outside brackets."""
    pieces: list[list[Token]] = [[]]
    depth = 0
    for token in items:
        if token.kind == "mark":
            depth += (token.text in _OPENS) - (token.text in _OPENS.values())
        if depth == 0 and token.text == "," and token.kind == "mark":
            pieces.append([])
        else:
            pieces[-1].append(token)
    return pieces


def arguments(items: list[Token]) -> list[Argument]:
    r"""Return the arguments of a call; ``\Opt`` may follow a comma or an argument directly."""
    found: list[Argument] = []
    for piece in split(items):
        depth, part, name = 0, list[Token](), ""
        parts: list[tuple[str, list[Token]]] = []
        for k, token in enumerate(piece):
            if token.kind == "mark":
                depth += (token.text in _OPENS) - (token.text in _OPENS.values())
            if depth == 0 and token.text == "\\":
                parts.append((name, part))
                part, name = [], piece[k + 1].text if k + 1 < len(piece) else "?"
            else:
                part.append(token)
        parts.append((name, part))
        for name, part in parts:
            given = part[2:] if len(part) > 1 and part[1].text == ":=" else []
            if name:  # \Name, \Name:=value, or \Name?value, which keeps the mark
                found.append(Argument(name, given or (part[1:] if len(part) > 1 and part[1].text == "?" else [])))
            elif given:
                found.append(Argument(part[0].text, given, required=True))
            elif part:
                found.append(Argument("", part))
    return found


def value(items: list[Token]) -> Value:
    """Return a bracketed value as lists; anything else as its tokens."""
    if len(items) > 1 and items[0].text == "[" and items[-1].text == "]" and _pairs(items):
        return [value(piece) for piece in split(items[1:-1])]
    return items


def _pairs(items: list[Token]) -> bool:
    """Return whether the first bracket is closed by the last."""
    depth = 0
    for i, token in enumerate(items):
        if token.kind == "mark":
            depth += (token.text in _OPENS) - (token.text in _OPENS.values())
        if depth == 0:
            return i == len(items) - 1
    return False


def is_list(item: Value) -> bool:
    """Return whether a value has brackets of its own."""
    return bool(item) and isinstance(item[0], list)


def looks_like_robtarget(item: Value) -> bool:
    """Return whether a value is a list of four lists."""
    return is_list(item) and len(item) == 4 and all(isinstance(group, list) and is_list(group) for group in item)


def elements(item: Value, dimensions: int, index: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], Value]]:
    """Yield the elements of an array's value, counted from 1, each with its index."""
    if not dimensions:
        yield index, item
    elif is_list(item):
        for i, part in enumerate(item, 1):
            if isinstance(part, list):
                yield from elements(part, dimensions - 1, (*index, i))


def is_variable(items: list[Token]) -> bool:
    """Return whether code names a variable, an element or a component of one: ``w1.uframe``, ``p{2}.trans.x``."""
    while items and items[0].kind == "word":
        items = items[1:]
        if items and items[0].text == "{":
            depth = [(token.text == "{") - (token.text == "}") for token in items]
            items = items[next((k for k in range(len(items)) if sum(depth[: k + 1]) == 0), len(items)) + 1 :]
        if not items:
            return True
        if items[0].text != ".":
            return False
        items = items[1:]
    return False


def constant_index(items: list[Token]) -> tuple[int, ...] | None:
    """Return the numbers in ``{2,1}``; () where there are no braces, None where only the run time knows."""
    if not items:
        return ()
    inside = [token.text for token in items[1:-1] if token.text != ","]
    return tuple([int(n) for n in inside]) if all(n.isascii() and n.isdigit() and len(n) < 6 for n in inside) else None


def position_of(mark: str, items: list[Token]) -> int:
    """Return the position of a mark outside brackets; 0 if there is none."""
    depth = 0
    for i, token in enumerate(items):
        if token.kind == "mark":
            depth += (token.text in _OPENS) - (token.text in _OPENS.values())
            if depth == 0 and token.text == mark:
                return i
    return 0


class RoutineParameter(NamedTuple):
    """A routine's parameter; `writable` if the routine may change the argument, `stored` if that is a PERS."""

    name: str
    type: str
    writable: bool
    optional: bool
    array: bool = False
    stored: bool = False

    @property
    def is_point(self) -> bool:
        """Whether it is a copy of a robtarget."""
        return self.type == "ROBTARGET" and not (self.writable or self.optional or self.array)


def parameters(head: list[Token]) -> tuple[RoutineParameter, ...]:
    """Return a routine's parameters."""
    start = next((i for i, token in enumerate(head) if token.text == "("), len(head))
    found = []
    for piece in split(head[start + 1 : -1]):
        words: list[str] = []
        optional = False
        for k, token in enumerate(piece):
            if token.text in ("\\", "|"):
                words, optional = [], optional or token.text == "\\"
            elif token.kind == "word":
                words.append(token.text)
                if k + 1 == len(piece) or piece[k + 1].text in ("|", "{", "\\"):
                    writable = not {"VAR", "PERS", "INOUT"}.isdisjoint(words[:-1])
                    array = k + 1 < len(piece) and piece[k + 1].text == "{"
                    type_ = words[-2] if len(words) > 1 else ""
                    found.append(RoutineParameter(token.text, type_, writable, optional, array, "PERS" in words[:-1]))
    return tuple(found)
