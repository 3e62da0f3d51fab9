"""The base of the readers whose program is one file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol, TypeVar

from truepose.programs.core.flow import BlockError, Flow
from truepose.programs.core.forms import FoundRun
from truepose.programs.core.judge import Judge
from truepose.programs.core.pieces import Section
from truepose.programs.core.points import Frame, Place, Point, Problem, Use
from truepose.programs.core.program import Key, KnownFrames, Program, ReadOptions
from truepose.programs.core.source import PLAIN_LEXER, Source


class Instruction(NamedTuple):
    """A line of a program and its code."""

    line: int
    code: bytes


class _HasLine(Protocol):
    @property
    def line(self) -> int: ...


_Statement = TypeVar("_Statement", bound=_HasLine)


class Reader:
    """Collects the targets of a program while a language's reader goes through the text.

    Parameters
    ----------
    source : Source
        The file.
    frames : KnownFrames
        The controller's tools and bases.
    options : ReadOptions
        The options of reading.

    Attributes
    ----------
    flow : Flow
        The ways through the program.
    points : list of Point
        The targets found so far.
    circles : list of list of Point
        ProgramTargets that are corrected together or not at all.
    changed : dict of ("tool" or "base", key or None) to place
        The places where the program changes a tool or base; None: some of them.
    """

    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        self.source, self.frames, self.options = source, frames, options
        self.flow = Flow()
        self.points: list[Point] = []
        self.circles: list[list[Point]] = []
        self.changed: dict[tuple[str, Key | None], Place] = {}
        self._arc: list[Point] = []

    def body(self, statements: Iterable[_Statement], take: Callable[[_Statement], None]) -> None:
        """Take the statements of the routine that has begun one by one, and end it."""
        line = 1
        try:
            for statement in statements:
                line = statement.line
                take(statement)
                line = getattr(statement, "last_line", line)  # of a run
            self.flow.end_routine()
        except BlockError as error:
            raise self.source.error(line, f"{error}; correct the file") from None

    def use(
        self,
        word: str,
        line: int,
        tool: Frame | None = None,
        frame: Frame | None = None,
        problem: Problem | None = None,
        section: Section | None = None,
    ) -> Use:
        """Return a motion; where no section is given, in the routine that is being read."""
        return Use(word, line, tool, frame, problem, section or self.flow.motion())

    def other(self, word: str, line: int, problem: Problem, name: str = "") -> Point:
        """Add a motion that has no numbers to correct."""
        point = Point(name or f"{word}:{line}", self.source, line, problem=problem, uses=[self.use(word, line)])
        self.points.append(point)
        return point

    def arc(self, point: Point | None) -> None:
        """Add the next point of an arc; None ends the arc."""
        if point is not None:
            self._arc.append(point)
            return
        if len(self._arc) > 1:
            self.circles.append(self._arc)
        self._arc = []

    def program(
        self,
        controller: str,
        *,
        unit: float = 1.0,
        tool: Frame | None = None,
        frame: Frame | None = None,
        lexer: re.Pattern[bytes] = PLAIN_LEXER,
        finest: float = 0.0,
        runs: Iterable[FoundRun] = (),
    ) -> Program:
        """Return the program with its verdicts; see `Judge` and `Program` for the parameters.

        `runs` are runs of targets of one form.
        """
        self.arc(None)
        judge = Judge(
            self.frames,
            self.options,
            controller,
            unit=unit,
            tool_default=tool,
            frame_default=frame,
            changed=self.changed,
        )
        stretches = [run.judged(judge) for run in runs]
        targets, circles = judge.program_targets(self.points, self.circles, stretches, [self.source])
        return Program(self.source.path, (self.source,), targets, circles, lexer, finest=finest)
