"""The pages on teams: every command of them does what the page says, in the order of the page."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("page", ["team.md", "tutorials/two-engineers.md"])
def test_the_commands_of_a_page_run_in_its_order(page: str, virtual_cell: Path, tmp_path: Path) -> None:
    shutil.copytree(virtual_cell, tmp_path / "practice")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    state = {"PATH": path, "TRUEPOSE_STATE": str(tmp_path / "state"), "NO_COLOR": "1"}
    blocks = re.findall(r"```\{run\}\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line and not line.startswith((":", "#"))]
    assert len(lines) > 5
    for line in lines:
        done = subprocess.run(
            line.lstrip("! "), shell=True, cwd=tmp_path, env={**os.environ, **state}, text=True, capture_output=True
        )
        assert (done.returncode != 0) == line.startswith("!"), f"{line}\n{done.stdout}{done.stderr}"
        assert "Traceback" not in done.stderr
