"""The judge that turns points into targets with verdicts (docs/programs.md), when the whole program is read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core import orientations
from truepose.programs.core.columns import Follow, ProgramTargets, Stretch
from truepose.programs.core.order import Sweep, in_order
from truepose.programs.core.points import (
    ALLOWED_JOINTS,
    AS_MEASURED,
    FIXED_TOOL,
    JOINTS,
    RUN_TIME,
    Frame,
    Place,
    Point,
    Problem,
    Use,
    at,
    how_to_state,
    stated_frame,
)
from truepose.programs.core.program import FrameTolerance, Key, KnownFrames, ReadOptions, frame_key
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target, Verdict

_NO_FRAME: Final = Frame("")
"""Of joint targets, which need none."""


class NotCorrected(Exception):  # noqa: N818 - ends the questions about one target
    """The verdict on a target that is not corrected."""

    def __init__(self, verdict: Verdict, reason: str) -> None:
        self.problem = Problem(verdict, reason)
        super().__init__(reason)


WITHIN: Final = {
    "tool": "--tool-tolerance corrects with the stored tool",
    "base": "--frame-tolerance corrects with the stored frame",
}
"""The remedy where a program changes a tool or base whose stored value is known."""


class Judge:
    """Gives points their frame, tool and verdict.

    Parameters
    ----------
    frames : KnownFrames
        The controller's tools and bases.
    options : ReadOptions
        The options of reading.
    controller : str
        The convention of the orientation numbers.
    unit : float [mm]
        The unit of the position's digits.
    tool_default, frame_default : Frame, optional
        The tool and base of motions that name none, if the user states none. None: such a target is refused.
    changed : mapping of ("tool" or "base", key or None) to place
        The places where the program changes a tool or base; None: some of them.
    """

    def __init__(
        self,
        frames: KnownFrames,
        options: ReadOptions,
        controller: str,
        *,
        unit: float = 1.0,
        tool_default: Frame | None = None,
        frame_default: Frame | None = None,
        changed: Mapping[tuple[str, Key | None], Place] | None = None,
    ) -> None:
        self._frames, self._options = frames, options
        self._controller, self.unit = controller, unit
        self._default = {"tool": tool_default, "base": frame_default}
        self._changed = changed or {}
        self._derived = options.derived or (options.offsets and controller == "abb")

    def target(self, point: Point) -> Target:
        """Return the target of a point."""
        tool = frame = tf_flange_tool = tf_base_frame = None
        problem: Problem | None = None
        try:
            self._check(point)
        except NotCorrected as stop:
            problem = stop.problem
        uses = _uses(point)
        try:  # also where the target stays as it is: a path may go through it
            if uses:
                tool, frame = self._in_force(point, uses)
                if tool.stands or frame.stands:
                    self._check_held(point, tool, frame)
                if problem is None and point.objection is not None:
                    raise NotCorrected(*point.objection)
                frame = self._within_tolerance("base", frame)
                tool = self._within_tolerance("tool", tool) if point.joints is None else tool
                if tool.changed and frame.changed:
                    reason = f"{tool.changed}, and {frame.changed}: only one of both may be known within a tolerance"
                    raise NotCorrected("refuse", reason)
                tf_flange_tool, tf_base_frame = self._transforms(tool, frame)
        except NotCorrected as stop:
            problem = problem or stop.problem
        if problem is None and tool is not None and tool.stands == "base":
            problem = FIXED_TOOL
        if (joints := point.joints) is not None and not self._options.joint_targets:
            problem = JOINTS if problem else ALLOWED_JOINTS
        known = len(point.values) == 3 + orientations.count(self._controller)
        return Target(
            name=point.name,
            path=point.source.path,
            line=point.line,
            motions=tuple([use.word for use in point.uses]),
            verdict=problem.verdict if problem else "correct",
            reason=problem.reason if problem else "",
            frame=frame.text if frame else "",
            tool=tool.text if tool else "",
            frame_number=frame.key if frame and isinstance(frame.key, int) else None,
            tool_number=tool.key if tool and isinstance(tool.key, int) else None,
            xyz=tuple([value * self.unit for value in point.values[:3]]) if known else None,
            angles=point.values[3:] if known else None,
            controller=self._controller,
            tf_base_frame=tf_base_frame,
            tf_flange_tool=tf_flange_tool,
            status=point.status,
            turn=point.turn,
            configuration=point.configuration,
            spans=point.spans if known else () if joints is None else joints.spans,
            unit=self.unit,
            joints=None if joints is None else joints.values,
            joint_form=None if joints is None else joints.form,
            derived=tuple([one.of_target() for one in point.derived]) if self._derived else (),
            follows=tuple([one.name for one in point.follows]) if self._follows(point) else (),
            frame_changed=frame.changed if frame else "",
            tool_changed=tool.changed if tool else "",
            stands=tool.stands if tool else "",
        )

    def _check(self, point: Point) -> None:
        if self._follows(point):
            names = ", ".join(dict.fromkeys(one.name for one in point.follows))
            raise NotCorrected("skip", f"derived from {names}: it gets the correction of that point")
        if point.problem is not None and (point.uses or point.problem.verdict == "skip"):
            raise NotCorrected(*point.problem)
        if point.reads:
            line, how = point.reads[0]
            if point.uses:
                use = point.uses[0]
                raise NotCorrected(self._options.ambiguous, f"both moved to ({at(use.line)}) and {how} ({at(line)})")
            raise NotCorrected("skip", f"{how} ({at(line)})")
        if point.writes:
            line, how = point.writes[0]
            raise NotCorrected("skip", f"{how} at run time ({at(line)})")
        if point.shared is not None:
            raise NotCorrected(*point.shared)
        if point.derived and (not self._derived or point.joints is not None):
            raise NotCorrected(*self._only_if_allowed(point))
        uses = _uses(point)
        if not uses:
            raise NotCorrected("skip", "no motion of this program goes to it")
        if not point.values and point.joints is None:
            raise NotCorrected(*RUN_TIME)
        problems = {use.problem for use in uses}
        hindered = [use for use in uses if use.problem is not None]
        if not hindered:
            return
        first = hindered[0]
        assert first.problem is not None
        if None in problems and first.problem.verdict == "skip":
            other = next(use for use in uses if use.problem is None)
            reason = f"moved to ({at(other.line)}) and, in {at(first.line)}, {first.problem.reason}: teach two points"
            raise NotCorrected(self._options.ambiguous, reason)
        raise NotCorrected(*first.problem)

    def _only_if_allowed(self, point: Point) -> Problem:
        """Return why a point is left from which positions are derived, although nothing else is against it."""
        first = point.derived[0]
        allow = f"read by arithmetic ({at(first.place)}): {first.how}"
        allow += "; --derived corrects both alike" if point.joints is None else ""
        if not point.uses:
            return Problem("skip", allow)
        return Problem(self._options.ambiguous, f"both moved to ({at(point.uses[0].line)}) and {allow}")

    def _in_force(self, point: Point, uses: Sequence[Use]) -> tuple[Frame, Frame]:
        found: dict[tuple[Frame, Frame], Use] = {}
        for use in uses:
            frame = self._of("base", use.frame) if point.joints is None else _NO_FRAME
            found.setdefault((self._of("tool", use.tool), frame), use)
        if len(found) > 1:
            (first, a), (second, b) = list(found.items())[:2]
            k = 0 if first[0] != second[0] else 1
            words = [one[k].text + (" of a held part" if one[k].stands else "") for one in (first, second)]
            reason = f"moved to under {words[0]} ({at(a.line)}) and {words[1]} ({at(b.line)})"
            raise NotCorrected(self._options.ambiguous, f"{reason}: teach two points")
        return next(iter(found))

    def _of(self, which: Literal["tool", "base"], frame: Frame | None) -> Frame:
        if frame is not None:
            return frame
        if (known := stated_frame(self._frames, which) or self._default[which]) is not None:
            return known
        raise NotCorrected("refuse", f"the program names no {which}; state the one in force ({how_to_state(which)})")

    def _check_held(self, point: Point, tool: Frame, frame: Frame) -> None:
        """Refuse what is not corrected where the robot holds the part, to a tool that stands in the world."""
        stands = "the tool stands in the world and the robot holds the part"
        why = ""
        if point.joints is not None:
            why = f"{stands}: which point of it the joints bring to the tool is not known"
        elif tool.stands != frame.stands:
            whose = tool if tool.stands else frame
            why = f"{stands} ({whose.text}), but {(frame if tool.stands else tool).text} is not of such a part"
        elif tool.text == AS_MEASURED:
            why = f"{stands}, of which the program names no frame; state that on the flange"
        elif tool.stands == "base" and frame.key == 0:
            why = f"{stands}, but {frame.text} is no tool; state where the tool stands"
        elif self._options.orientation:
            why = f"{stands}: positions are corrected there, without orientations"
        elif point.derived:
            why = f"{stands}: positions that are derived from this one ({at(point.derived[0].place)}) are not corrected"
        elif tool.stands == "tool" and (given := self._given(tool, frame)) is not None:
            why = f"{given.text} is also in [frames], where tools are on the flange and bases in the world; remove it"
        if why:
            raise NotCorrected("refuse", why)

    def _given(self, tool: Frame, frame: Frame) -> Frame | None:
        """Return the first of a tool and a base that the user gives."""
        tables = ((tool, self._frames.tools), (frame, self._frames.bases))
        return next((one for one, table in tables if one.key is not None and frame_key(one.key) in table), None)

    def _changed_at(self, which: str, frame: Frame) -> str:
        """Return where the program changes a tool or base; empty if it does not."""
        if frame.key is None:
            return ""
        key = frame_key(frame.key)
        place = self._changed.get((which, key)) or (self._changed.get((which, None)) if key != 0 else None)
        return f"{frame.text} is changed by the program ({at(place)})" if place else ""

    def _tolerance(self, which: str) -> FrameTolerance | None:
        """Return how far a tool or base may lie from its stored value at run time."""
        return self._options.tool_tolerance if which == "tool" else self._options.frame_tolerance

    def _within_tolerance(self, which: str, frame: Frame) -> Frame:
        """Return a tool or base whose stored value counts, if the options allow that and it is known."""
        how = self._changed_at(which, frame) if self._tolerance(which) and not frame.stands else ""
        table = self._frames.tools if which == "tool" else self._frames.bases
        known = frame.tf is not None or (frame.key is not None and frame_key(frame.key) in table)
        return frame._replace(changed=how) if how and known else frame

    def _transforms(self, tool: Frame, frame: Frame) -> tuple[FloatArray | None, FloatArray | None]:
        """Return a tool and a base; the reason why they are not known is one for both."""
        found: list[FloatArray | None] = []
        problems: list[Problem] = []
        for which, one in (("tool", tool), ("base", frame)):
            try:
                found.append(self._transform(which, one))
            except NotCorrected as stop:
                problems.append(stop.problem)
        if problems:
            raise NotCorrected(problems[0].verdict, "; ".join(problem.reason for problem in problems))
        return found[0], found[1]

    def _transform(self, which: str, frame: Frame) -> FloatArray | None:
        if frame.text == AS_MEASURED or frame is _NO_FRAME:
            return None
        table = self._frames.tools if which == "tool" else self._frames.bases
        key = None if frame.key is None else frame_key(frame.key)
        if not frame.changed and (how := self._changed_at(which, frame)):
            stored = key in table or frame.tf is not None
            raise NotCorrected("refuse", f"{how}; {WITHIN[which]}" if stored else how)
        if key is not None and (why := self._frames.problems.get((which, key))):
            raise NotCorrected("refuse", f"{which} {frame.text} {why}")
        held = None if key is None else self._frames.of_held_parts.get((which, key))
        if held is not None and held != bool(frame.stands):
            what = {"tool": "a part in the gripper", "base": "a fixed tool"}[which]
            marked, moves = ("is", "a tool") if held else ("is not", "the part")
            raise NotCorrected("refuse", f"{which} {frame.text} {marked} marked as {what}, but the robot holds {moves}")
        if key is not None and key in table:
            return table[key]
        if frame.tf is not None:
            tf = _array(frame.tf)
            if which != (frame.stands or "base"):
                return tf  # on the flange
            if why := self._frames.problems.get(("base", 0)):  # the program gives it in the world
                raise NotCorrected("refuse", f"{which} {frame.text} {why}")
            return self._frames.bases[0] @ tf
        raise NotCorrected("refuse", f"{which} {frame.text} is not known; {self._remedy(which, frame)}")

    def _remedy(self, which: str, frame: Frame) -> str:
        """Return how the user gives a tool or base that is not known."""
        if frame.stands == "tool":
            return "state it with numbers where the program declares it: the robot holds the part"
        return f"give it in [frames.{'tools' if which == 'tool' else 'bases'}.{frame.key}] of the cell file"

    def program_targets(
        self,
        points: Sequence[Point],
        circles: Iterable[Sequence[Point]],
        runs: Sequence[tuple[Sweep | None, Stretch]] = (),
        sources: Sequence[Source] = (),
    ) -> tuple[ProgramTargets, tuple[tuple[int, ...], ...]]:
        """Return the targets in the order of the text, and the circles as their indices.

        Parameters
        ----------
        points : sequence of Point
            The points.
        circles : iterable of sequences of Point
            Points that are corrected together or not at all.
        runs : sequence of (Sweep or None, Stretch)
            Runs of targets, each with the motions to them.
        sources : sequence of Source
            The files in their order; by default that of the points.
        """
        place = {id(point): i for i, point in enumerate(points)}
        joined = [[place[id(point)] for point in circle] for circle in circles]
        visits = [use.visit(place[id(point)]) for point in points for use in point.uses]
        sweeps = [(sweep, i) for i, (sweep, _) in enumerate(runs, len(points)) if sweep is not None]
        sources = sources or list({point.source: None for point in points})
        items: list[Target | Stretch] = [*map(self.target, points), *(stretch for _, stretch in runs)]
        return in_order(items, joined, sources, visits, sweeps, self._followers(points, place))

    def _followers(self, points: Sequence[Point], place: Mapping[int, int]) -> dict[int, Follow]:
        """Return what the targets without numbers of their own follow, by their places."""
        return {
            i: Follow(tuple([place[id(source)] for source in point.follows]), point.shift)
            for i, point in enumerate(points)
            if self._follows(point)
        }

    def _follows(self, point: Point) -> bool:
        """Return whether a target gets the correction of others; without shifts it goes to these themselves."""
        return bool(point.follows) and (self._derived or not any(one.derived for one in point.follows))


def _uses(point: Point) -> list[Use]:
    """Return all motions that count for the tool and frame of a point."""
    return [*point.uses, *(use for one in point.derived for use in one.uses)]


@lru_cache(maxsize=256)
def _array(tf: bytes) -> FloatArray:
    return np.frombuffer(tf).reshape(4, 4)
