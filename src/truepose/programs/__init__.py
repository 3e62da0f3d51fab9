"""Robot programs: read as targets, corrected in place, byte-exact."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.programs.backups.backup import Backup, Controller
    from truepose.programs.batch import CorrectedBatch, RefusedProgram, correct_programs
    from truepose.programs.core.outcomes import CorrectedShare, Outcome
    from truepose.programs.core.program import FrameTolerance, Program, ReadOptions
    from truepose.programs.core.target import Target
    from truepose.programs.correct import correct_program
    from truepose.programs.corrected import CorrectedProgram
    from truepose.programs.corrector import Corrector
    from truepose.programs.coverage import Coverage
    from truepose.programs.frame_table import FrameTable
    from truepose.programs.reading import Reading, read_program, read_programs
    from truepose.programs.verified import ProgramVerification, VerifiedTarget
    from truepose.programs.verify import verify_program
    from truepose.programs.watching import FolderWatch, WatchEvent

_HOME = {
    "Backup": "backups.backup",
    "Controller": "backups.backup",
    "CorrectedBatch": "batch",
    "CorrectedProgram": "corrected",
    "CorrectedShare": "core.outcomes",
    "Corrector": "corrector",
    "Coverage": "coverage",
    "FolderWatch": "watching",
    "FrameTable": "frame_table",
    "FrameTolerance": "core.program",
    "Outcome": "core.outcomes",
    "Program": "core.program",
    "ProgramVerification": "verified",
    "ReadOptions": "core.program",
    "Reading": "reading",
    "RefusedProgram": "batch",
    "Target": "core.target",
    "VerifiedTarget": "verified",
    "WatchEvent": "watching",
    "correct_program": "correct",
    "correct_programs": "batch",
    "read_program": "reading",
    "read_programs": "reading",
    "verify_program": "verify",
}

__all__ = [
    "Backup",
    "Controller",
    "CorrectedBatch",
    "CorrectedProgram",
    "CorrectedShare",
    "Corrector",
    "Coverage",
    "FolderWatch",
    "FrameTable",
    "FrameTolerance",
    "Outcome",
    "Program",
    "ProgramVerification",
    "ReadOptions",
    "Reading",
    "RefusedProgram",
    "Target",
    "VerifiedTarget",
    "WatchEvent",
    "correct_program",
    "correct_programs",
    "read_program",
    "read_programs",
    "verify_program",
]

__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
