"""The checks of the reflectors, and of other tables with names, that a cell file states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.cell.poses import CellError

_APART: Final = 1.0  # mm
_NOT_IN_NAMES: Final = ',;"\t\n\r/'


def check_names(section: str, names: Iterable[str]) -> None:
    """Refuse names of tables ``[section.NAME]`` that are no word of a table or are alike.

    Raises
    ------
    CellError
        With the table and the remedy.
    """
    known = list(names)
    for name in known:
        if not name.strip() or name != name.strip() or any(letter in name for letter in _NOT_IN_NAMES):
            raise CellError((section, name), f"the name {name!r} is not one word; name it A, B, C or the like")
    for first, second in combinations(known, 2):
        if first.lower() == second.lower():
            raise CellError((section, second), f"{first!r} and {second!r} are one name; rename one of them")


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
    check_names("reflectors", p_flange)
    for (first, a), (second, b) in combinations(p_flange.items(), 2):
        if np.linalg.norm(a - b) < _APART:
            raise CellError(("reflectors", second), f"is where {first!r} is; correct its position in the flange frame")
