"""Turn the words "theory (10)" of docstrings into links to the equation."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_CITATION = re.compile(r"theory \((\d+)\)")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect with autodoc."""
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True}


def _link(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [_CITATION.sub(r":ref:`theory (\1) <theory-\1>`", line) for line in lines]
