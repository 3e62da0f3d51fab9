"""Stäubli VAL3 (.dtx): points of an application's data, with the frames and tools of the same file.

The uses of a point are read from the programs (.pgx) beside the file. Without any, every point counts as one that is
moved to. Other applications use public data as `library:name`, so public points are judged over a folder and refused in
a file that is read alone. The XML is never written again: only digits of attributes change.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final
from xml.parsers import expat

import numpy as np

from truepose._io import files
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.points import (
    AS_MEASURED,
    JOINTS,
    NOT_HERE,
    FileLine,
    Frame,
    Point,
    Problem,
    Use,
    numbers_at,
)
from truepose.programs.core.program import Key, KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import Source

_ATTRIBUTE = re.compile(rb"([\w:.-]+)\s*=\s*(?:\"([^\"<]*)\"|'([^'<]*)')")
_KEYS: Final = ("x", "y", "z", "rx", "ry", "rz")
_MOVE = re.compile(rb"(?<![\w:])((?:alter)?mov(?:e)?([jlc])(f?))\s*\(\s*", re.I)
_ALTER = re.compile(rb"(?<![\w:])alter(?:Begin|Mov\w*)?\s*\(", re.I)
_HIDING = re.compile(rb"<(?:Local|Parameter)\b[^>]*?\bname\s*=\s*[\"'](\w+)", re.I)
"""Parameters and local variables of a program hide the data of the application that have their names."""
_ROOTS: Final = {"world": 0, "flange": 0}
_FATHER = re.compile(r"(\w+)(?:\[([0-9]{1,9})\])?")
_POINTS: Final = ("pointRx", "point")
_PUBLIC: Final = Problem(
    "refuse",
    "it is public: another application may move to it or write it; give the folder with all applications, state that "
    "none does (--whole-task), or make it private",
)


class _Value:
    """One <Value> of one <Data>: its attributes with their bytes."""

    def __init__(
        self, data: str, key: str, attributes: dict[str, tuple[bytes, int]], line: int, *, public: bool
    ) -> None:
        self.data, self.key, self.attributes, self.line, self.public = data, key, attributes, line, public

    @property
    def name(self) -> str:
        return self.data if self.key in ("0", "") else f"{self.data}[{self.key}]"

    def text(self, key: str) -> str:
        return self.attributes[key][0].decode("latin-1") if key in self.attributes else ""


def read(path: Path, frames: KnownFrames, options: ReadOptions, *, folder: Path | None = None) -> Program:
    """Read a .dtx file; `folder` holds all applications that may use its public data."""
    source = Source.read(path)
    values = _values(source)
    tables: dict[str, dict[str, _Value]] = {"frame": {}, "tool": {}}
    reader = Reader(source, frames, options)
    points = reader.points
    named: dict[str, list[Point]] = {}
    for kind, value in values:
        if kind in tables:
            tables[kind][value.name] = value
    chains = {kind: _FrameChain(source, table) for kind, table in tables.items()}
    for kind, value in values:
        if kind.startswith("joint"):
            points.append(Point(value.name, source, value.line, problem=JOINTS))
        elif kind in _POINTS:
            points.append(_point(source, value, options))
        else:
            continue
        named.setdefault(value.data.lower(), []).append(points[-1])
        frame = chains["frame"].named(value.text("fatherId")) if kind in _POINTS else None
        if kind in _POINTS and frame is None and points[-1].problem is None:
            points[-1].problem = Problem("refuse", "it has no fatherId: its frame is not known")
        points[-1].uses.append(reader.use(kind, value.line, None, frame))
    reader.changed.update(_uses(path, named, chains["tool"], tables["frame"]))
    public = {value.data.lower() for _, value in values if value.public}
    if folder is not None:
        reader.changed = {**_foreign_uses(path, folder, named, public, tables["frame"]), **reader.changed}
    elif not options.whole_task:
        for name in public & named.keys():
            for point in named[name]:
                point.problem = point.problem or _PUBLIC
    return reader.program("staubli", tool=Frame(AS_MEASURED))


def _values(source: Source) -> list[tuple[str, _Value]]:
    """Return every <Value>, with the type of its <Data>."""
    found: list[tuple[str, _Value]] = []
    data: list[tuple[str, str, bool]] = []
    seen: dict[tuple[str, str], int] = {}
    names: dict[str, int] = {}
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        line = parser.CurrentLineNumber
        if tag == "Data":
            name = attributes.get("name", "")
            if name in names:
                raise source.error(line, f"{name} is declared twice, first in line {names[name]}; keep one")
            names[name] = line
            data.append((attributes.get("type", ""), name, attributes.get("access", "").lower() != "private"))
        elif tag == "Value" and data:
            kind, name, public = data[-1]
            key = attributes.get("key", "0")
            if (name, key) in seen:
                raise source.error(line, f"{name}[{key}] is given twice, first in line {seen[name, key]}; keep one")
            seen[name, key] = line
            attributes_at = _attributes(source, parser.CurrentByteIndex)
            found.append((kind, _Value(name, key, attributes_at, line, public=public)))

    def end(tag: str) -> None:
        if tag == "Data":
            data.pop()

    def doctype(*_: object) -> None:
        raise source.error(parser.CurrentLineNumber, "has a DOCTYPE, which VAL3 data never have; remove it")

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
    try:
        parser.Parse(source.data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise source.error(error.lineno, f"is broken XML: {reason}; correct the file") from None
    except (ValueError, LookupError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(source.path, "has an encoding that is not known; save it as UTF-8") from None
    if not names:
        raise FileError(source.path, "has no <Data>: it is not a VAL3 data file")
    return found


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


def _point(source: Source, value: _Value, options: ReadOptions) -> Point:
    point = Point(value.name, source, value.line)
    point.values, point.spans = _numbers(source, value)
    words = [value.text(key) for key in ("shoulder", "elbow", "wrist")]
    point.configuration = " ".join(word for word in words if word)
    written = _KEYS if options.orientation else _KEYS[:3]
    missing = [key for key in written if key not in value.attributes]
    if missing:
        reason = f"{', '.join(missing)} not written, so 0: nothing is added to a file"
        point.problem = Problem("skip", reason)
    return point


def _numbers(source: Source, value: _Value) -> tuple[tuple[float, ...], tuple[tuple[int, int], ...]]:
    """Return the numbers of a value and their spans; one that is not there is 0, VAL3's default."""
    there = [key for key in _KEYS if key in value.attributes]
    values, spans = dict.fromkeys(_KEYS, 0.0), dict.fromkeys(_KEYS, NOT_HERE)
    if there:
        tokens, starts = zip(*(value.attributes[key] for key in there), strict=True)
        names = [f"{value.name} {key}" for key in there]
        found = numbers_at(source, source.line(starts[0]), names, tokens, starts)
        values.update(zip(there, found[0], strict=True))
        spans.update(zip(there, found[1], strict=True))
    return tuple(values.values()), tuple(spans.values())


class _FrameChain:
    """Frames, or tools, of the file, followed to world or flange."""

    def __init__(self, source: Source, table: dict[str, _Value]) -> None:
        self._source = source
        self._table = {name.lower(): value for name, value in table.items()}

    def named(self, father: str) -> Frame | None:
        """Return the frame that a fatherId names; None if it names none."""
        m = _FATHER.fullmatch(father.strip())
        if m is None:
            return None
        name = m[1] if m[2] in (None, "0") else f"{m[1]}[{int(m[2])}]"
        if name.lower() in _ROOTS:
            return Frame(name, 0)
        tf = self._follow(name, ())
        return Frame(name, name, None if tf is None else tf.tobytes())

    def _follow(self, name: str, above: tuple[str, ...]) -> FloatArray | None:
        if name.lower() in _ROOTS:
            return np.eye(4)
        value = self._table.get(name.lower())
        if value is None or name in above:
            return None
        m = _FATHER.fullmatch(value.text("fatherId"))
        if m is None:
            return None
        father = self._follow(m[1] if m[2] in (None, "0") else f"{m[1]}[{int(m[2])}]", (*above, name))
        if father is None:
            return None
        numbers, _ = _numbers(self._source, value)
        tf: FloatArray = father @ make_transform(euler("staubli", numbers[3:]), numbers[:3])
        return tf


def _code(program: Path) -> tuple[set[bytes], Source]:
    """Return the names that a program hides, and its code without comments and texts."""
    text = files.read_bytes(program)
    hidden = {m[1].lower() for m in _HIDING.finditer(text)}
    return hidden, Source(program, re.sub(rb"//[^\r\n]*|\"[^\"\r\n]*\"", lambda m: b" " * len(m[0]), text))


def _foreign_uses(
    path: Path, folder: Path, named: dict[str, list[Point]], public: set[str], frames: dict[str, _Value]
) -> dict[tuple[str, Key | None], int]:
    """Refuse public points that other applications of a folder use; return the public frames that they change."""
    changed: dict[tuple[str, Key | None], int] = {}
    programs = [p for p in folder.rglob("*") if p.suffix.lower() == ".pgx" and p.is_file() and p.parent != path.parent]
    for program in sorted(programs):
        _, source = _code(program)
        for m in re.finditer(rb"(?<![\w.])(\w+):(\w+)(?:\[[^\]]*\])?((?:\.\w+)*\s*=(?!=))?", source.data):
            name, line = m[2].decode("latin-1").lower(), source.line(m.start())
            if name not in public:
                continue
            used = f"{m[1].decode('latin-1')}:{m[2].decode('latin-1')} (line {line} of {program.relative_to(folder)})"
            for point in named.get(name, ()):
                reason = f"it is public, and another application may use it: {used}"
                point.problem = point.problem or Problem("refuse", reason)
            for value in frames.values():
                if m[3] and value.data.lower() == name:
                    changed.setdefault(("base", value.name.lower()), line)
    return changed


def _uses(
    path: Path, named: dict[str, list[Point]], tools: _FrameChain, frames: dict[str, _Value]
) -> dict[tuple[str, Key | None], int]:
    """Replace the points' uses by those in the programs beside the file; return the frames that they change."""
    changed: dict[tuple[str, Key | None], int] = {}
    programs = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".pgx" and p.is_file())
    if not programs or not named:
        return changed
    frame_of = {id(point): point.uses[0].frame for points in named.values() for point in points}
    for points in named.values():
        for point in points:
            point.uses = []
    name = re.compile(
        rb"(?<![\w.:])(" + b"|".join(re.escape(n.encode()) for n in named) + rb")\b(?:\[\s*(\d{1,9})\s*\])?", re.I
    )
    for program in programs:
        hidden, source = _code(program)
        data = source.data
        altered = _ALTER.search(data)
        for value in frames.values():
            pattern = rb"(?<![\w.:])" + re.escape(value.data.encode()) + rb"(?:\[[^\]]*\])?(?:\.\w+)*\s*=(?!=)"
            if m := re.search(pattern, data, re.I):
                changed.setdefault(("base", value.name.lower()), source.line(m.start()))
        direct: dict[int, tuple[str, Frame | None, Problem | None]] = {}
        for m in _MOVE.finditer(data):
            position, goals = m.end(), 2 if m[2] in b"cC" else 1
            starts: list[int] = []
            while len(starts) < goals and (goal := name.match(data, position)):
                starts.append(goal.start())
                position = goal.end()
                comma = re.compile(rb"\s*,\s*").match(data, position)
                if comma is None:
                    starts = []
                    break
                position = comma.end()
            tool = re.compile(rb"(\w+(?:\[\s*\d+\s*\])?)\s*[,)]").match(data, position)
            for start in starts if tool else ():
                assert tool is not None
                word, line = m[1].decode(), source.line(start)
                problem = None
                if m[3]:
                    problem = Problem("refuse", f"{word} (line {line} of {program.name}) yields to forces")
                elif altered:
                    where = (
                        f"{altered[0].decode().rstrip('( ')} (line {source.line(altered.start())} of {program.name})"
                    )
                    problem = Problem(
                        "refuse", f"{where} may shift it at run time; corrections do not know by how much"
                    )
                direct[start] = word.lower(), tools.named(tool[1].decode().replace(" ", "")), problem
        for m in name.finditer(data):
            if m[1].lower() in hidden:
                continue
            line = source.line(m.start())
            every = named[m[1].decode().lower()]
            wanted = f"[{int(m[2])}]" if m[2] and int(m[2]) else ""
            chosen = [p for p in every if p.name.endswith(wanted)] if m[2] else every
            chosen = [p for p in chosen if ("[" in p.name) == bool(wanted)] if m[2] else chosen
            for point in chosen:
                if m.start() in direct:
                    word, frame, problem = direct[m.start()]
                    point.uses.append(Use(word, FileLine(program.name, line), frame, frame_of[id(point)], problem))
                else:
                    point.reads.append((line, f"read by arithmetic in {program.name}"))
    return changed
