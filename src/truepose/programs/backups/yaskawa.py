"""Backups of Yaskawa: a flat folder of .JBI jobs with TOOL.CND, UFRAME.CND and VAR.DAT.

These data files have checksums, so they are only read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from truepose._io.folders import files_within
from truepose._io.zips import on_disk
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs.backups.controller import Contents, StoredFrame, StoredFrames
from truepose.programs.backups.yaskawa_pulses import TaughtFrame, pulses_of
from truepose.programs.core.source import Source, parse_number
from truepose.programs.frame_table import FrameTable
from truepose.programs.inform.controller import Controller, Pose, StoredPosition
from truepose.programs.inform.survey import survey_jobs
from truepose.programs.inform.words import JOB

_BESIDE: Final = frozenset(["tool.cnd", "uframe.cnd", "var.dat", "all.prm", "system.sys", "rc.prm", "sc.prm"])
"""Files that a backup has beside its jobs."""
_PARAMETERS: Final = ("all.prm", "sc.prm", "rc.prm")
_KINDS: Final = {".cnd": "data", ".dat": "data", ".prm": "machine data", ".sys": "system data", ".bin": "image"}
_BLOCK = re.compile(rb"[ \t]*//(?!/)[ \t]*(\w+)[ \t]*(\d{0,9})")
_ENTRY = re.compile(rb"[ \t]*/{3,4}(\w+)[ \t]*([^\r\n]*)")
_ROBOT = re.compile(rb"[ \t]*R(\d)[ \t]*:[ \t]*([^\r\n]*)")
_VARIABLE = re.compile(rb"[ \t]*\"?(PULSE|RECTAN|UNUSED)\"?[ \t]*,?([^\r\n]*)", re.I)
_IN_BASE, _IN_ROBOT, _IN_USER = 16, 17, 19
_AXES: Final = 8
_POINTS: Final = ("RORG", "RXX", "RXY")
"""The points by which a user frame is taught: its origin, one on its x axis, one with a positive y."""


class _Line(NamedTuple):
    """A line of a data file: its number, its text, its block and entry, and whether it begins the entry."""

    number: int
    text: bytes
    block: str
    block_number: int | None
    entry: str
    begins: bool = False


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup."""
    jobs = {file.parent for file in files if file.suffix.lower() == ".jbi"}
    data = {file.parent for file in files if file.name.lower() in _BESIDE}
    return sorted(jobs & data)


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted."""
    own = [file for file in files if file.parent == root]
    jobs = [file for file in own if file.suffix.lower() == ".jbi"]
    others = {file: kind for file in own if (kind := _KINDS.get(file.suffix.lower()))}
    robots, version = _system(_named(own, "system.sys"))
    warnings = []
    if len(robots) > 1:
        listed = ", ".join(f"R{number} {name}" for number, name in robots.items())
        warnings.append(f"{root.name}: {len(robots)} robots ({listed}); jobs of R1 are corrected, those of others not")
    if _named(own, "uframe.cnd") is None:
        warnings.append(f"{root.name}: has no UFRAME.CND, so no user frame is known")
    return Contents([(job,) for job in jobs], others, warnings, robots.get(1, ""), version)


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the tools and bases of one controller."""
    own = [file for file in files if file.parent == root]
    tools, bases = _named(own, "tool.cnd"), _named(own, "uframe.cnd")
    return StoredFrames(_tools(tools) if tools else {}, _bases(bases) if bases else {})


def for_reader(root: Path, files: Sequence[Path]) -> dict[str, Any]:
    """Return what all jobs of one controller tell about each: see `truepose.programs.inform.controller.Controller`."""
    own = [file for file in files if file.parent == root]
    jobs = [file for file in own if file.suffix.lower() == ".jbi"]
    variables = _named(own, "var.dat")
    robots, _ = _system(_named(own, "system.sys"))
    parameters = [Source.read(file) for name in _PARAMETERS if (file := _named(own, name)) is not None]
    pulses = pulses_of(robots.get(1, ""), parameters, _taught(own))
    known = Controller(
        _variables(variables) if variables else {},
        robot=1 if len(robots) > 1 else None,
        pulses=pulses.per_degree,
        no_pulses=pulses.reason,
        lengths=pulses.lengths,
        own_lengths=pulses.own,
    )
    return {"controller": survey_jobs(jobs, FrameTable(), known)}


def jobs_beside(path: Path, folder: Path | None) -> Controller | None:
    """Return what the jobs that a job without a backup may call tell; None where it is alone.

    They are those in its folder; and if one of these calls a job that is elsewhere, the others in `folder`, which was
    given as a whole, too.
    """
    near = sorted(file for file in path.parent.iterdir() if _is_job(file)) if path.parent.is_dir() else [path]
    if folder is not None:
        jobs = [file for file in files_within(folder).files if _is_job(file)]
        near = [file for file in jobs if file.parent == path.parent]
        names = {file.stem.upper() for file in near}
        if _called(tuple(map(_version, near))) - names:
            near += [file for file in jobs if file.stem.upper() not in names]
    if path not in near or (len(near) == 1 and path.stem.upper() not in _called((_version(path),))):
        return None
    return _surveyed(tuple(map(_version, near)))


class _Version(NamedTuple):
    """A file as it is now: its path, the time of its last change, and its size."""

    path: Path
    changed: int
    size: int


def _version(path: Path) -> _Version:
    try:
        status = on_disk(path).stat()
    except OSError:
        return _Version(path, 0, 0)  # reading it will give the reason
    return _Version(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=2)
def _surveyed(jobs: tuple[_Version, ...]) -> Controller:
    return survey_jobs([one.path for one in jobs], FrameTable(), Controller())


@lru_cache(maxsize=2)
def _called(jobs: tuple[_Version, ...]) -> frozenset[str]:
    """Return the names of jobs that some jobs name."""
    found: set[str] = set()
    for one in jobs:
        try:
            data = Source.read(one.path).data
        except FileError:
            continue
        if b"JOB:" in data or b"job:" in data:  # most jobs of a CAM system are large, and name none
            found |= {m[1].decode("latin-1").upper() for m in JOB.finditer(data) if m[1]}
    return frozenset(found)


def _is_job(file: Path) -> bool:
    return file.suffix.lower() == ".jbi" and not file.name.startswith(".") and not file.is_symlink()


def _named(files: Sequence[Path], name: str) -> Path | None:
    return next((file for file in files if file.name.lower() == name), None)


def _lines(source: Source) -> Iterator[_Line]:
    """Yield the lines of a data file that hold values or are entries of their own."""
    block, index, entry = "", None, ""
    for number, start, end in source.lines():
        text = source.data[start:end]
        if m := _ENTRY.match(text):
            entry = m[1].decode("latin-1").upper()
            yield _Line(number, m[2].strip(), block, index, entry, begins=True)
        elif m := _BLOCK.match(text):
            block, index, entry = m[1].decode("latin-1").upper(), int(m[2]) if m[2] else None, ""
        elif text.strip():
            yield _Line(number, text.strip(), block, index, entry)


def _numbers(source: Source, line: _Line, count: int) -> list[float]:
    """Return the numbers of a line; a FileError names it if they are broken or too few."""
    try:
        values = [parse_number(token.strip()) for token in line.text.split(b",") if token.strip()]
    except ValueError as error:
        raise source.error(line.number, f"{error}; save the backup again") from None
    if len(values) < count:
        raise source.error(line.number, f"has {len(values)} numbers, expected {count}; save the backup again")
    return values


def _pose(values: Sequence[float]) -> FloatArray:
    return make_transform(euler("yaskawa", values[3:6]), values[:3])


def _tools(path: Path) -> Mapping[int | str, StoredFrame]:
    """Return the tools of TOOL.CND. A tool of zeros without a name is not set, except number 0."""
    source = Source.read(path)
    found: dict[int | str, StoredFrame] = {}
    names: dict[int, str] = {}
    seen: dict[int, int] = {}
    for line in _lines(source):
        if line.block != "TOOL" or line.block_number is None:
            continue
        if line.begins:
            if line.entry == "NAME" and line.text:
                names[line.block_number] = line.text.decode("latin-1")
            continue
        if line.block_number in seen:  # behind the pose: centre of gravity, mass, inertia, flags
            continue
        seen[line.block_number] = line.number
        values, name = _numbers(source, line, 6), names.get(line.block_number, "")
        if any(values[:6]) or name or line.block_number == 0:
            found[line.block_number] = StoredFrame(_pose(values), name, f"{path.name}, line {line.number}")
    return found


def _bases(path: Path) -> Mapping[int | str, StoredFrame]:
    """Return the user frames of UFRAME.CND, in the base of robot 1."""
    source = Source.read(path)
    found: dict[int | str, StoredFrame] = {}
    name, problem = "", ""
    block: int | None = None
    for line in _lines(source):
        if line.block != "UFRAME" or line.block_number is None:
            continue
        if line.block_number != block:
            block, name, problem = line.block_number, "", ""
        if not line.begins:
            continue
        if line.entry == "NAME":
            name = line.text.decode("latin-1")
        elif line.entry == "GROUP":
            groups = [token.strip() for token in line.text.split(b",")]
            if any(token not in (b"0", b"") for token in groups[1:]) or groups[0] in (b"0", b""):
                problem = f"user frame {block} belongs to another group than R1 ({path.name}, line {line.number})"
        elif line.entry == "BASICFRM":
            values = _numbers(source, line, 2)
            if values[1] != _IN_BASE:
                problem = f"user frame {block} is not given in the base ({path.name}, line {line.number})"
        elif line.entry == "BUSER":
            values = _numbers(source, line, 6)
            if block in found:
                raise source.error(line.number, f"user frame {block} is given twice; save the backup again")
            found[block] = StoredFrame(_pose(values), name, f"{path.name}, line {line.number}", problem)
    return found


def _taught(own: Sequence[Path]) -> list[TaughtFrame]:
    """Return the user frames of UFRAME.CND in the base of robot 1 that were taught by points of a known tool."""
    tools_at, bases_at = _named(own, "tool.cnd"), _named(own, "uframe.cnd")
    if bases_at is None:
        return []
    tools = _tools(tools_at) if tools_at else {}
    bases = _bases(bases_at)
    points: dict[int, dict[str, list[float]]] = {}
    tool_of: dict[int, int] = {}
    source = Source.read(bases_at)
    for line in _lines(source):
        if line.block != "UFRAME" or line.block_number is None or not line.begins:
            continue
        if line.entry == "TOOL" and line.text.isdigit():
            tool_of[line.block_number] = int(line.text)
        elif line.entry in _POINTS:
            values = _numbers(source, line._replace(text=line.text.rpartition(b"=")[2]), 6)
            points.setdefault(line.block_number, {})[line.entry] = values[:6]
    return [
        TaughtFrame(base.tf, tools[tool_of[number]].tf, np.array([found[key] for key in _POINTS]))
        for number, base in bases.items()
        if isinstance(number, int)
        and not base.problem
        and (found := points.get(number, {})).keys() == set(_POINTS)
        and tool_of.get(number) in tools
    ]


def _variables(path: Path) -> dict[int, StoredPosition]:
    """Return the P variables of VAR.DAT that hold a position."""
    source = Source.read(path)
    found: dict[int, StoredPosition] = {}
    number = 0
    for line in _lines(source):
        if line.entry != "P" or line.begins or not (m := _VARIABLE.match(line.text)):
            continue
        kind = m[1].upper()
        if kind == b"PULSE":
            found[number] = StoredPosition(line.number, None)
        elif kind == b"RECTAN":
            tail = b",".join(m[2].split(b",")[-_AXES - 2 :])  # behind the tool and the digits of the configuration
            user, frame, *values = _numbers(source, line._replace(text=tail), 2 + _AXES)
            named = {_IN_BASE: "BASE", _IN_ROBOT: "ROBOT", _IN_USER: f"USER {user:.0f}"}.get(int(frame), "")
            found[number] = StoredPosition(line.number, Pose(tuple(values[:6]), named))
        number += 1
    return found


def _system(path: Path | None) -> tuple[dict[int, str], str]:
    """Return the robots of SYSTEM.SYS by number, and the version of the software."""
    robots: dict[int, str] = {}
    version = ""
    if path is None:
        return robots, version
    data = Source.read(path).data
    if m := re.search(rb"//SYSTEM NO[ \t]*:[ \t]*([^\r\n]*)", data):
        version = m[1].decode("latin-1").strip()
    if (start := data.find(b"//ROBOT NAME")) >= 0:
        end = data.find(b"\n//", start + 2)
        for robot in _ROBOT.finditer(data, start, end if end >= 0 else len(data)):
            robots[int(robot[1])] = robot[2].decode("latin-1").strip()
    return robots, version
