"""Maps: what they predict, where they are sure."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(tags=["maps"])
