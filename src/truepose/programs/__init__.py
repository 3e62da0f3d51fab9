"""Robot programs: read as targets, corrected in place, byte-exact."""

from truepose.programs.core.outcomes import Outcome
from truepose.programs.core.targets import FrameTable, Program, ReadOptions, Target
from truepose.programs.correct import CorrectedProgram, Corrector, correct_program
from truepose.programs.coverage import Coverage
from truepose.programs.reading import Reading, read_program, read_programs

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
