"""Note which functions run in which test. Copies of the sources with marks import this, so it imports little itself."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = "MUTATION_REACHED"
OWNER = "MUTATION_OWNER"

_seen: set[str] = set()


def begin(owner: str) -> str:
    """Note functions for another test or fixture from here on, also in new processes; return the one before."""
    before = os.environ.get(OWNER, "")
    os.environ[OWNER] = owner
    _seen.clear()
    return before


def reached(function: str) -> None:
    """Note that a function runs."""
    if function in _seen:
        return
    _seen.add(function)
    if folder := os.environ.get(FOLDER):
        with Path(folder, f"{os.getpid()}.reached").open("a", encoding="utf-8") as file:
            file.write(f"{os.environ.get(OWNER, '')}\t{function}\n")
