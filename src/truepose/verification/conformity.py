"""Decide on conformity with a tolerance, measurement uncertainty included (ISO 14253-1)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from truepose.errors import DataError

Conformity = Literal["pass", "undecided", "fail"]
Assessment = Literal["pass", "not assessed", "undecided", "fail"]
"""The decision on several errors: ``not assessed`` where those that were measured pass, and others were not."""

CONFORMITIES: Final[tuple[Conformity, ...]] = get_args(Conformity)
ASSESSMENTS: Final[tuple[Assessment, ...]] = get_args(Assessment)
"""From the best to the worst."""
COVERAGE_FACTOR: Final = 2.0
"""The factor k from a standard uncertainty to an expanded one."""
RULE: Final = (
    "Decision rule (ISO 14253-1), with tolerance T and expanded uncertainty U = k u: "
    "PASS if error + U <= T, FAIL if error - U > T, UNDECIDED between them."
)


def conformity(error: ArrayLike, expanded: ArrayLike, tolerance: float) -> list[Conformity]:
    """Return the decision on each error: pass, undecided or fail.

    Parameters
    ----------
    error : (n,) array [mm]
        The lengths of the errors.
    expanded : (n,) array [mm]
        Their expanded uncertainties U (k = 2).
    tolerance : float [mm]
        The largest permitted length T of an error.

    Returns
    -------
    list of {"pass", "undecided", "fail"}
        The decisions: ``pass`` if error + U ≤ T, ``fail`` if error − U > T, ``undecided`` between them.

    Raises
    ------
    DataError
        If the tolerance is not positive, or an uncertainty is negative or not finite.

    Notes
    -----
    Source: ISO 14253-1:2017, simple acceptance and rejection with guard bands of one expanded uncertainty.

    Examples
    --------
    >>> conformity([0.05, 0.19, 0.30], 0.02, tolerance=0.2)
    ['pass', 'undecided', 'fail']
    """
    e, u = np.broadcast_arrays(np.asarray(error, np.float64), np.asarray(expanded, np.float64))
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise DataError(f"expected a positive tolerance in mm, got {tolerance!r}")
    if not (np.isfinite(u) & (u >= 0.0)).all():
        raise DataError("expected expanded uncertainties that are finite and not negative")
    place = np.where(e + u <= tolerance, 0, np.where(e - u > tolerance, 2, 1))
    return [CONFORMITIES[k] for k in place.tolist()]


def overall(decisions: Iterable[Assessment]) -> Assessment:
    """Return the worst of the decisions; ``not assessed`` if there is none."""
    return max(decisions, key=ASSESSMENTS.index, default="not assessed")
