"""Names that ``truepose`` exports: the role ``tp`` links to one, and its docstring links to examples of the gallery."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from docutils.nodes import Element
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.roles import XRefRole

import truepose

EXAMPLES = Path(__file__).parents[2] / "examples"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the role, and connect with autodoc."""
    app.add_role("tp", PublicName(warn_dangling=True))
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True}


class PublicName(XRefRole):
    """A link to an exported name, wherever its documentation is."""

    def process_link(
        self, env: BuildEnvironment, refnode: Element, has_explicit_title: bool, title: str, target: str
    ) -> tuple[str, str]:
        """Return the title, and the full name."""
        refnode["refdomain"], refnode["reftype"] = "py", "obj"
        return title, f"truepose.{truepose._HOME[target]}.{target}"


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
