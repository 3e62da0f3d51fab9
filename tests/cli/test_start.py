"""What makes a start slow is imported by the commands that use it, and by no other; in fresh processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SLOW = {"numba", "sklearn", "pandas", "matplotlib", "jinja2", "openpyxl", "scipy.stats", "joblib"}
COMMANDS = {
    "robots": (["robots", "--json"], set()),
    "init": (["init", "{out}", "--robot", "kuka-kr150-2"], set()),
    "check": (["check", "{demo}/program", "--cell", "{demo}/cell.toml"], set()),
    "import": (
        ["import", "{demo}/cell.toml", "{demo}/fit_readings.txt", "--plan", "{demo}/fit_plan.csv", "--out", "{out}"],
        set(),
    ),
    "validate": (["validate", "{demo}/map.truepose", "{demo}/held_out_samples.csv"], {"numba"}),
    "predict": (["predict", "{demo}/map.truepose", "{demo}/held_out_samples.csv", "--out", "{out}"], {"numba"}),
}
"""Arguments, and what the command may import of the slow modules."""

RUN = """
import sys
from truepose.cli import main
try:
    main()
except SystemExit as end:
    if end.code:
        raise
print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.sampled(3)
def test_a_command_imports_what_it_uses(demo: tuple[Path, object], tmp_path: Path, name: str) -> None:
    arguments, uses = COMMANDS[name]
    given = [one.format(demo=demo[0], out=tmp_path / "out.csv") for one in arguments]
    done = subprocess.run([sys.executable, "-c", RUN, *given], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.splitlines()[-1].split())
    assert SLOW & loaded == uses
    assert "truepose.cli" in loaded
