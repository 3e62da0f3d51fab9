"""The directive ``screen``: a picture of a page of the application, from the tests that run in a real browser.

The tests write the pictures into ``build/screens``, which git ignores. A page must read well without them: where there
is none, nothing is shown. The argument is the name of the picture; ``:alt:`` says what it shows.
"""

from __future__ import annotations

import os
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

SCREENS = Path(__file__).parents[2] / "build" / "screens"


class Screen(SphinxDirective):
    """Show the picture of a page, for light and for dark themes."""

    required_arguments = 1
    option_spec = {"alt": directives.unchanged_required}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        shown: list[nodes.Node] = []
        for theme in ("light", "dark"):
            path = SCREENS / f"{self.arguments[0]}-{theme}.png"
            self.env.note_dependency(str(path))
            if path.is_file():
                here = Path(self.env.doc2path(self.env.docname)).parent
                picture = nodes.image(uri=Path(os.path.relpath(path, here)).as_posix(), alt=self.options["alt"])
                picture["classes"] += ["screen", f"only-{theme}"]
                self.set_source_info(picture)
                shown.append(picture)
        return shown


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("screen", Screen)
    return {"parallel_read_safe": True}
