"""Identified parameters as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from truepose.identification.arm import ParametricArm
from truepose.identification.batch import Identification
from truepose.identification.observability import Observability

_ONLY_PRIOR: Final = 0.9  # of the tolerance: with a larger standard deviation the data contribute almost nothing


def parameter_table(
    arm: ParametricArm, solution: Identification, seen: Observability, prior: bool
) -> list[dict[str, Any]]:
    """Return the table of identified parameters, one row for each.

    Parameters
    ----------
    arm : ParametricArm
        The arm and its parameters.
    solution : Identification
        The identified changes.
    seen : Observability
        The observability of the parameters.
    prior : bool
        Whether the tolerances took part in the fit.

    Returns
    -------
    list of dict
        ``parameter``, ``group``, ``unit``, ``nominal``, ``identified``, ``change``, ``std`` (None where the
        parameter was kept), ``prior_std``, its tolerance, ``off``, the change in multiples of that, and ``note``, a
        remark on its identifiability.
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
                "prior_std": float(arm.tolerance[k]),
                "off": float(solution.x[k] / arm.tolerance[k]),
                "note": _note(parameter.name, free, float(std[k] / arm.tolerance[k]), seen.apart, prior),
            }
        )
    return rows


def _note(name: str, free: bool, part: float, apart: Mapping[str, tuple[str, ...]], prior: bool) -> str:
    if name in apart:
        others = ", ".join(apart[name])
        remark = f"not identifiable with {others}" if others else "not identifiable: it has no effect"
        return remark if free else f"{remark}; kept"
    if prior and part > _ONLY_PRIOR:
        return "known by its tolerance only"
    return "" if free else "kept"
