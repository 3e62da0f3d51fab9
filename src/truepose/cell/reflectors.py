"""The check of the reflectors that a cell file states."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.cell.poses import CellError

_APART: Final = 1.0  # mm
_NOT_IN_NAMES: Final = ',;"\t\n\r/'


def check_reflectors(p_flange: Mapping[str, FloatArray]) -> None:
    """Refuse names that are no word of a table or are alike, and two reflectors at one place.

    Raises
    ------
    CellError
        With the table and the remedy.

    Examples
    --------
    >>> check_reflectors({"A": np.zeros(3), "B": np.array([0.0, 0.0, 80.0])})
    """
    for name in p_flange:
        if not name.strip() or name != name.strip() or any(letter in name for letter in _NOT_IN_NAMES):
            raise CellError(("reflectors", name), f"the name {name!r} is not one word; name it A, B, C or the like")
    for (first, a), (second, b) in combinations(p_flange.items(), 2):
        if first.lower() == second.lower():
            raise CellError(("reflectors", second), f"{first!r} and {second!r} are one name; rename one of them")
        if np.linalg.norm(a - b) < _APART:
            raise CellError(("reflectors", second), f"is where {first!r} is; correct its position in the flange frame")
