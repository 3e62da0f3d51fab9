"""The code of VAL3 programs (.pgx): statements, calls and references to data."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

from truepose._io import files
from truepose.programs.core.source import Source, parse_number

_HIDING: Final = re.compile(rb"<(?:Local|Parameter)\b[^>]*?\bname\s*=\s*[\"'](\w+)", re.I)
"""Parameters and local variables of a program hide the data of the application that have their names."""
_PARAMETER: Final = re.compile(rb"<Parameter\b(?=[^>]*?\bname\s*=\s*[\"'](\w+))([^>]*)", re.I)
_BY_VALUE: Final = re.compile(rb"\buse\s*=\s*[\"']value", re.I)
_TASK: Final = re.compile(rb"\btaskCreate", re.I)
_WORD: Final = re.compile(rb"(?<![\w.:])[A-Za-z_]\w*")
_CODE: Final = re.compile(rb"<Code>\s*(?:<!\[CDATA\[)?|(?:\]\]>)?\s*</Code>")
_TEXT: Final = re.compile(rb"//[^\r\n]*|\"[^\"\r\n]*\"")
_STEP = rb"[A-Za-z_]\w*\s*(?:\[[^\[\]\r\n]*\])?"
REFERENCE: Final = re.compile(rb"(?<![\w.:])(?:(\w+):)?(" + _STEP + rb"(?:\." + _STEP + rb")*)(?!\w)(?![ \t]*[:(])")
"""A reference to data, such as ``lib:tray[1].pPick``; a name with a bracket behind it is a function."""
_LEFT: Final = re.compile(rb"\s*(?:(\w+):)?([A-Za-z_]\w*)")
_WHOLE_LEFT: Final = re.compile(rb"\s*(?:\w+:)?\w+\s*(?:\[.*\]\s*)?(?:\.\s*\w+\s*(?:\[.*\]\s*)?)*", re.S)
_WRITTEN: Final = re.compile(rb"(?<![\w.:])(?:\w+:)?[A-Za-z_]\w*\s*(?:\[[^=\n]*\])?\s*\.[\w.\s]*=(?!=)")
"""A part of some data that is written, wherever that stands."""
_INDEX: Final = re.compile(rb"\[((?:[^\[\]]|\[[^\[\]]*\])*)\]")
_FUNCTION: Final = re.compile(rb"(?<![\w.])(?:(\w+):)?(\w+)[ \t]*\(")
_READING: Final = frozenset(
    b"movel movej movec movelf movejf movecf altermovel altermovej altermovec appro compose align distance position"
    b" here pointtojoint jointtopoint interpolatel interpolatec setframe link size open close waitendmove abs round"
    b" sqrt sin cos tan atan asin acos min max limit isinrange if while for until return sel chr tostring put putln"
    b" print popupmsg and or not xor elseif switch case delay wait watch call".split()
)
"""Functions and words before brackets that leave their arguments as they are; two of them have a rule of their own."""
_LOAD: Final = re.compile(rb"(?<![\w.])(\w+):lib(?:Load|Delete)\s*\(", re.I)
_SET_FRAME: Final = re.compile(rb"\bsetFrame\s*\(", re.I)
_LINK: Final = re.compile(rb"\blink\s*\(", re.I)
_CALLED: Final = re.compile(rb"(?<![\w.])(?:call\b|taskCreate\w*\b[^\r\n]*?,)\s*(?:(\w+):)?(\w+)\s*\(", re.I)
_CHANGES: Final = re.compile(rb"\b(?:call|link|setFrame|taskCreate\w*)\b", re.I)
_PART: Final = re.compile(rb"([A-Za-z_]\w*)\s*(?:\[([^\[\]]*)\])?")
_BORDER: Final = re.compile(
    rb"\s*(?:begin|end|if|elseif|else|endif|while|endwhile|for|endfor|do|until|switch|case|default|endswitch|return|"
    rb"call|wait|watch|delay|get\w*|taskcreate\w*)\b",
    re.I,
)
"""Statements at which control may come from elsewhere, or other programs may run."""


class Reference(NamedTuple):
    """A reference to data.

    Attributes
    ----------
    alias : str
        The library; empty for the application's own data.
    parts : tuple of (str, str or None)
        Names in lower case, each with its index: a number, "" for none, or None where it is known at run time only.
    start, end : int
        Its bytes.
    """

    alias: str
    parts: tuple[tuple[str, str | None], ...]
    start: int
    end: int

    @property
    def text(self) -> str:
        """The reference as the program has it, in lower case."""
        return self._said("")

    @property
    def key(self) -> str:
        """The reference as a key: equal for equal references, as no index is that of the first element."""
        return self._said("0")

    def _said(self, first: str) -> str:
        steps = [name if index in ("", first) else f"{name}[{index}]" for name, index in self.parts]
        return (self.alias + ":" if self.alias else "") + ".".join(steps)


class Handed(NamedTuple):
    """Data that a call hands to a program: the library of that program, its name, and the place of the argument."""

    reference: Reference
    line: int
    alias: str
    program: str
    place: int


class Statement(NamedTuple):
    """A statement: its line, its bytes, and whether values of variables are unknown behind it."""

    line: int
    start: int
    end: int
    is_border: bool


class ProgramCode:
    """A program.

    Attributes
    ----------
    path : Path
        The file.
    hidden : set of str
        The names, in lower case, that parameters and local variables hide.
    parameters : set of str
        Those of parameters alone.
    starts_tasks : bool
        Whether it starts tasks.
    source : Source
        Its text, with comments and texts blanked.
    """

    def __init__(self, path: Path) -> None:
        text = files.read_bytes(path)
        self.path = path
        self.hidden = {m[1].decode("latin-1").lower() for m in _HIDING.finditer(text)}
        self._given = [(m[1].lower(), _BY_VALUE.search(m[2]) is not None) for m in _PARAMETER.finditer(text)]
        self.parameters = {name.decode("latin-1") for name, _ in self._given}
        self.starts_tasks = _TASK.search(text) is not None
        self.source = Source(path, _TEXT.sub(lambda m: b" " * len(m[0]), text))

    @property
    def data(self) -> bytes:
        """The blanked text."""
        return self.source.data

    @property
    def name(self) -> str:
        """The name of the program in lower case."""
        return self.path.stem.lower()

    @cached_property
    def aliases(self) -> list[str]:
        """The libraries that it names."""
        return sorted({reference.alias for reference in self.references(0, len(self.data)) if reference.alias})

    def statements(self) -> Iterator[Statement]:
        """Yield the statements; one goes on over lines while a bracket is open."""
        data = self.data
        start, depth, first = -1, 0, 0
        for line, a, b in self.source.lines():
            if start < 0:
                start, first, depth = a, line, 0
            depth += sum(data.count(c, a, b) for c in (b"(", b"{")) - sum(data.count(c, a, b) for c in (b")", b"}"))
            if depth > 0 and line - first < 20:
                continue
            if data[start:b].strip():
                border = _BORDER.match(data, start, b) or _CODE.search(data, start, b)
                yield Statement(first, start, b, border is not None)
            start = -1

    def references(self, start: int, end: int) -> Iterator[Reference]:
        """Yield the references to data between two bytes; hidden names are none."""
        for m in REFERENCE.finditer(self.data, start, end):
            if (found := self._reference(m)) is not None:
                yield found

    def locals_in(self, statement: Statement) -> Iterator[tuple[str, int]]:
        """Yield the parameters and local variables that a statement names, each with its first byte."""
        if self.hidden:
            for m in _WORD.finditer(self.data, statement.start, statement.end):
                if (name := m[0].decode("latin-1").lower()) in self.hidden:
                    yield name, m.start()

    def reference(self, start: int, end: int) -> Reference | None:
        """Return the reference that a piece of code is; None if it is anything else, or hidden."""
        a, b = self.trim(start, end)
        m = REFERENCE.match(self.data, a, b)
        return self._reference(m) if m is not None and m.end() == b else None

    def local(self, start: int, end: int) -> str:
        """Return the parameter or local variable that a piece of code is; empty if it is anything else."""
        a, b = self.trim(start, end)
        text = self.data[a:b].decode("latin-1").lower()
        return text if text in self.hidden else ""

    def indices(self, start: int, end: int) -> list[tuple[int, int]]:
        """Return the bytes of the indices in a piece of code."""
        return [m.span(1) for m in _INDEX.finditer(self.data, start, end)]

    def left(self, statement: Statement) -> tuple[int, int] | None:
        """Return the left side of an assignment, whatever its indices are; None for any other statement."""
        depth, data = 0, self.data
        if (m := _LEFT.match(data, statement.start, statement.end)) is None:
            return None
        for i in range(m.end(), statement.end):
            c = data[i]
            if c == ord("["):
                depth += 1
            elif c == ord("]"):
                depth -= 1
            elif depth == 0 and c == ord("="):
                alone = data[i + 1 : i + 2] != b"=" and _WHOLE_LEFT.fullmatch(data, statement.start, i)
                return (statement.start, i) if alone else None
            elif depth == 0 and not (chr(c).isalnum() or c in b"_. \t:"):
                return None
        return None

    def array(self, start: int, end: int) -> Reference | None:
        """Return a reference to some element, which the run time knows, of what a piece of code begins with."""
        m = _LEFT.match(self.data, start, end)
        if m is None or (not m[1] and m[2].decode("latin-1").lower() in self.hidden):
            return None
        alias, name = (m[1] or b"").decode("latin-1").lower(), m[2].decode("latin-1").lower()
        return Reference(alias, ((name, None),), m.start(2), m.end())

    def loaded(self) -> Iterator[tuple[str, int]]:
        """Yield the libraries whose data are loaded anew, each with its line."""
        for m in _LOAD.finditer(self.data):
            yield m[1].decode("latin-1").lower(), self.source.line(m.start(1))

    def written(self) -> Iterator[tuple[Reference, int]]:
        """Yield the references that assignments, `setFrame`, `link` and other functions write, each with its line.

        A name that is handed to a function stands for the whole array.
        """
        for statement in self.statements():
            left = self.left(statement)
            if left is not None and (found := self.reference(*left) or self.array(*left)) is not None:
                yield found, self.source.line(found.start)
            some = [m.span() for m in _WRITTEN.finditer(self.data, left[1] if left else statement.start, statement.end)]
            if left is None and not statement.is_border and b"(" not in self.data[statement.start : statement.end]:
                some += [(one.start, one.end) for one in self.references(statement.start, statement.end)]
            for start, end in some:  # by a statement that is not understood
                if (found := self.array(start, end)) is not None:
                    yield found, self.source.line(start)
        for m in self._others(0, len(self.data)):
            for start, end in self.arguments(m.end(), min(m.end() + 1000, len(self.data))):
                if self.reference(start, end) is not None and (found := self.array(start, end)) is not None:
                    yield found, self.source.line(start)
        for pattern, written in ((_SET_FRAME, slice(3, None)), (_LINK, slice(1))):
            for m in pattern.finditer(self.data):
                for start, end in self.arguments(m.end(), min(m.end() + 1000, len(self.data)))[written]:
                    if (found := self.reference(start, end)) is not None:
                        yield found, self.source.line(start)

    def _others(self, start: int, end: int) -> list[re.Match[bytes]]:
        """Return the calls of functions that are not known to leave their arguments as they are."""
        calls = {m.end() for m in _CALLED.finditer(self.data, start, end)}
        found = _FUNCTION.finditer(self.data, start, end)
        return [m for m in found if m[2].lower() not in _READING and m.end() not in calls]

    def handed(self) -> Iterator[Handed]:
        """Yield the data that calls hand to programs."""
        for m in _CALLED.finditer(self.data):
            alias, name = (m[1] or b"").decode("latin-1").lower(), m[2].decode("latin-1").lower()
            for k, (start, end) in enumerate(self.arguments(m.end(), min(m.end() + 1000, len(self.data)))):
                if (found := self.reference(start, end)) is not None:
                    yield Handed(found, self.source.line(start), alias, name, k)

    def may_change(self, place: int) -> bool:
        """Return whether the program may change the argument of a parameter, by its place."""
        if place >= len(self._given):
            return True
        name, by_value = self._given[place]
        word = re.compile(rb"(?<![\w.:])" + name + rb"(?!\w)", re.I)
        return not by_value and any(
            _CHANGES.search(self.data, one.start, one.end) or self.left(one) or self._others(one.start, one.end)
            for one in self.statements()
            if word.search(self.data, one.start, one.end)
        )

    def _reference(self, m: re.Match[bytes]) -> Reference | None:
        parts = []
        position, end = m.start(2), m.end(2)
        while part := _PART.match(self.data, position, end):
            index = (part[2] or b"").strip()
            parts.append((part[1].decode("latin-1").lower(), index.decode() if index.isdigit() or not index else None))
            position = part.end() + 1
        alias = (m[1] or b"").decode("latin-1").lower()
        if not alias and parts[0][0] in self.hidden:
            return None
        return Reference(alias, tuple(parts), m.start(), m.end())

    def arguments(self, start: int, end: int) -> list[tuple[int, int]]:
        """Return the arguments of a call whose opening bracket ends at `start`; empty where it is not closed."""
        data, depth, first = self.data, 0, start
        found: list[tuple[int, int]] = []
        for i in range(start, end):
            c = data[i]
            if c in b"([{":
                depth += 1
            elif c in b")]}":
                if depth == 0:
                    return [*found, (first, i)]
                depth -= 1
            elif c == ord(",") and depth == 0:
                found.append((first, i))
                first = i + 1
        return []

    def constants(self, start: int, end: int) -> tuple[float, ...] | None:
        """Return the numbers of a constant ``{1,2,3,…}``; None for anything else."""
        a, b = self.trim(start, end)
        text = self.data[a:b]
        if not (text.startswith(b"{") and text.endswith(b"}")):
            return None
        try:
            return tuple([parse_number(token.strip()) for token in text[1:-1].split(b",")])
        except ValueError:
            return None

    def trim(self, start: int, end: int) -> tuple[int, int]:
        """Return a span without the blanks at its ends."""
        text = self.data[start:end]
        return start + len(text) - len(text.lstrip()), end - (len(text) - len(text.rstrip()))
