"""The payload on the flange at each target of a program, by its tool."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray
from truepose.cell import Payload
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.program import Key, Program, frame_key
from truepose.programs.core.target import Target
from truepose.programs.corrector import Corrector, KnowsCell, KnowsWork


def loads_of(columns: TargetColumns, corrector: Corrector) -> dict[str, FloatArray]:
    """Return the payloads of n targets, as `truepose.ErrorMap.correct` takes them; nothing if none is stated.

    Parameters
    ----------
    columns : TargetColumns
        The targets.
    corrector : Corrector
        The corrector, whose cell states the payloads with tools of the controller, by number or name.

    Returns
    -------
    dict
        ``load``, (n,) [kg], and ``p_load``, (n, 3) [mm], flange frame; NaN where nothing is stated.
    """
    if not (known := _payloads(corrector)):
        return {}
    alike, which = columns.shared()
    found = [known.get(tool_key(target)) for target in alike]
    unknown = np.full(3, np.nan)
    mass = np.array([np.nan if one is None else one.mass_kg for one in found])
    centre = np.array([unknown if one is None or one.centre is None else one.centre for one in found])
    return {"load": mass[which], "p_load": centre[which]}


def tools_without_payload(program: Program, corrector: Corrector) -> list[str]:
    """Return a warning of the tools to which no payload belongs, if the corrector's cell states payloads with tools."""
    if not (known := _payloads(corrector)):
        return []
    missing: dict[str, None] = {}
    for _, columns in program.targets.chunks():
        found = [
            target for target in columns.shared()[0] if target.verdict == "correct" and tool_key(target) not in known
        ]
        missing |= {target.tool or "the measured tool": None for target in found}
    if not missing:
        return []
    named = ", ".join(missing)
    return [f"[conditions.payloads] states no payload with {named}: their targets have the payload at work"]


def _payloads(corrector: Corrector) -> dict[Key, Payload]:
    """Return the payloads by tool that the corrector's cell states."""
    if not (isinstance(corrector, KnowsCell) and isinstance(corrector, KnowsWork)):
        return {}
    return {frame_key(key): payload for key, payload in corrector.cell.conditions.payloads.items()}


def tool_key(target: Target) -> Key:
    """Return the tool of a target, as tables hold it."""
    return frame_key(target.tool) if target.tool_number is None else target.tool_number
