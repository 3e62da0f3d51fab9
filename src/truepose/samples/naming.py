"""The name of a sample in messages: its point and the line of its file, or the row of a table in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

_MOST: Final = 6


def name_one(known: Mapping[str, Any]) -> str:
    """Return the name of a sample from its ``point``, ``line`` and ``row`` (`Poses.identify`), as in a map file.

    Examples
    --------
    >>> name_one({"row": 11, "point": "P12", "line": 13}), name_one({"row": 11, "line": 13}), name_one({"row": 11})
    ('point P12 (line 13)', 'line 13', 'row 11')
    """
    return name_points([known])


def name_points(known: Sequence[Mapping[str, Any]], limit: int = _MOST) -> str:
    """Return the names of samples for a message.

    Examples
    --------
    >>> name_points([{"point": "P3", "line": 4}, {"point": "P7", "line": 8}, {"point": "P9", "line": 10}], limit=2)
    'points P3 (line 4), P7 (line 8) and 1 more'
    >>> name_points([{"row": 3}, {"row": 5}])
    'rows 3, 5'
    """
    kind = next((key for key in ("point", "line", "row") if any(_has(one, key) for one in known[:limit])), "row")
    more = f" and {len(known) - limit} more" if len(known) > limit else ""
    alone = len({one.get(kind) for one in known}) == len(known)
    listed = ", ".join(_bare(one, kind, alone) for one in known[:limit])
    return f"{kind}{'s' if len(known) != 1 else ''} {listed}{more}"


def _has(known: Mapping[str, Any], key: str) -> bool:
    return known.get(key) not in (None, "")


def _bare(known: Mapping[str, Any], kind: str, alone: bool) -> str:
    """Return the name of a sample after the word of its kind; `alone` says whether it is the only one of this name."""
    if not _has(known, kind):
        return name_one(known)
    place = "line" if _has(known, "line") else "row" if not alone else ""
    return f"{known[kind]} ({place} {known[place]})" if kind == "point" and place else str(known[kind])
