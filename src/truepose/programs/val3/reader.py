"""Stäubli VAL3 (.dtx): points of an application's data, with the frames and tools of the application and its libraries.

The uses of a point are read from the programs (.pgx) beside the file, and from those of other applications that have
this one as a library. Without any, every point counts as one that is moved to. Public data are judged over a project;
in a file that is read alone they are refused, because other applications may use them as ``alias:name``. The XML is
never written again: only digits of attributes change.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.errors import FileError
from truepose.programs.core.forms import FoundRun, is_run
from truepose.programs.core.joint_targets import JointNumbers, in_degrees
from truepose.programs.core.points import (
    JOINTS,
    RUN_TIME,
    Derived,
    Frame,
    Point,
    Problem,
    Use,
    at,
    computed,
    derive,
)
from truepose.programs.core.program import KnownFrames, Program, ReadOptions, frame_key
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import Source
from truepose.programs.val3.code import ProgramCode, Reference
from truepose.programs.val3.project import Project
from truepose.programs.val3.uses import ShiftedMotion, Uses
from truepose.programs.val3.values import JOINT_KEYS, KEYS, POINTS, VALUES, Value, element_of, read_data

_PLAIN: Final = re.compile(rb"\bmove[jl][ \t]*\([ \t]*$", re.IGNORECASE)
"""What stands before the goal of a motion straight to it."""
_LONGEST: Final = 40  # bytes of that
_PUBLIC: Final = Problem(
    "refuse",
    "it is public: another application may move to it or write it; give the folder with all applications, state that "
    "none does (--whole-task), or make it private",
)
_JOINTS: Final = in_degrees(1e-3)
_NO_FATHER: Final = Problem("refuse", "it has no fatherId: its frame is not known")


def read(
    path: Path,
    frames: KnownFrames,
    options: ReadOptions,
    *,
    folder: Path | None = None,
    project: Project | None = None,
) -> Program:
    """Read a .dtx file.

    `folder` or `project` holds all applications that may use its public data.
    """
    if project is None:
        project = Project.beside(path) if folder is None else Project(_within(folder), whole=True)
    return _Reader(Source.read(path), frames, options, project).read()


def _within(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.rglob("*")) if file.is_file()]


class _Place(NamedTuple):
    """A point with its value; or the first point of a run, which stands for all of them."""

    point: Point
    value: Value


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions, project: Project) -> None:
        super().__init__(source, frames, options)
        self._project, self._application = project, project.of(source.path)
        self._places: dict[tuple[str, ...], list[_Place]] = {}
        self._missing: dict[str, Point] = {}
        self._fathers: dict[int, tuple[Frame | None, str]] = {}
        self._keys: dict[int, int] = {}
        self._runs: list[_Place] = []

    def read(self) -> Program:
        application, project = self._application, self._project
        if not application.millimetres:
            raise FileError(application.path, "states lengths in inches (millimeterUnit), which are not read")
        data = read_data(self.source)
        self._declared = {name.lower(): one for name, one in data.declared.items()}
        own = project.codes(application)
        self._frames = project.table(application, "frame")
        indices = self._elements(own)
        for value in data.values:
            self._add(value, indices)
        uses = Uses(self._points, lambda point: self._fathers[id(point)][0], lambda point: self._keys[id(point)])
        if own and self._places:
            self._by_programs(uses, own)
        else:
            self._moved_by_nobody()
        self._by_others(uses)
        uses.settle()
        self._derive(uses.moved)
        self._changes()
        runs = [self._found(place) for place in self._runs]
        self.points += self._missing.values()
        for word, place, goal in uses.computed:
            point = Point(f"{goal} (line {place.line} of {place.file})", self.source, 1, problem=computed(goal))
            point.uses.append(Use(word, place))
            self.points.append(point)
        return self.program("staubli", runs=runs)

    def _elements(self, own: Sequence[ProgramCode]) -> dict[str, set[int] | None]:
        """Return the elements of arrays that programs name one by one.

        None where more than one motion goes to all, or anything but a plain motion uses all: a run knows one of each.
        """
        found: dict[str, set[int] | None] = {}
        whole: Counter[str] = Counter()
        if any(True for _ in self._project.users(self._application)):
            return dict.fromkeys(self._declared)
        for code in own:
            for reference in code.references(0, len(code.data)):
                name, index = reference.parts[0]
                if index is None:
                    before = code.data[max(0, reference.start - _LONGEST) : reference.start]
                    whole[name] += 1 if _PLAIN.search(before) else 2
                if index is not None and (elements := found.setdefault(name, set())) is not None:
                    elements.add(int(index or 0))
        return {**found, **{name: None for name, n in whole.items() if n > 1}}

    def _add(self, value: Value, indices: Mapping[str, set[int] | None]) -> None:
        """Add the points of a value."""
        if value.run is None:
            self._add_point(value)
            return
        one_by_one = indices.get(value.way[0].name.lower(), set())
        run, source = value.run, self.source
        starts = run.starts(source.data)
        for first, last, alone in _parts(value, one_by_one):
            lines = None if alone else run.part(source.data, first, last)
            if lines is None or not self._add_run(element_of(source, value, starts[first], run.line + first, lines)):
                for k in range(first, last):
                    self._add_point(element_of(source, value, starts[k], run.line + k))

    def _add_run(self, value: Value) -> bool:
        """Add a run of points; False where they are not all alike."""
        point = self._point(value)
        assert value.run is not None
        if point.problem is not None or not is_run(value.run, "staubli", point, VALUES):
            return False
        place = _Place(point, value)
        self._runs.append(place)
        self._places.setdefault(tuple(step.name.lower() for step in value.way), []).append(place)
        return True

    def _add_point(self, value: Value) -> None:
        if not (value.kind in POINTS or value.kind.startswith("joint")):
            return
        point = self._point(value)
        self.points.append(point)
        names = tuple([step.name.lower() for step in value.way])
        self._places.setdefault(names, []).append(_Place(point, value))

    def _point(self, value: Value) -> Point:
        """Return a point with its father frame."""
        point = Point(value.name, self.source, value.line)
        father = value.text("fatherId")
        frame = self._frames.named(father) if value.kind in POINTS else None
        self._fathers[id(point)] = frame, father
        self._keys[id(point)] = int(value.way[-1].key) if value.way[-1].key.isdecimal() else 0
        if value.kind not in POINTS:
            if all(key in value.attributes for key in JOINT_KEYS):
                numbers, spans = value.numbers(self.source, JOINT_KEYS)
                point.joints = JointNumbers(numbers, spans, _JOINTS)
            else:
                point.problem = JOINTS
            return point
        point.values, point.spans = value.numbers(self.source)
        words = [value.text(key) for key in ("shoulder", "elbow", "wrist")]
        point.configuration = " ".join(word for word in words if word)
        written = KEYS if self.options.orientation else KEYS[:3]
        if missing := [key for key in written if key not in value.attributes]:
            point.problem = Problem("skip", f"{', '.join(missing)} not written, so 0: nothing is added to a file")
        elif frame is None:
            point.problem = _NO_FATHER
        return point

    def _points(self, reference: Reference, every: bool = False) -> tuple[list[Point], int] | None:
        """Return the points that a reference names, and how many of its parts; None where it names no point.

        `every`: a name without an index stands for the whole array.
        """
        names = [name for name, _ in reference.parts]
        count = next((n for n in range(len(names), 0, -1) if tuple(names[:n]) in self._places), 0)
        if not count and every and (within := self._within(names, [index for _, index in reference.parts])):
            return within, len(names)
        if not count:
            declared = self._declared.get(names[0])
            if declared is None or not (declared.kind in POINTS or declared.kind.startswith("joint")):
                return None
            return [self._not_written(reference)], 1
        wanted = [index for _, index in reference.parts[:count]]
        places = self._places[tuple(names[:count])]
        found = [place.point for place in places if _named(place.value, wanted, every=every)]
        return found or [self._not_written(reference)], count

    def _within(self, names: Sequence[str], wanted: Sequence[str | None]) -> list[Point]:
        """Return the points of a structure, or of all of an array."""
        return [
            place.point
            for key, places in self._places.items()
            if key[: len(names)] == tuple(names)
            for place in places
            if all(
                index in (None, "") or index == (step.key or "0")
                for index, step in zip(wanted, place.value.way, strict=False)
            )
        ]

    def _not_written(self, reference: Reference) -> Point:
        """Return the point of an element that has no <Value>."""
        name = reference.parts[0][0]
        if reference.text not in self._missing:
            line = self._declared[name].line
            problem = Problem("skip", "it has no <Value> in the file, so it is 0: nothing is added to a file")
            point = self._missing[reference.text] = Point(reference.text, self.source, line, problem=problem)
            self._fathers[id(point)], self._keys[id(point)] = (None, ""), 0
        return self._missing[reference.text]

    def _all(self) -> Iterator[_Place]:
        return (place for places in self._places.values() for place in places)

    def _moved_by_nobody(self) -> None:
        """Let every point count as one that is moved to."""
        for place in self._all():
            frame = self._fathers[id(place.point)][0]
            place.point.uses.append(self.use(place.value.kind, place.point.line, None, frame))

    def _by_programs(self, uses: Uses, own: Sequence[ProgramCode]) -> None:
        """Take the application's own programs."""
        tools = self._project.table(self._application, "tool")
        for code in own:
            uses.take(code, tools.named, code.path.name, "")

    def _by_others(self, uses: Uses) -> None:
        """Take the programs of other applications that use public points, and refuse what may be used unseen."""
        project, public = self._project, {name for name, one in self._declared.items() if one.public}
        if not project.whole:
            if not self.options.whole_task:
                for place in self._all():
                    if place.value.public:
                        place.point.problem = place.point.problem or _PUBLIC
            return
        for other in project.applications:
            own, tools = other is self._application, project.table(other, "tool")
            for code in project.codes(other):
                for alias in code.aliases:
                    library = project.library(other, alias)
                    if library is self._application:
                        uses.take(code, tools.named, project.shown(code.path), alias)
                    elif library is None and not own:
                        self._refuse_unseen(code, alias, public)

    def _refuse_unseen(self, code: ProgramCode, alias: str, public: set[str]) -> None:
        """Refuse public points of a name that another program uses in a library that is not known."""
        for reference in code.references(0, len(code.data)):
            if reference.alias != alias or reference.parts[0][0] not in public:
                continue
            line = code.source.line(reference.start)
            used = f"{reference.text.split('.')[0]} (line {line} of {self._project.shown(code.path)})"
            for point in (self._points(reference, True) or ([], 0))[0]:
                reason = f"it is public, and another application may use it: {used}"
                point.problem = point.problem or Problem("refuse", reason)

    def _derive(self, moved: Sequence[ShiftedMotion]) -> None:
        """Let points know the positions that programs derive from them by constant shifts."""
        for motion in moved:
            shifts = (motion.value.shift,)
            assert motion.value.axes  # a motion to an unshifted point is a use of it
            follower = None
            if motion.variable:
                name = f"{motion.variable} (line {motion.place.line} of {motion.place.file})"
                follower = Point(name, self.source, motion.value.points[0].line, problem=RUN_TIME)
                follower.uses.append(motion.use(motion.value.points[0]))
                self.points.append(follower)
            found = []
            for point in motion.value.points:
                used = () if follower else (motion.use(point),)
                found.append((point, Derived(motion.place, motion.value.how, shifts, motion.value.axes, used)))
            if follower is not None:
                derive(follower, found)
            else:
                for point, one in found:
                    point.derived.append(one)

    def _changes(self) -> None:
        """Refuse the targets whose frame or tool, or one that it hangs on, a program changes."""
        written = self._project.written()
        tools = self._project.table(self._application, "tool")
        fathers = {frame.key: (frame, father) for frame, father in self._fathers.values() if frame is not None}
        points = [one.point for one in self._all()]
        uses = [use for point in points for use in (*point.uses, *(more for d in point.derived for more in d.uses))]
        named = {use.tool.key: (use.tool, use.tool.text) for use in uses if use.tool}
        for which, table, known in (("base", self._frames, fathers), ("tool", tools, named)):
            for key, (frame, text) in known.items():
                chain = [place for place, _ in table.chain(text)]
                changed = next((place for place in chain if place in written), None)
                if changed is None or key is None:
                    continue
                self.changed.setdefault((which, frame_key(key)), written[changed])
                if which == "base" and changed != chain[0]:  # a tolerance about its own origin says nothing here
                    self._hangs(frame, f"{changed[1]}, which is changed by the program ({at(written[changed])})")

    def _hangs(self, frame: Frame, on: str) -> None:
        """Refuse the points in a frame that hangs on another one."""
        for place in self._all():
            own = self._fathers[id(place.point)][0]
            if own is not None and own.key == frame.key and place.point.problem is None:
                place.point.problem = Problem("refuse", f"{frame.text} hangs on {on}")

    def _found(self, place: _Place) -> FoundRun:
        """Return a run of points with the motion to them."""
        point, lines = place.point, place.value.run
        assert lines is not None
        moved_in = None
        if point.uses and not isinstance(point.uses[0].line, int):
            moved_in = np.full(lines.items, point.uses[0].line.line, np.int32)
        return FoundRun(lines, point, VALUES, moved_in, (place.value.way[0].name + "[", "]"))


def _parts(value: Value, one_by_one: set[int] | None) -> Iterator[tuple[int, int, bool]]:
    """Yield the parts of a run: the first place, that behind the last, and whether the elements stand alone.

    The first element of an array has a name without an index, so it stands alone.
    """
    assert value.run is not None
    first, items = int(value.way[0].key), value.run.items
    if one_by_one is None:
        yield 0, items, True
        return
    places = sorted(k - first for k in one_by_one | {0} if 0 <= k - first < items)
    done = 0
    for k in places:
        if k > done:
            yield done, k, False
        yield k, k + 1, True
        done = k + 1
    if done < items:
        yield done, items, False


def _named(value: Value, wanted: Sequence[str | None], *, every: bool) -> bool:
    """Return whether indices are those of a value."""
    if value.run is not None:
        return wanted[0] is None or (every and wanted[0] == "")
    return all(
        index is None or (every and index == "") or (index or "0") == (step.key or "0")
        for step, index in zip(value.way, wanted, strict=True)
    )
