"""The build hook of hatch that puts the pages of ``truepose app`` into the wheel.

A wheel without its pages is an error. An editable installation goes on without them when npm cannot install its
packages (no network): ``make frontend`` builds them later, and the server says so until then.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).parent))
import frontend


class FrontendHook(BuildHookInterface):
    """Build the pages before a wheel or an editable installation."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the pages if their sources changed."""
        if warning := frontend.build_for(version, Path(self.root)):
            self.app.display_warning(warning)
