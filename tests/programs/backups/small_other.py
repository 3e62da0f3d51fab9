"""A second maker's format for the tests: other.txt, and tables in place of programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.programs.backups.controller import Contents, StoredFrames

FILES = {"other.txt": b"", "a.csv": b"x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1,2,3,0,0,0\n", "b.csv": b"x_mm\n1\n"}


def roots(files: Sequence[Path]) -> list[Path]:
    return [file.parent for file in files if file.name.lower() == "other.txt"]


def contents(root: Path, files: Sequence[Path]) -> Contents:
    own = [file for file in files if file.is_relative_to(root)]
    return Contents([(file,) for file in own if file.suffix == ".csv"], {}, robot="")


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    return StoredFrames()
