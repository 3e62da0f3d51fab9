"""Conversions, used only at the edges: inside everything is mm and rad (method.md §0)."""

from __future__ import annotations

from typing import Final

MM_PER: Final = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "in": 25.4}
"""Millimetres in one unit of length, by the unit's name."""
