"""The directive ``rooms``: the drawing of the code's rooms and a table of them, both made from the imports."""

from __future__ import annotations

import html

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import house


class Rooms(SphinxDirective):
    """Draw the rooms, then list them with the first line of their docstrings."""

    def run(self) -> list[nodes.Node]:
        _, rooms, between = house.build()
        rows = [
            f"<tr><td><code>{name}</code></td><td>{html.escape(found.purpose)}</td>"
            f"<td>{found.files}</td><td>{found.lines}</td></tr>"
            for name, found in sorted(rooms.items())
            if name != "__init__"
        ]
        head = "<thead><tr><th>room</th><th>what it holds</th><th>files</th><th>lines</th></tr></thead>"
        table = f'<table class="docutils align-default">{head}<tbody>{"".join(rows)}</tbody></table>'
        return [nodes.raw("", part, format="html") for part in (house.drawing(rooms, between), table)]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("rooms", Rooms)
    return {"parallel_read_safe": True}
