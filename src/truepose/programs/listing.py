"""All targets of programs in one file, with verdict, reason and position, whether or not anything is corrected.

The file has the form of a record: a head, and then one target a line. So a million targets are written and read a piece
at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io.files import writing
from truepose.programs.core.columns import VERDICTS
from truepose.programs.core.outcomes import DONE, Outcomes
from truepose.programs.core.paths import Continuity
from truepose.programs.core.program import Program
from truepose.programs.corrected import CorrectedProgram
from truepose.programs.record import SCHEMA, json_pieces, rows

FORMAT: Final = "truepose targets"
_CODES: Final = np.array([DONE.index(verdict) for verdict in VERDICTS], np.int8)


def write_checked(path: str | Path, programs: Sequence[Program]) -> None:
    """Write the targets of programs that were read: verdicts, reasons and positions, and no corrections.

    Parameters
    ----------
    path : str or Path
        The file (JSON).
    programs : sequence of Program
        The programs.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    parts = [rows(outcomes := checked(one), Continuity.unknown(len(outcomes)), corrected=False) for one in programs]
    _write(path, {"corrected": False}, programs, parts)


def write_corrected(path: str | Path, corrected: Sequence[CorrectedProgram]) -> None:
    """Write the targets of corrected programs with their corrections and standard deviations, as records have them.

    Parameters
    ----------
    path : str or Path
        The file (JSON).
    corrected : sequence of CorrectedProgram
        The corrected programs; they need not be written.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    known = {"corrected": True, "map_sha256": next((one.map_hash for one in corrected), None)}
    _write(path, known, [one.program for one in corrected], [rows(one.targets, one.continuity) for one in corrected])


def checked(program: Program) -> Outcomes:
    """Return the outcomes that the verdicts of reading would have if nothing refused a correction."""
    outcomes = replace(Outcomes.none(program), joints=None)
    outcomes.code[:] = _CODES[program.targets.verdicts()]
    outcomes.tell_followers()
    return outcomes


def _write(
    path: str | Path,
    known: dict[str, Any],
    programs: Sequence[Program],
    parts: Iterable[Iterable[tuple[list[str], list[str]]]],
) -> None:
    head = {
        "format": FORMAT,
        "schema": SCHEMA,
        **known,
        "files": [{"file": str(source.path), "sha256": source.sha256} for one in programs for source in one.sources],
        "summary": {"targets": sum(len(one.targets) for one in programs)},
    }
    with writing(path) as (file,):
        file.writelines(json_pieces(head, (lines for lines, _ in chain.from_iterable(parts))))
