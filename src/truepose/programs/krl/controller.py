"""KUKA's own files: ``$config.dat`` with the tools and bases, ``$machine.dat`` with the place of the robot."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.program import Key
from truepose.programs.core.source import Source, printable, strip
from truepose.programs.krl.lexer import BLANK, CARTESIAN, closing_brace, parse_aggregate, statements

_ENTRY: Final = re.compile(rb"\s*\[\s*(\d{1,4})\s*\]\s*=\s*(?=\{)")
_TEXT: Final = re.compile(rb"\s*\[\s*(\d{1,4})\s*,\s*\]\s*=\s*\"([^\"]*)\"")
_CHOICE: Final = re.compile(rb"\s*\[\s*(\d{1,4})\s*\]\s*=\s*#\s*(\w+)")
_ROOT: Final = re.compile(rb"\bROOT\s*(?=\{)", re.I)
_MECHANISM: Final = re.compile(rb"\b(?:MECH_TYPE|EX_KIN)\s*#\s*(\w+)", re.I)
_NAME: Final = re.compile(rb"\bNAME\[\]\s*\"([^\"]*)\"", re.I)
_INDEX: Final = re.compile(rb"\bMACH_DEF_INDEX\s+(\d{1,4})\b", re.I)
_PLACE: Final = re.compile(rb"(?:DECL\s+)?(?:GLOBAL\s+)?(?:FRAME\s+)?\$(ROBROOT|WORLD)\s*(\.\s*\w+\s*)?=(?!=)\s*", re.I)
_TABLES: Final = {"TOOL_DATA": "tool", "BASE_DATA": "base"}
_NAMES: Final = {"TOOL_NAME": "tool", "BASE_NAME": "base"}
_TYPES: Final = {"TOOL_TYPE": "tool", "BASE_TYPE": "base"}
_CARRIERS: Final = {"MACHINE_TOOL_DAT": "tool", "MACHINE_FRAME_DAT": "base"}
_MACHINES: Final = ("MACHINE_DEF", "EX_AX_DATA")


class Entry(NamedTuple):
    """A tool or base of a ``$config.dat``: its frame (None where components are missing) and its line."""

    tf: FloatArray | None
    line: int


class Machine(NamedTuple):
    """A kinematic system of a ``$config.dat``.

    Attributes
    ----------
    name : str
        The name.
    mechanism : str
        The type in upper case: ROBOT, ERSYS (a carrier of the robot), EASYS and so on (it moves bases), NONE.
    tf_world_root : (4, 4) array [mm], optional
        The transform from its parent, usually the world, to its root.
    line : int
        The line.
    """

    name: str
    mechanism: str
    tf_world_root: FloatArray | None
    line: int


@dataclass(frozen=True, eq=False)
class ConfigDat:
    """What a ``$config.dat`` states about tools, bases and kinematic systems.

    Attributes
    ----------
    entries : dict of ("tool" or "base", number) to Entry
        The frames.
    names, types : dict of ("tool" or "base", number) to str
        The names that the operator gave, and the types in upper case: BASE, TCP (a fixed tool), NONE.
    carriers : dict of ("tool" or "base", number) to int
        The number of the kinematic system that carries a frame; 0 for the world.
    machines : dict of ("MACHINE_DEF" or "EX_AX_DATA", number) to Machine
        The kinematic systems.
    broken : dict of ("tool" or "base", number) to FileError
        Why frames are not known that the file states: they are broken, or given twice.
    """

    entries: dict[tuple[str, int], Entry] = field(default_factory=dict)
    names: dict[tuple[str, int], str] = field(default_factory=dict)
    types: dict[tuple[str, int], str] = field(default_factory=dict)
    carriers: dict[tuple[str, int], int] = field(default_factory=dict)
    machines: dict[tuple[str, int], Machine] = field(default_factory=dict)
    broken: dict[tuple[str, int], FileError] = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file; a FileError names the line of what is broken, but for frames (see `broken`)."""
        source, found = Source.read(path), cls()
        for word, line, _, rest, end in statements(source):
            if word in _TABLES:
                found._take_frame(source, word, line, rest, end)
            elif word in _NAMES and (m := _TEXT.match(source.data, rest, end)):
                found.names[_NAMES[word], int(m[1])] = text(m[2]).strip()
            elif word in _TYPES and (m := _CHOICE.match(source.data, rest, end)):
                found.types[_TYPES[word], int(m[1])] = m[2].decode().upper()
            elif word in _CARRIERS and (m := _ENTRY.match(source.data, rest, end)):
                index = _INDEX.search(source.data, m.end(), end)
                found.carriers[_CARRIERS[word], int(m[1])] = int(index[1]) if index else 0
            elif word in _MACHINES and (m := _ENTRY.match(source.data, rest, end)):
                found.machines[word, int(m[1])] = _machine(source, m.end(), end, line)
        return found

    def _take_frame(self, source: Source, word: str, line: int, rest: int, end: int) -> None:
        if (entry := _ENTRY.match(source.data, rest, end)) is None:
            return
        number = int(entry[1])
        key = _TABLES[word], number
        if key in self.broken:  # whatever is given once more
            return
        try:
            close = closing_brace(source, entry.end(), end, line)
            if close != strip(source.data, entry.end(), end, BLANK)[1]:
                raise source.error(line, f"{word}[{number}] is followed by more than its value; correct the file")
            if key in self.entries:
                first = self.entries.pop(key).line
                raise source.error(line, f"{word}[{number}] was given in line {first} already; keep one")
            values = parse_aggregate(source, entry.end(), close, line).values
        except FileError as error:
            self.broken[key] = error
        else:
            tf = _transform(values) if all(k in values for k in CARTESIAN) else None
            self.entries[key] = Entry(tf, line)


def read_config_dat(path: str | Path) -> tuple[dict[Key, FloatArray], dict[Key, FloatArray]]:
    """Return the tools and bases of a ``$config.dat``, by number.

    Everything but ``TOOL_DATA[n]={X …}`` and ``BASE_DATA[n]={X …}`` is passed over; an entry with components missing is
    not a known frame.

    Returns
    -------
    tools : dict of int to (4, 4) array [mm]
        Flange to tool.
    bases : dict of int to (4, 4) array [mm]
        The controller's world to frame; the world is the robot's base where $ROBROOT is the null frame.

    Raises
    ------
    FileError
        If the file cannot be read, has no such entry, gives one twice, or has a broken one; with its line.
    """
    config = ConfigDat.read(path)
    entries = config.entries
    for error in config.broken.values():
        raise error
    if not entries:
        raise FileError(path, "has no TOOL_DATA[n]={…} or BASE_DATA[n]={…}; name the controller's $config.dat")
    tables: dict[str, dict[Key, FloatArray]] = {"tool": {}, "base": {}}
    for (which, number), entry in entries.items():
        if entry.tf is not None:
            tables[which][number] = entry.tf
    return tables["tool"], tables["base"]


def text(data: bytes) -> str:
    """Return a text of a controller's file: UTF-8, or else the code page of western Windows."""
    try:
        return printable(data.decode())
    except UnicodeDecodeError:
        return printable(data.decode("cp1252", "replace"))


def _transform(values: Mapping[str, float]) -> FloatArray:
    pose = [values[key] for key in CARTESIAN]
    return make_transform(euler("kuka", pose[3:]), pose[:3])


def _machine(source: Source, start: int, end: int, line: int) -> Machine:
    tf = None
    if root := _ROOT.search(source.data, start, end):
        values = parse_aggregate(source, root.end(), closing_brace(source, root.end(), end, line), line).values
        tf = _transform(values) if all(k in values for k in CARTESIAN) else None
    name, mechanism = _NAME.search(source.data, start, end), _MECHANISM.search(source.data, start, end)
    return Machine(text(name[1]).strip() if name else "", mechanism[1].decode().upper() if mechanism else "", tf, line)


def is_null(source: Source, start: int, end: int, line: int) -> bool:
    """Return whether the expression between two places of a KRL file is certainly the null frame."""
    code = source.data[start:end].strip()
    if code.upper() in (b"$NULLFRAME", b"$WORLD"):
        return True
    if not code.startswith(b"{"):
        return False
    begin = start + len(source.data[start:end]) - len(source.data[start:end].lstrip())
    close = closing_brace(source, begin, end, line)
    found = parse_aggregate(source, begin, close, line)
    return not source.data[close:end].strip() and not found.loose and not any(found.values.values())


def robot_root(path: Path) -> FloatArray | None:
    """Return $ROBROOT of a $machine.dat, (4, 4) [mm]; None where it is not given."""
    source, found = Source.read(path), None
    for _, line, start, _, end in statements(source):
        if (m := _PLACE.match(source.data, start, end)) is None:
            continue
        if is_null(source, m.end(), end, line):
            found = np.eye(4) if m[1].upper() == b"ROBROOT" else found
            continue
        values = {}
        if source.data[m.end() : m.end() + 1] == b"{" and not m[2]:
            values = parse_aggregate(source, m.end(), closing_brace(source, m.end(), end, line), line).values
        if m[1].upper() != b"ROBROOT" or set(values) != set(CARTESIAN):
            name = f"${m[1].decode().upper()}"
            raise source.error(line, f"{name} is not the null frame, nor a frame that can be used; correct the file")
        found = _transform(values)
    return found
