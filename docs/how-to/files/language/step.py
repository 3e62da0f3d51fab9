"""A reader of STEP programs, a language that is made up for the documentation."""

from __future__ import annotations

import re
from pathlib import Path

from truepose.programs.core.points import JOINTS, Frame, Point, Problem, numbers_at, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import Source, shown

NUMBERS = ("x", "y", "z", "a", "b", "c")
WITHOUT_MOTION = (b"STEP", b"WAIT", b"PRINT", b"END")


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a .step file."""
    return StepReader(Source.read(path), frames, options).read()


class StepReader(Reader):
    """Goes through the lines; tool and base are in force until the next line that sets them."""

    def read(self) -> Program:
        """Return the program with its verdicts."""
        if not self.source.data.startswith(b"STEP"):
            raise self.source.error(1, "does not start with STEP: it is no STEP program")
        named: dict[bytes, Point] = {}
        tool = base = None
        for line, start, end in self.source.lines():
            code = self.source.data[start:end].partition(b"#")[0]
            words = [(m[0], start + m.start()) for m in re.finditer(rb"\S+", code)]
            if not words or words[0][0] in WITHOUT_MOTION:
                continue
            word, operands = words[0][0], words[1:]
            if word == b"TOOL":
                tool = self.frame("TOOL", operands, line)
            elif word == b"BASE":
                base = self.frame("BASE", operands, line)
            elif word == b"POINT" and len(operands) == 7:
                named[operands[0][0]] = self.point(operands[0][0].decode(), operands[1:], line)
            elif word in (b"LINE", b"SWING") and len(operands) in (1, 6):
                point = named.get(operands[0][0])
                if len(operands) == 6:
                    point = self.point(f"{word.decode()}:{line}", operands, line)
                if point is None:
                    self.other(word.decode(), line, Problem("skip", f"{shown(code)}: no POINT has this name"))
                else:
                    point.uses.append(self.use(word.decode(), line, tool, base))
            elif word == b"AXES":
                self.other("AXES", line, JOINTS)
            else:
                self.other(word.decode("latin-1"), line, unknown_motion(shown(code)))
        return self.program("kuka", finest=1e-3)

    def frame(self, word: str, operands: list[tuple[bytes, int]], line: int) -> Frame:
        """Return the tool or base of a line."""
        if len(operands) != 1 or not operands[0][0].isdigit():
            raise self.source.error(line, f"{word}: expected a number; correct the file")
        return Frame(f"{word} {int(operands[0][0])}", int(operands[0][0]))

    def point(self, name: str, operands: list[tuple[bytes, int]], line: int) -> Point:
        """Add the point whose numbers a line holds."""
        tokens, starts = zip(*operands, strict=True)
        point = Point(name, self.source, line, *numbers_at(self.source, line, NUMBERS, tokens, starts))
        self.points.append(point)
        return point
