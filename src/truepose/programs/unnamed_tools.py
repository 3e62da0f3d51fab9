"""Targets that name no tool, for which the tool counts that the map was measured with."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.points import AS_MEASURED
from truepose.programs.core.program import Program


def with_measured_tool(program: Program) -> int:
    """Return the number of targets to correct that name no tool."""
    n = 0
    for _, columns in program.targets.chunks():
        kinds, which = columns.shared()
        unnamed = np.array([one.verdict == "correct" and one.tool == AS_MEASURED for one in kinds])
        n += int(np.count_nonzero(unnamed[which]))
    return n


def unnamed_words(n: int, tf_flange_tool: FloatArray | None = None) -> list[str]:
    """Return a sentence about targets that name no tool, if there are any.

    Parameters
    ----------
    n : int
        The number of these targets.
    tf_flange_tool : (4, 4) array [mm], optional
        The tool that the map was measured with, if the map is known.
    """
    if not n:
        return []
    place = ""
    if tf_flange_tool is not None:
        place = ", at (" + ", ".join(f"{x:.3f}" for x in tf_flange_tool[:3, 3] + 0.0) + ") mm from the flange"
    who = "1 target names" if n == 1 else f"{n} targets name"
    return [f"{who} no tool: the tool that the map was measured with counts{place}; --tool NAME states another"]
