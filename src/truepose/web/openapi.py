"""The contract of the server as text, from which the types of the pages are generated (tools/frontend.py)."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from truepose.web.app import create_app
from truepose.web.security import Guard
from truepose.web.workspace import Workspace


def contract() -> str:
    """Return the OpenAPI document as text; without the version, which changes with each release."""
    with tempfile.TemporaryDirectory() as folder:
        document = create_app(Workspace(Path(folder)), Guard(port=0)).openapi()
    document["info"]["version"] = "1"
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"
