"""Conversions, used only at the edges: inside everything is mm and rad (theory)."""

from __future__ import annotations

import re
from typing import Final

from truepose.errors import DataError

MM_PER: Final = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "in": 25.4}
"""Millimetres in one unit of length, by the unit's name."""
_SHARE: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{0,9})?)\s*(%)?")


def parse_share(value: object) -> float:
    """Return a share between 0 and 1 from a number, or from a text such as ``"95%"`` or ``"0.95"``.

    Raises
    ------
    DataError
        If it is neither, or not between 0 and 1.

    Examples
    --------
    >>> parse_share("95%"), parse_share(0.5)
    (0.95, 0.5)
    """
    share = -1.0
    if isinstance(value, str) and (m := _SHARE.fullmatch(value.strip())):
        share = float(m[1]) / (100.0 if m[2] else 1.0)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        share = float(value)
    if 0.0 <= share <= 1.0:
        return share
    raise DataError(f'expected a share such as "95%" or 0.95, got {value!r}')
