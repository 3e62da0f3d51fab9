"""Identified parameters as a table: what a person reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from truepose.identification.arm import ParametricArm
from truepose.identification.batch import Identification
from truepose.identification.observability import Observability

_ONLY_PRIOR: Final = 0.9  # of the tolerance: with more the data said next to nothing


def parameter_table(
    arm: ParametricArm, solution: Identification, seen: Observability, prior: bool
) -> list[dict[str, Any]]:
    """Return one row for each parameter.

    Returns
    -------
    list of dict
        ``parameter``, ``group``, ``unit``, ``nominal``, ``identified``, ``change``, ``std`` (None where it was kept),
        ``note``: why it is not known by itself, or empty.
    """
    std = np.sqrt(np.diag(solution.covariance))
    rows = []
    for k, parameter in enumerate(arm.parameters):
        free = bool(solution.free[k])
        rows.append(
            {
                "parameter": parameter.name,
                "group": parameter.group,
                "unit": parameter.unit,
                "nominal": float(arm.nominal[k]),
                "identified": float(arm.nominal[k] + solution.x[k]),
                "change": float(solution.x[k]),
                "std": float(std[k]) if free else None,
                "note": _note(parameter.name, free, float(std[k] / arm.tolerance[k]), seen.apart, prior),
            }
        )
    return rows


def _note(name: str, free: bool, part: float, apart: Mapping[str, tuple[str, ...]], prior: bool) -> str:
    if name in apart:
        others = ", ".join(apart[name])
        said = f"not identifiable with {others}" if others else "not identifiable: it moves nothing"
        return said if free else f"{said}; kept"
    if prior and part > _ONLY_PRIOR:
        return "known by its tolerance only"
    return "" if free else "kept"
