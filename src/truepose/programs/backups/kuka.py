"""Backups of KUKA: KRC/R1 … with System/$config.dat and Mada/$machine.dat."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.programs.backups.controller import Contents, StoredFrames


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup."""
    return []


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted."""
    return Contents([])


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the tools and bases of one controller."""
    return StoredFrames()
