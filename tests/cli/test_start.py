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

NO_PROCESS = """
import sys

def refuse(event, arguments):
    if event in ("subprocess.Popen", "os.posix_spawn", "os.fork", "os.exec"):
        raise RuntimeError(f"{event}: {arguments}")

sys.addaudithook(refuse)
"""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("arguments", [["--help"], ["fit", "--help"], ["robots", "--json"]])
def test_a_start_runs_no_other_program(arguments: list[str]) -> None:
    """The version comes from git, which would take longer than the rest of a start."""
    subprocess.run([sys.executable, "-c", NO_PROCESS + RUN, *arguments], capture_output=True, text=True, check=True)


def test_the_package_is_imported_without_what_runs_programs() -> None:
    code = "import sys; old = set(sys.modules); import truepose; print(*set(sys.modules) - old)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"subprocess", "importlib.metadata", "numpy"} & set(done.stdout.split())


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.sampled(1)
def test_a_command_imports_what_it_uses(demo: tuple[Path, object], tmp_path: Path, name: str) -> None:
    arguments, uses = COMMANDS[name]
    given = [one.format(demo=demo[0], out=tmp_path / "out.csv") for one in arguments]
    done = subprocess.run([sys.executable, "-c", RUN, *given], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.splitlines()[-1].split())
    assert SLOW & loaded == uses
    assert "truepose.cli" in loaded
