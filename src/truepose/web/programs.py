"""Programs: verdicts, corrections and differences."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(tags=["programs"])
