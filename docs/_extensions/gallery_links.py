"""Add to the docstring of each public name the examples of the gallery that use it."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import truepose

EXAMPLES = Path(__file__).parents[2] / "examples"


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect with autodoc."""
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True}


@cache
def _uses() -> dict[str, list[str]]:
    """Return the names of the examples that use ``tp.name``, by name."""
    uses: dict[str, list[str]] = {}
    for path in sorted(EXAMPLES.glob("plot_*.py")):
        for name in sorted(set(re.findall(r"\btp\.(\w+)", path.read_text("utf-8")))):
            uses.setdefault(name, []).append(path.stem)
    return uses


def _link(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    short = name.rpartition(".")[2]
    if short in truepose.__all__ and getattr(truepose, short) is obj and short in _uses():
        links = ", ".join(f":doc:`/gallery/{stem}`" for stem in _uses()[short])
        lines += ["", f"*In the gallery:* {links}", ""]
