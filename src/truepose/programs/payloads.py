"""The payload on the flange at each target of a program, by its tool."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.program import Key, frame_key
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
    if not (isinstance(corrector, KnowsCell) and isinstance(corrector, KnowsWork)):
        return {}
    known = {frame_key(key): payload for key, payload in corrector.cell.conditions.payloads.items()}
    if not known:
        return {}
    alike, which = columns.shared()
    found = [known.get(_tool(target)) for target in alike]
    unknown = np.full(3, np.nan)
    mass = np.array([np.nan if one is None else one.mass_kg for one in found])
    centre = np.array([unknown if one is None or one.centre is None else one.centre for one in found])
    return {"load": mass[which], "p_load": centre[which]}


def _tool(target: Target) -> Key:
    return frame_key(target.tool) if target.tool_number is None else target.tool_number
