"""The build hook of hatch that puts the pages of ``truepose app`` into the wheel, where they are built.

It never builds them: an installation from the sources needs neither Node nor npm's registry. Without current pages the
wheel has none, and the build says so in one line. A wheel for a release is built with ``TRUEPOSE_PAGES=require``: then
missing and outdated pages are an error. An editable installation takes the pages of the tree.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))
import frontend


class FrontendHook(BuildHookInterface):
    """Add the built pages to a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the pages if they are current; if not, say so, or fail where they are required."""
        wish = os.environ.get("TRUEPOSE_PAGES", "")
        if wish not in ("", "require"):
            self.app.abort(f"TRUEPOSE_PAGES is {wish!r}; expected 'require', or leave it unset")
        if version == "editable":
            return
        lack = frontend.lacking(Path(self.root))
        if lack is None:
            build_data["artifacts"].append("/src/truepose/web/static/**")
        elif wish == "require":
            self.app.abort(f"TRUEPOSE_PAGES=require, but {lack}")
        else:
            self.app.display_info(f"This wheel is made without pages: {lack}")
