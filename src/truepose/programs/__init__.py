"""Robot programs: read as targets, corrected in place, byte-exact."""

from truepose.programs.correct import CorrectedProgram, Corrector, correct_program
from truepose.programs.coverage import Coverage
from truepose.programs.outcomes import Outcome
from truepose.programs.reading import Reading, read_program, read_programs
from truepose.programs.targets import FrameTable, Program, ReadOptions, Target

__all__ = [
    "CorrectedProgram",
    "Corrector",
    "Coverage",
    "FrameTable",
    "Outcome",
    "Program",
    "ReadOptions",
    "Reading",
    "Target",
    "correct_program",
    "read_program",
    "read_programs",
]
