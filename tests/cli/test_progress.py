"""What a command is doing is shown on a terminal while it runs, and nowhere else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import rich.progress

from truepose.cli import app
from truepose.cli.output import working

QUICK = {"robots", "init", "mask", "check-point", "app"}
"""Commands that never take long before they answer."""
VIRTUAL = {"demo": "truepose.studies.demo.run_demo", "study": "truepose.studies.paper.run_study"}
"""Commands that are too long for a test, and the function in which they spend their time."""


@pytest.fixture
def bars(monkeypatch: pytest.MonkeyPatch) -> list[tuple[bool, list[str]]]:
    """Whether each line of progress is switched off, and its steps in their order."""
    found: list[tuple[bool, list[str]]] = []

    class Spy(rich.progress.Progress):
        def __init__(self, *columns: Any, disable: bool, **options: Any) -> None:
            found.append((disable, []))
            super().__init__(*columns, disable=disable, **options)

        def add_task(self, description: str, *args: Any, **options: Any) -> rich.progress.TaskID:
            found[-1][1].append(description)
            return super().add_task(description, *args, **options)

        def update(self, task_id: rich.progress.TaskID, **options: Any) -> None:
            if "description" in options:
                found[-1][1].append(options["description"])
            super().update(task_id, **options)

    monkeypatch.setattr("rich.progress.Progress", Spy)
    return found


def commands(folder: Path, out: Path) -> dict[str, tuple[tuple[object, ...], str]]:
    """Each command that may take long, and a step of it."""
    cell, samples, error_map = folder / "cell.toml", folder / "fit_samples.csv", folder / "map.truepose"
    held_out, program = folder / "held_out_samples.csv", folder / "program" / "panel.src"
    corrected, readings = folder / "corrected" / "panel.src", folder / "panel_corrected_readings.txt"
    raw, plan = folder / "fit_readings.txt", folder / "fit_plan.csv"
    return {
        "warm-up": ((), "Compiling"),
        "plan": ((cell, "--n", 6, "--method", "sobol", "--out", out / "plan"), "Choosing poses"),
        "import": ((cell, raw, "--plan", plan, "--out", out / "samples.csv"), "Registering"),
        "similarity": ((cell, samples, "--space", "cartesian"), "Looking for similarity"),
        "iso9283": ((cell, "--poses", out / "iso.csv"), "Choosing poses"),
        "fit": ((cell, samples, "--predictor", "idw", "--out", out / "map"), "Fitting idw"),
        "validate": ((error_map, held_out), "Validating, and comparing with another predictor"),
        "explain": ((error_map, "--suggestions", 0), "Predicting in the work region"),
        "predict": ((error_map, held_out, "--out", out / "predicted.csv"), "Predicting 100 poses"),
        "update": ((error_map, held_out), "Testing the map with the new samples"),
        "check": ((program, "--cell", cell), "Reading the programs"),
        "frames": ((program, "--cell", cell), "Reading the programs"),
        "correct": ((error_map, program, "--out", out / "corrected"), "Correcting panel.src"),
        "watch": ((error_map, folder / "program", out / "watched", "--once"), "Correcting"),
        "verify": ((error_map, corrected, readings), "Comparing readings with targets"),
        "report": ((error_map, "--out", out / "report.html"), "Writing the report"),
    }


def test_every_long_command_is_listed(tmp_path: Path) -> None:
    named = {command.name for command in app.registered_commands}
    assert named == {*commands(tmp_path, tmp_path), *QUICK, *VIRTUAL}


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("name", list(commands(Path(), Path())))
@pytest.mark.exhaustive
def test_a_long_command_shows_its_step_on_a_terminal_only(
    run: Any, demo: Any, bars: list[tuple[bool, list[str]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # for rich, a terminal
    arguments, step = commands(demo[0], tmp_path)[name]
    done = run(name, *arguments, "--json")
    assert done.code == 0, done.err
    assert done.err == ""
    assert any(one.startswith(step) for _, steps in bars for one in steps), bars
    assert all(off for off, _ in bars)


@pytest.mark.parametrize("name", VIRTUAL)
def test_virtual_cells_show_their_step(
    run: Any, bars: list[tuple[bool, list[str]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def interrupted(*_: object, progress: Any, **__: object) -> None:
        progress("Robot 0")
        raise KeyboardInterrupt

    monkeypatch.setattr(VIRTUAL[name], interrupted)
    done = run(name, tmp_path, "--json")
    assert (done.code, done.err) == (130, "truepose: interrupted; no file was written\n")
    assert bars == [(True, ["Reading", "Robot 0"])]


@pytest.mark.parametrize(("terminal", "quiet"), [(True, False), (True, True), (False, False)])
def test_the_line_of_progress(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, terminal: bool, quiet: bool
) -> None:
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
    with working("Reading", quiet=quiet) as steps:
        steps("Fitting [1]")
        steps.count(3, 7)
    out, err = capsys.readouterr()
    assert out == ""
    assert ("Fitting [1]" in err and "3 of 7" in err) == (terminal and not quiet)
    assert bool(err) == (terminal and not quiet)
