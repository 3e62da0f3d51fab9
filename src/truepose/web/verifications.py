"""Verifications: targets measured again."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(tags=["verifications"])
