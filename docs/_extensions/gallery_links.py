"""Add to the docstring of each public name the examples of the gallery that use it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import truepose

_EXAMPLE = re.compile(r":ref:`(sphx_glr_gallery_plot_\w+\.py)`")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect with autodoc."""
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True}


def _link(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    short = name.rpartition(".")[2]
    if short not in truepose.__all__ or getattr(truepose, short) is not obj:
        return
    folder = Path(app.srcdir) / app.config.sphinx_gallery_conf["backreferences_dir"]
    path = folder / f"truepose.{short}.examples"
    found = dict.fromkeys(_EXAMPLE.findall(path.read_text("utf-8") if path.exists() else ""))
    if found:
        lines += ["", f"*In the gallery:* {', '.join(f':ref:`{label}`' for label in found)}", ""]
