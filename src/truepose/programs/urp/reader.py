"""Universal Robots' own programs (.urp): waypoints, which hold the joints that were taught.

A waypoint states its joints, the TCP, the arm model of the controller and the feature when it was taught. The
controller moves to the pose that these joints mean in that model; truepose corrects that pose and writes the joints
that mean the corrected one. Nodes refer to each other by their places, so nothing but digits of joints changes.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose._io.files import path_exists
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import invert_transform
from truepose.programs.core import shifts
from truepose.programs.core.joint_targets import UR, JointNumbers, OwnArm
from truepose.programs.core.packed import PackedSource
from truepose.programs.core.points import RELATIVE, RUN_TIME, Frame, Point, Problem
from truepose.programs.core.program import KnownFrames, Program, ReadOptions, frame_key
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import NotAProgramError
from truepose.programs.urp.installation import Installation, read_installation
from truepose.programs.urp.markup import Element, parse
from truepose.programs.urp.numbers import numbers, pose

_PLAIN: Final = frozenset(
    ["URProgram", "MainProgram", "SubProgram", "SpecialSequence", "Thread", "Event", "Timer", "children"]
) | frozenset(["Folder", "Loop", "If", "ElseIf", "Else", "Switch", "Case", "Default", "Until", "Move"])
"""Nodes that change neither the path nor the target of a motion."""
_CALLED: Final = "subprogram"
"""The tree of a subprogram in the node of its first call; further calls refer to it."""
_NOT_EXECUTED: Final = frozenset(["suppressednode", "removedsiblings"])
"""Nodes that a programmer has suppressed, and those that the editor keeps of what was removed, in lower case."""
_BASE: Final = "Joint_0_name"
_SAME_MM, _SAME_RAD = 1e-3, 1e-6
_TCP: Final = re.compile(rb"(?<![\w.])set_tcp\s*\(")
_MOTION: Final = re.compile(rb"(?<![\w.])(?:move[jlpc]|servo[jclp]|speed[jl])\s*\(")
_FILE_NAME: Final = re.compile(r"[^/\\\0]{1,200}")
_OWN_TCP: Final = ("TCPOffset", "tcp")
_CODE: Final = ("Script", "Assignment", "expression")
_NAME: Final = re.compile(rb"[A-Za-z_]\w*")


class _Text(NamedTuple):
    """Code of a node."""

    code: bytes
    line: int


def read(
    path: Path,
    frames: KnownFrames,
    options: ReadOptions,
    *,
    installations: Mapping[str, Sequence[Installation]] | None = None,
) -> Program:
    """Read a .urp file; a FileError names the line if it is broken.

    `installations` are those of the controller by their names in lower case, several where folders have their own;
    without them the one beside the file is read, if there is one.
    """
    source = PackedSource.read(path)
    root = parse(source)
    if root.tag != "URProgram":
        raise NotAProgramError(path, f"begins with <{root.tag}>, expected <URProgram>")
    name = root.get("installation")
    known: Sequence[Installation]
    if installations is None:
        known = _beside(path, name)
    else:
        known = _nearest(path, installations.get(name.lower(), ()), root.get("installationRelativePath"))
    missing = f"{name}.installation" if installations is not None and not known and name else ""
    return _Reader(source, frames, options, root, known, missing).read()


def _beside(path: Path, name: str) -> list[Installation]:
    """Return the installation of a program that is read alone; none where there is none."""
    if not _FILE_NAME.fullmatch(name):
        return []
    file = path.with_name(f"{name}.installation")
    return [read_installation(file)] if path_exists(file) else []


def _nearest(path: Path, known: Sequence[Installation], relative: str) -> Sequence[Installation]:
    """Return the installations of a name that a program may mean.

    They are the one whose path it states, else that of its folder or of the next one around; where none is there, all.
    """
    if len(known) < 2:
        return known
    if relative:
        named = os.path.normpath(path.parent / relative.replace("\\", "/")).removesuffix(".installation").lower()
        if found := [one for one in known if str(one.path.with_suffix("")).lower() == named]:
            return found
    return next((found for folder in path.parents if (found := [i for i in known if i.path.parent == folder])), known)


class _Reader(Reader):
    source: PackedSource

    def __init__(
        self,
        source: PackedSource,
        frames: KnownFrames,
        options: ReadOptions,
        root: Element,
        installations: Sequence[Installation],
        missing: str,
    ) -> None:
        super().__init__(source, frames, options)
        self._root, self._installations, self._missing = root, installations, missing
        self._executed = list(_executed(root))
        self._calls: dict[int | None, list[Element]] = {}  # by their trees; of those at None, that is not known
        for element in self._executed:
            if element.tag == _CALLED:
                tree = element.at(element.get("reference")) if "reference" in element.attributes else element
                self._calls.setdefault(None if tree is None else id(tree), []).append(element)
        found = [(_code_of(element).encode(), element.line) for element in self._executed]
        self._code = [_Text(code, line) for code, line in found if code]
        self._named = {m[0].decode(): text.line for text in self._code for m in _NAME.finditer(text.code)}
        self._written: dict[int, Point] = {}

    def read(self) -> Program:
        waypoints = [element for element in self._root.walk() if element.tag == "Waypoint"]
        for waypoint in waypoints:
            if "reference" not in waypoint.attributes:
                self._written[id(waypoint)] = self._point(waypoint)
        whole = self._shifted()
        for waypoint in self._executed:
            if waypoint.tag == "Waypoint":
                self._use(waypoint, whole)
        self.points += self._written.values()
        for text in self._code:
            if m := _MOTION.search(text.code):
                word = m[0].decode().rstrip("( ")
                reason = "a motion in a Script node: known at run time only; keep it in a .script file of its own"
                self.other(word, text.line, Problem("skip", reason))
        return self.program("ur", unit=1000.0)

    def _point(self, waypoint: Element) -> Point:
        name = waypoint.get("name") or f"Waypoint:{waypoint.line}"
        point = Point(name, self.source, waypoint.line)
        position = waypoint.child("position")
        joints = None if position is None else position.child("JointAngles")
        kind = waypoint.get("type")
        if kind == "Relative":
            point.problem = RELATIVE
        elif kind != "Fixed" or position is None or joints is None:
            point.problem = RUN_TIME
        elif position.child("TCPOffset") is None:
            point.problem = Problem("refuse", "it states no TCP; teach it again")
        else:
            values, spans = numbers(self.source, joints, "angles")
            form = replace(UR, arm=self._arm(position.child("Kinematics")))
            point.joints = JointNumbers(values, spans, form)
        for variable in (name, f"{name}_p", f"{name}_q"):
            if variable in self._named:
                point.reads.append((self._named[variable], "read by a Script node or an expression"))
        return point

    def _arm(self, kinematics: Element | None) -> OwnArm | None:
        """Return the arm model of a waypoint; None where it has none, or one of zeros."""
        if kinematics is None:
            return None
        rows: list[tuple[float, ...]] = []
        for tag in ("deltaTheta", "alpha", "a", "d"):
            row = kinematics.child(tag)
            if row is None or not row.get("value").strip():
                return None
            rows.append(numbers(self.source, row, "value")[0])
        theta, alpha, a, d = rows
        if not any((*alpha, *a, *d)):
            return None
        lengths = [tuple([1000.0 * value for value in row]) for row in (a, d)]
        return OwnArm(theta, alpha, lengths[0], lengths[1], self.options.controller_kinematics)

    def _use(self, waypoint: Element, whole: Problem | None) -> None:
        """Add the motion to a waypoint."""
        written = waypoint.at(waypoint.get("reference")) if "reference" in waypoint.attributes else waypoint
        point = None if written is None else self._written.get(id(written))
        move = next((around for around in waypoint.around() if around.tag in ("Move", "MainProgram")), None)
        strange = next((around.tag for around in self._around(waypoint, set()) if around.tag not in _PLAIN), "")
        if point is not None and strange:
            inside = Problem("refuse", f"inside <{strange}>, which may change where it leads")
            point.uses.append(self.use("Waypoint", waypoint.line, None, None, inside))
            return
        if point is None or written is None or move is None or not (move.tag == "Move" or move.get("motionType")):
            alone = Problem("refuse", "a waypoint that refers to none, or outside of a Move node, is not understood")
            self.other("Waypoint", waypoint.line, alone, f"Waypoint:{waypoint.line}")
            return
        word = move.get("motionType") or "Move"
        tool, problem = None, whole
        if point.joints is not None:
            tcp = _tcp_offset(self.source, written)
            tool = Frame(_named(tcp), None, tcp.tobytes())
            problem = problem or self._objection(move, written, tcp)
        point.uses.append(self.use(word, waypoint.line, tool, None, problem))

    def _around(self, element: Element, seen: set[int]) -> Iterator[Element]:
        """Yield the nodes around one as it is executed: those around a subprogram are those of its calls."""
        for around in element.around():
            if around.tag.lower() != _CALLED:
                yield around
                continue
            if id(around) not in seen:
                seen.add(id(around))
                for call in (*self._calls.get(id(around), ()), *self._calls.get(None, ())):
                    node = call.parent
                    while node is not None and node.tag == "CallSubProgram":
                        node = node.parent
                    if node is not None:
                        yield node
                        yield from self._around(node, seen)
            return

    def _shifted(self) -> Problem | None:
        """Return the reason why motions of the program may be shifted, or made with another TCP."""
        begun = shifts.begun(shifts.UR, [(text.line, text.code) for text in self._code])
        if problem := shifts.problem_of(begun):
            return problem
        for text in self._code:
            if _TCP.search(text.code):
                return Problem("refuse", f"a Script node sets the TCP (line {text.line}): it may be any at the motion")
        for element in self._executed:
            if element.tag not in _OWN_TCP and "tcp" in f"{element.tag} {element.get('type')}".lower():
                return Problem("refuse", f"<{element.tag}> (line {element.line}) may set the TCP: it may be any")
        return None

    def _objection(self, move: Element, waypoint: Element, tcp: FloatArray) -> Problem | None:
        """Return the reason why a motion leads elsewhere than to the pose that was taught."""
        chosen = move.child("tcp")
        for installation in self._installations:
            if installation.problem:
                return Problem("refuse", f"its installation is not known: {installation.problem}")
            name = installation.active if chosen is None else chosen.get("referencedName") or chosen.get("name")
            now = installation.tcps.get(name)
            if now is not None and not _same(now.tf, tcp):
                taught = f"it was taught with another TCP than {name} of {installation.path.name}, line {now.line}"
                return Problem("refuse", f"{taught}, which is in force: teach it again")
        objections = (self._feature_objection(move, waypoint, one) for one in self._installations or (None,))
        return next((problem for problem in objections if problem is not None), None)

    def _feature_objection(self, move: Element, waypoint: Element, installation: Installation | None) -> Problem | None:
        feature, taught = move.child("feature"), waypoint.child("BaseToFeature")
        referred = None if feature is None else feature.get("reference")
        if feature is not None and referred:
            feature = feature.at(referred)
            if feature is None:
                return Problem("refuse", f"its Move refers to a feature that is not there: {referred}")
        name = _BASE if feature is None else feature.get("referencedName")
        then = np.eye(4) if taught is None else pose(self.source, taught)
        if name == _BASE:
            now: FloatArray | None = np.eye(4)
        else:
            placed = None if installation is None else installation.features.get(name)
            now = self.frames.bases.get(frame_key(name)) if placed is None else placed.tf
        if self._missing and name != _BASE:
            return Problem("refuse", f"feature {name} is not known: {self._missing} is not in the backup; add it")
        if now is None:
            remedy = f"give it in [frames.bases.{name}] of the cell file, or the .installation that states its pose"
            return Problem("refuse", f"base {name} is not known; {remedy}")
        # whether the controller writes the feature in the base or the reverse, it has not moved
        if _same(now, then) or _same(invert_transform(now), then):
            return None
        return Problem("refuse", f"the feature {name} is not where it was when the waypoint was taught: teach it again")


def _executed(root: Element) -> Iterator[Element]:
    """Yield the element and all below it that the controller executes, in the order of the text."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        if element.tag.lower() not in _NOT_EXECUTED:
            yield element
            waiting += reversed(element.children)


def _code_of(element: Element) -> str:
    """Return the code in an element: of a Script node, or of an expression, which has a node for each character."""
    if element.words and any(one.tag in _CODE for one in (element, *element.around())):
        return element.text
    return "".join([child.get("character") for child in element.children if child.tag == "ExpressionChar"])


def _tcp_offset(source: PackedSource, waypoint: Element) -> FloatArray:
    position = waypoint.child("position")
    offset = None if position is None else position.child("TCPOffset")
    if offset is None:
        raise FileError(source.path, "has a waypoint without a TCP", line=waypoint.line)
    return pose(source, offset)


def _named(tcp: FloatArray) -> str:
    x, y, z = tcp[:3, 3]
    return f"TCP at {x:.1f}, {y:.1f}, {z:.1f} mm"


def _same(first: FloatArray, second: FloatArray) -> bool:
    apart = np.abs(first - second)
    return bool(apart[:3, 3].max() < _SAME_MM and apart[:3, :3].max() < _SAME_RAD)
