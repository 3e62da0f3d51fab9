"""Programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

CELLS: dict[str, list[Cell]] = {}
ABSENT: dict[str, str] = {}
