"""The values of VAL3 data (.dtx), with the bytes of their attributes.

The XML is parsed once and never written again. Values nest in structures: ``<Value key="0">`` of a structure holds
``<Field name="pPick" type="pointRx">`` with values of its own. Values of one form that follow each other stay columns
(`truepose.programs.core.forms`) and are hidden from the parser.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple
from xml.parsers import expat

from truepose._typing import IntArray
from truepose.errors import FileError
from truepose.programs.core.forms import NUMBER, Lines, RunFinder
from truepose.programs.core.points import NOT_HERE, numbers_at
from truepose.programs.core.source import NotAProgramError, Source, Span

KEYS: Final = ("x", "y", "z", "rx", "ry", "rz")
JOINT_KEYS: Final = ("j1", "j2", "j3", "j4", "j5", "j6")
POINTS: Final = ("pointRx", "point")
_ATTRIBUTE = re.compile(rb"([\w:.-]+)\s*=\s*(?:\"([^\"<]*)\"|'([^'<]*)')")
_LIST: Final = re.compile(rb"<Data\b[^<>]*?\btype=\"pointRx\"[^<>]*>[ \t]*\r?\n")
_RUN: Final = re.compile(
    rb"[ \t]*+<Value[ \t]++key=\"([0-9]{1,9}+)\""
    + b"".join(rb"[ \t]++" + key.encode() + rb"=\"(" + NUMBER + rb")\"" for key in KEYS)
    + rb"(?:[ \t]++(?:shoulder|elbow|wrist)=\"\w++\"){0,3}+[ \t]++fatherId=\"\w++(?:\[\w++\])?+\"[ \t]*+/>[ \t]*+\r?+\n"
)
"""A value as CAM systems write it; the general reader reads the first of many."""
_HOLES: Final = {1: rb"[0-9]{1,9}+"}
VALUES: Final = slice(1, 7)
"""The holes of its numbers, behind that of its key."""


class Step(NamedTuple):
    """A step of the way to a value: the name of the data or of a field, and the key."""

    name: str
    key: str

    def __str__(self) -> str:
        return self.name if self.key in ("0", "") else f"{self.name}[{self.key}]"


@dataclass(frozen=True, eq=False)
class Value:
    """One value.

    Attributes
    ----------
    kind : str
        Its type, such as ``pointRx``.
    way : tuple of Step
        Its names and keys, from the data down to the field.
    attributes : dict of str to (bytes, int)
        Its attributes, each with its first byte.
    line : int
        Its line.
    public : bool
        Whether other applications may use its data.
    run : Lines, optional
        The run of values whose first one this is.
    """

    kind: str
    way: tuple[Step, ...]
    attributes: dict[str, tuple[bytes, int]] = field(repr=False)
    line: int
    public: bool
    run: Lines | None = None

    @property
    def name(self) -> str:
        """Its name as programs write it."""
        return ".".join(map(str, self.way))

    def text(self, key: str) -> str:
        """Return an attribute; empty where it is not written."""
        return self.attributes[key][0].decode("latin-1") if key in self.attributes else ""

    def numbers(self, source: Source, keys: Sequence[str] = KEYS) -> tuple[tuple[float, ...], tuple[Span, ...]]:
        """Return the numbers of attributes, zero where not written, and the bytes of those that are."""
        written = [key for key in keys if key in self.attributes]
        tokens = [self.attributes[key][0].strip() for key in written]
        texts = [self.attributes[key] for key in written]
        starts = [start + len(text) - len(text.lstrip()) for text, start in texts]
        line = source.line(starts[0]) if starts else self.line
        numbers, spans = numbers_at(source, line, [f"{self.name} {key}" for key in written], tokens, starts)
        found = dict(zip(written, zip(numbers, spans, strict=True), strict=True))
        return (
            tuple([found[key][0] if key in found else 0.0 for key in keys]),
            tuple([found[key][1] if key in found else NOT_HERE for key in keys]),
        )


class Data(NamedTuple):
    """The declaration of data: its type, line, and whether other applications may use it."""

    kind: str
    line: int
    public: bool


class DataFile(NamedTuple):
    """What a .dtx holds: every value, and the declarations by name."""

    values: list[Value]
    declared: dict[str, Data]


def read_data(source: Source) -> DataFile:
    """Return what a .dtx holds.

    Raises
    ------
    FileError
        If it is broken, or no VAL3 data.
    """
    return _Parser(source).read()


def element_of(source: Source, run: Value, start: int, line: int, lines: Lines | None = None) -> Value:
    """Return the element of a run that starts at a byte; `lines` is the run that begins there."""
    m = _RUN.match(source.data, start)
    assert m is not None  # it is one of the run
    attributes = _attributes(source, source.data.index(b"<", start))
    return Value(run.kind, (Step(run.way[0].name, m[1].decode()),), attributes, line, run.public, lines)


class _Element(NamedTuple):
    """An open element: a value, or a <Data> or field with its type."""

    tag: str
    kind: str
    name: str
    way: tuple[Step, ...]


class _Parser:
    def __init__(self, source: Source) -> None:
        self._source = source
        self._found: list[Value] = []
        self._open: list[_Element] = []
        self._seen: dict[tuple[Step, ...], int] = {}
        self._declared: dict[str, Data] = {}
        self._ranges: dict[str, list[tuple[int, int, int]]] = {}
        self._public = True
        self._hidden_bytes = self._hidden_lines = 0
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.StartDoctypeDeclHandler = self._doctype

    def read(self) -> DataFile:
        """Parse the file, without its runs."""
        source, position = self._source, 0
        try:
            for run in self._runs():
                self._parser.Parse(source.data[position : run.start], False)
                position = run.start
                if self._take_run(run):
                    self._hidden_bytes += run.end - run.start
                    self._hidden_lines += run.items
                    position = run.end
            self._parser.Parse(source.data[position:], True)
        except expat.ExpatError as error:
            line, reason = error.lineno + self._hidden_lines, expat.ErrorString(error.code)
            raise source.error(line, f"is broken XML: {reason}; correct the file") from None
        except (ValueError, LookupError) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(source.path, "has an encoding that is not known; save it as UTF-8") from None
        if not self._declared:
            raise NotAProgramError(source.path, "has no <Data>: it is not a VAL3 data file")
        return DataFile(self._found, self._declared)

    def _runs(self) -> Iterator[Lines]:
        """Yield the runs at the beginning of arrays."""
        finder = RunFinder(self._source, _RUN, _HOLES)
        position = 0
        while m := _LIST.search(self._source.data, position):
            position = m.end()
            while (lines := finder.find(position)) is not None:
                yield lines
                position = lines.end

    def _take_run(self, run: Lines) -> bool:
        """Add a run of values; False where it does not stand directly in an array of points, or repeats a key."""
        top = self._open[-1] if self._open else None
        if top is None or top.tag != "Data" or top.kind != "pointRx":
            return False
        keys = run.columns(self._source.data, slice(0, 1))[0][:, 0].astype(int)
        first, last = int(keys[0]), int(keys[-1])
        ranges = self._ranges.setdefault(top.name, [])
        repeated = any(a <= last and first <= b for a, b, _ in ranges)
        if repeated or (keys[1:] - keys[:-1] != 1).any() or any(way in self._seen for way in self._ways(top, keys)):
            return False
        ranges.append((first, last, run.line))
        attributes = _attributes(self._source, self._source.data.index(b"<", run.start))
        way = (Step(top.name, str(first)),)
        self._found.append(Value(top.kind, way, attributes, run.line, public=self._public, run=run))
        return True

    def _ways(self, data: _Element, keys: IntArray) -> Iterator[tuple[Step, ...]]:
        return ((Step(data.name, str(key)),) for key in (keys.tolist() if self._seen else ()))

    def _line(self) -> int:
        return self._parser.CurrentLineNumber + self._hidden_lines

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line, top = self._line(), self._open[-1] if self._open else None
        kind, name, way = attributes.get("type", ""), attributes.get("name", ""), top.way if top else ()
        if tag == "Data":
            if (before := self._declared.get(name)) is not None:
                raise self._source.error(line, f"{name} is declared twice, first in line {before.line}; keep one")
            self._public = attributes.get("access", "").lower() != "private"
            self._declared[name] = Data(kind, line, self._public)
            way = ()
        elif tag == "Value" and top is not None and top.tag != "Value" and top.name:
            way = (*top.way, Step(top.name, attributes.get("key", "0")))
            self._value(top.kind, way, line)
            kind, name = "", ""
        self._open.append(_Element(tag, kind, name, way))

    def _value(self, kind: str, way: tuple[Step, ...], line: int) -> None:
        first = self._seen.get(way)
        if first is None and len(way) == 1 and way[0].key.isdecimal():
            key = int(way[0].key)
            first = next((at + key - a for a, b, at in self._ranges.get(way[0].name, ()) if a <= key <= b), None)
        if first is not None:
            shown = f"{'.'.join(map(str, way[:-1]))}{'.' if way[1:] else ''}{way[-1].name}[{way[-1].key}]"
            raise self._source.error(line, f"{shown} is given twice, first in line {first}; keep one")
        self._seen[way] = line
        attributes = _attributes(self._source, self._parser.CurrentByteIndex + self._hidden_bytes)
        self._found.append(Value(kind, way, attributes, line, public=self._public))

    def _end(self, _: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> None:
        raise self._source.error(self._line(), "has a DOCTYPE, which VAL3 data never have; remove it")


def _attributes(source: Source, start: int) -> dict[str, tuple[bytes, int]]:
    """Return the attributes of the tag at a byte, each with its value's first byte."""
    data = source.data
    found: dict[str, tuple[bytes, int]] = {}
    position = start + len(b"<Value")
    while True:
        while data[position : position + 1].isspace():
            position += 1
        m = _ATTRIBUTE.match(data, position)
        if m is None:
            return found
        k = 2 if m[2] is not None else 3
        found[m[1].decode("latin-1")] = (m[k], m.start(k))
        position = m.end()
