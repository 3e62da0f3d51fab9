"""Modules of a task that cannot be read: what they may do to the others is assumed of what they name."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.points import FileLine
from truepose.programs.core.source import Source
from truepose.programs.core.state import InForce
from truepose.programs.rapid.names import RapidTask, Read, Routine
from truepose.programs.rapid.words import DISPLACEMENTS, LOADS, MOTION, SYNC

_WORD: Final = re.compile(rb"[A-Za-z_\x80-\xff][\w\x80-\xff]*")
_TOKEN: Final = re.compile(rb"\"[^\"\r\n]*\"|[\w.\x80-\xff]+|[^\s\w]")
_HEADER: Final = re.compile(rb"\s*%%%.*?%%%", re.S)
_ENCODED: Final = 0xFC
_COMMENT: Final = re.compile(rb"(?m)^([^\"\r\n!]*(?:\"[^\"\r\n]*\"[^\"\r\n!]*)*)![^\r\n]*")
_END: Final = re.compile(rb"\bENDMODULE\s*\Z", re.I)
_ROUTINE: Final = re.compile(
    rb"(?mi)^[ \t]*(LOCAL[ \t]+)?(PROC|TRAP|FUNC[ \t]+\w+)[ \t]+([A-Za-z_\x80-\xff][\w\x80-\xff]*)"
)
_DATUM: Final = re.compile(
    rb"(?mi)^[ \t]*(LOCAL[ \t]+)?(?:TASK[ \t]+)?(?:CONST|PERS|VAR)[ \t]+(\w+)[ \t]+([A-Za-z_\x80-\xff][\w\x80-\xff]*)"
)
_MODULE: Final = re.compile(rb"(?mi)^[^\w\r\n!\"]*MODULE[ \t]+([A-Za-z_\x80-\xff][\w\x80-\xff]*)")
_STATEMENT: Final = re.compile(rb"\b([A-Za-z_]\w*)\b([^;\r\n]*);")
_FRAMES_OF_MOTION: Final = re.compile(rb"\\[ \t]*WObj[ \t]*:=[ \t]*\w+|,[ \t]*\w+(?=[ \t]*(?:\\|\Z))", re.I)
_BY_NAME: Final = frozenset(["SETDATAVAL", "SETALLDATAVAL"])
_TARGETS: Final = ("ROBTARGET", "JOINTTARGET")


class LeftOut(NamedTuple):
    """The modules that are left out of a task.

    Attributes
    ----------
    sources : list of Source
        Those that name all that they use.
    unknown, spare : str
        The others in words; spare ones lie on the controller's disk, and nothing at hand loads them.
    """

    sources: list[Source]
    unknown: str = ""
    spare: str = ""


def left_out(files: Sequence[Path], aside: Mapping[Path, FileError]) -> LeftOut:
    """Return what is left out of the files of a task.

    A module names all if it is a text, and complete. A copy that states what a module states counts as that.
    """
    if not aside:
        return LeftOut([])
    kept = [read_bytes(path) for path in files if path not in aside]
    statements = [statements_of(text) for text in kept]
    root = Path(os.path.commonpath([path.parent for path in files]))
    found = LeftOut([])
    for path in aside:
        try:
            text = Source.read(path).data
        except FileError:
            text = b""
        if text and not is_encoded(text) and not names_module(text):
            continue
        if is_encoded(text) or _END.search(text.rstrip(b"\0\x1a \t\r\n")) is None:
            on_disk = "home" in [part.lower() for part in path.relative_to(root).parts[:-1]]
            loaded = any(path.name.lower().encode() in one.lower() for one in kept)
            what = f"{path.name} is encoded or truncated"
            if on_disk and not loaded:
                found = found._replace(spare=found.spare or what)
            else:
                found = found._replace(unknown=found.unknown or what)
        elif statements_of(read_bytes(path)) not in statements:
            found.sources.append(Source.read(path))
    return found


def is_encoded(text: bytes) -> bool:
    """Return whether a module is no text: encoded modules begin with a byte of their own."""
    return text[:1] == bytes([_ENCODED]) or b"\0" in text[: 1 << 16].rstrip(b"\0\x1a")


def names_module(text: bytes) -> bool:
    """Return whether a text may be a module: logs and other data with the endings of modules have no such word."""
    return re.search(rb"\bMODULE\b", text, re.I) is not None


def statements_of(text: bytes) -> list[bytes]:
    """Return the words and marks of a module without comments and without the head that newer controllers omit."""
    return _TOKEN.findall(_without_comments(text[m.end() :] if (m := _HEADER.match(text)) else text))


def module_of(text: bytes) -> str:
    """Return the name of a module in upper case; empty where it states none."""
    m = _MODULE.search(_without_comments(text))
    return m[1].decode("latin-1").upper() if m else ""


def declared_in(text: bytes) -> set[tuple[str, str]]:
    """Return what a module declares for its task, each once in it: routines and targets, in upper case."""
    code = _without_comments(text)
    found = {("routine", _upper(m[3])) for m in _ROUTINE.finditer(code) if not m[1]}
    targets = (m for m in _DATUM.finditer(_head(code)) if not m[1] and _upper(m[2]) in _TARGETS)
    return found | {("target", _upper(m[3])) for m in targets}


def assume_all_of(source: Source, task: RapidTask) -> None:
    """Let a module that cannot be read do whatever its words allow, before the statements of the others are read.

    Points that it names are not corrected, and neither are targets under tools and workobjects that it may change.
    Its routines may displace and shift if it names such an instruction, may raise errors, and may call the routines
    that it names. What the module declares itself hides what others declare.
    """
    code = _without_comments(source.data)
    place = FileLine(source.path.name, 1)
    how = f"named by {source.path.name}, which is left out"
    own = {_upper(m[3]) for m in _DATUM.finditer(_head(code))}
    words = {_upper(word) for word in _WORD.findall(code)} - own
    for points, _ in task.columns:
        for row in sorted({row for word in words if (row := points.row(word)) >= 0}):
            points.take(row)
    for variable in task.variables:
        if variable.reach in ("task", "controller") and variable.name.upper() in words:
            task.reads.append(Read(variable, place, how))
            task.derivations.escape(variable, place, how)
    for word in words & task.scope.numbers.keys():
        if task.scope.numbers[word].kind != "CONST":
            task.scope.numbers[word].handed = True
            task.derivations.escape_number(task.scope.numbers[word])
    defined = {one.key for one in _routines(code, place)} | task.scope.routines.keys()
    for word in {_upper(word) for word in _WORD.findall(_but_frames_of_motions(code, defined))} - own:
        task.change_frame(word, place)
    if words & LOADS and not task.loads:
        task.loads = f"{source.path.name} names Load and is left out"
    if words & _BY_NAME:
        task.sets_by_name = place
        for kind in ("tool", "base"):
            task.changed.setdefault((kind, None), place)
    if any(SYNC.fullmatch(word) for word in words):
        task.run_by_motions.add(("", False))
    _take_routines(source, code, words, task)


def _take_routines(source: Source, code: bytes, words: set[str], task: RapidTask) -> None:
    """Define the routines of the module as ones that may do everything that it names."""
    flow, place = task.flow, FileLine(source.path.name, 1)
    late = b"%" in code or "CALLBYVAR" in words
    others = [one.key for one in task.routines if late or one.key.upper() in words]
    others += ["MAIN"] if "EXITCYCLE" in words and "MAIN" in task.scope.routines else []
    found = [one for one in _routines(code, place) if one.key not in task.scope.routines]
    handlers = [one for one in found if one.kind == "TRAP"]
    beside = Routine(f"{source.path.name}:", "TRAP" if handlers or "TRAP" in words else "PROC", (), place)
    text = f"{source.path.name} cannot be read and may displace"
    for one in [beside, *found]:
        if one is not beside:
            task.scope.routines[one.key] = one
        flow.begin_routine(one.key, outside=False)
        if one.kind == "TRAP":
            flow.interrupt_program()
        if words & DISPLACEMENTS.keys() or late:
            flow.change(ipo=text, tool=InForce("unknown", text))
        for line in filter(None, (line.strip() for line in code.splitlines())):
            shifts.follow(flow, [kind._replace(ends=None) for kind in shifts.RAPID], line, place)
        flow.call_one_of(others)
        flow.begin("IF", 1)
        flow.fail(handled=False)
        flow.end("ENDIF", "IF")
        flow.end_routine()


def _routines(code: bytes, place: FileLine) -> list[Routine]:
    """Return the routines that other modules may call."""
    found = [(m[2].split()[0], _upper(m[3])) for m in _ROUTINE.finditer(code) if not m[1]]
    return [Routine(name, _upper(kind), (), place) for kind, name in found]


def _but_frames_of_motions(code: bytes, defined: set[str]) -> bytes:
    """Return code without the tools and workobjects that motions of the controller state: these only read them."""

    def stripped(m: re.Match[bytes]) -> bytes:
        is_motion = MOTION.fullmatch(_upper(m[1])) is not None and _upper(m[1]) not in defined
        return _FRAMES_OF_MOTION.sub(b" ", m[0][:-1]) + b";" if is_motion else m[0]

    return _STATEMENT.sub(stripped, code)


def _without_comments(text: bytes) -> bytes:
    return _COMMENT.sub(rb"\1", text)


def _head(code: bytes) -> bytes:
    """Return the part of a module that declares its data: all before its first routine."""
    first = _ROUTINE.search(code)
    return code[: first.start()] if first else code


def _upper(word: bytes) -> str:
    return word.decode("latin-1").upper()
