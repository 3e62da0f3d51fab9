"""Collect the doctests of the sources; ``--doctest-modules`` would look for some in every module of tests, too."""

from __future__ import annotations

from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule

SOURCES = Path(__file__).parent / "src"


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> DoctestModule | None:
    """Return the doctests of a module of the sources that has any."""
    if file_path.suffix != ".py" or SOURCES not in file_path.parents or ">>> " not in file_path.read_text("utf-8"):
        return None
    module: DoctestModule = DoctestModule.from_parent(parent, path=file_path)
    return module
