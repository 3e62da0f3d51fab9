"""The directive ``run``: commands that are run while the page is built, and shown with what they print.

All commands of a page run in one folder that is new for each build, so that a page is a session from its first line to
its last. A command that fails where it should not is a warning, and so an error of ``make docs``. A line that starts
with ``!`` is meant to fail; one that starts with ``#`` is a comment. The option ``:with:`` first copies material into
the folder: ``practice`` is the practice cell (made once for each build), any other name a folder of
``docs/how-to/files``.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

LOGGER = logging.getLogger(__name__)
COLUMNS = "116"
MATERIAL = Path(__file__).parents[1] / "how-to" / "files"
FOLDERS: dict[str, tempfile.TemporaryDirectory[str]] = {}


class Run(SphinxDirective):
    """Run each line as a command; show it with its output."""

    has_content = True
    option_spec = {"with": str.split}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        folder = FOLDERS.setdefault(self.env.docname, tempfile.TemporaryDirectory(prefix="truepose-docs-"))
        for name in self.options.get("with", []):
            shutil.copytree(practice() if name == "practice" else MATERIAL / name, Path(folder.name) / name)
        text = "\n".join(self._shown(line, Path(folder.name)) for line in self.content if line)
        block = nodes.literal_block(text, text, language="console", classes=["shown"])
        self.set_source_info(block)
        return [block]

    def _shown(self, line: str, folder: Path) -> str:
        if line.startswith("#"):
            return line
        fails, command = line.startswith("!"), line.lstrip("! ")
        done = execute(command, folder)
        if (done.returncode != 0) != fails:
            LOGGER.warning("%s: exit code %d\n%s", command, done.returncode, done.stdout, location=self.get_location())
        return "\n".join([f"$ {command}", *(row.rstrip() for row in done.stdout.strip("\n").splitlines())])


def execute(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of a shell in a folder, with this environment's programs first on the path."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "COLUMNS": COLUMNS, "NO_COLOR": "1", "TERM": "dumb"}
    return subprocess.run(
        command,
        shell=True,
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


@cache
def practice() -> Path:
    """Return the folder of the practice cell; the first call makes it."""
    folder = FOLDERS.setdefault("practice", tempfile.TemporaryDirectory(prefix="truepose-docs-"))
    execute("truepose demo practice --seed 7", Path(folder.name)).check_returncode()
    return Path(folder.name) / "practice"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("run", Run)
    return {"parallel_read_safe": False}
