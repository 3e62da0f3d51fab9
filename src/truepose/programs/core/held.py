"""Orientations that hold over several lines: the numbers of a point that other points take over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from truepose.programs.core.points import NOT_HERE, Point, Problem

HELD: Final = Problem(
    "skip", "its orientation holds over several lines; write it in each of them, or correct positions"
)


def leave_held(points: Sequence[Point]) -> None:
    """Leave out points whose orientation is in another line, and those whose orientation other points take over."""
    for k, point in enumerate(points):
        if NOT_HERE in point.spans:
            point.problem = point.problem or HELD
            for before in reversed(points[:k]):
                if before.spans:
                    before.problem = before.problem or HELD
                    break
