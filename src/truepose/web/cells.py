"""Cells: their files and their states."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(tags=["cells"])
