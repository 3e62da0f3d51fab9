"""The directives ``run`` and ``python``: commands and code that are run while the page is built, with their output.

All blocks of a page run in one folder that is new for each build, so that a page is a session from its first line to
its last; pages may be read in several processes. A command that fails where it should not is a warning, and so an error
of ``make docs``; so are a command that prints a traceback and an exception of Python. A line of commands that starts
with ``!`` is meant to fail; one that starts with ``#`` is a comment. The option ``:with:`` of ``run`` first copies
material into the folder: ``practice`` is the practice cell (made once for each build), any other name a folder of
``docs/how-to/files``. Blocks of ``python`` share their names; what they print is shown, with warnings. Their option
``:figure:`` shows a picture (.png) that the block wrote, with the text of ``:alt:``.
"""

import base64
import contextlib
import io
import os
import shutil
import subprocess
import sys
import tempfile
import traceback
import warnings
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

LOGGER = logging.getLogger(__name__)
COLUMNS = "116"
MATERIAL = Path(__file__).parents[1] / "how-to" / "files"
FOLDERS = tempfile.TemporaryDirectory(prefix="truepose-docs-")
NAMES: dict[str, dict[str, Any]] = {}


class Run(SphinxDirective):
    """Run each line as a command; show it with its output."""

    has_content = True
    option_spec = {"with": str.split}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        folder = folder_of(self.env.docname)
        for name in self.options.get("with", []):
            shutil.copytree(practice() if name == "practice" else MATERIAL / name, folder / name)
        text = "\n".join(self._shown(line, folder) for line in self.content if line)
        block = nodes.literal_block(text, text, language="console", classes=["shown"])
        self.set_source_info(block)
        return [block]

    def _shown(self, line: str, folder: Path) -> str:
        if line.startswith("#"):
            return line
        fails, command = line.startswith("!"), line.lstrip("! ")
        done = execute(command, folder)
        if (done.returncode != 0) != fails or "Traceback (most recent call last)" in done.stdout:
            LOGGER.warning("%s: exit code %d\n%s", command, done.returncode, done.stdout, location=self.get_location())
        return "\n".join([f"$ {command}", *(row.rstrip() for row in done.stdout.strip("\n").splitlines())])


class Python(SphinxDirective):
    """Run a block of Python; show it with what it prints, and the picture that it wrote."""

    has_content = True
    option_spec = {"figure": directives.unchanged, "alt": directives.unchanged}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        folder, code = folder_of(self.env.docname), "\n".join(self.content)
        printed, error = interpret(code, folder, NAMES.setdefault(self.env.docname, {}))
        if error:
            LOGGER.warning("%s", error, location=self.get_location())
        shown = [nodes.literal_block(code, code, language="python")]
        if printed:
            shown.append(nodes.literal_block(printed, printed, language="text", classes=["shown"]))
        if "figure" in self.options and not error:
            picture = base64.b64encode((folder / self.options["figure"]).read_bytes()).decode()
            shown.append(nodes.image(uri=f"data:image/png;base64,{picture}", alt=self.options.get("alt", "")))
        for node in shown:
            self.set_source_info(node)
        return shown


def folder_of(page: str) -> Path:
    """Return the folder in which the commands and the code of a page run."""
    folder = Path(FOLDERS.name) / page.replace("/", "-")
    folder.mkdir(exist_ok=True)
    return folder


def interpret(code: str, folder: Path, names: dict[str, Any]) -> tuple[str, str]:
    """Run Python in a folder with given names; return what it prints, with warnings, and the traceback of an error."""
    printed = io.StringIO()

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        printed.write(f"{category.__name__}: {message}\n")

    before = Path.cwd()
    try:
        os.chdir(folder)
        with contextlib.redirect_stdout(printed), warnings.catch_warnings():
            warnings.simplefilter("default")
            warnings.showwarning = show  # type: ignore[assignment]
            exec(compile(code, "<page>", "exec"), names)
    except Exception:
        return printed.getvalue().rstrip(), traceback.format_exc()
    finally:
        os.chdir(before)
    return "\n".join(row.rstrip() for row in printed.getvalue().splitlines()).strip("\n"), ""


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
    folder = folder_of("practice")
    execute("truepose demo practice --seed 7", folder).check_returncode()
    return folder / "practice"


def prepare(app: Sphinx, env: BuildEnvironment, pages: list[str]) -> None:
    """Make the practice cell before processes share the pages."""
    if pages:
        practice()


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("run", Run)
    app.add_directive("python", Python)
    app.connect("env-before-read-docs", prepare)
    return {"parallel_read_safe": True}
