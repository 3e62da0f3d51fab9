"""No command writes over its inputs, over devices and links, or over existing results unless it is told to."""

import os
from pathlib import Path

import pytest
import typer

from truepose.cli import app

WRITES = {"out", "plot", "poses", "save_columns", "directory"}


@pytest.mark.promise("Every command that writes has --force.")
def test_every_command_that_writes_has_force(record_property):
    commands = typer.main.get_command(app).commands
    writing = {name: {p.name for p in command.params} for name, command in commands.items()}
    writing = {name: names for name, names in writing.items() if names & WRITES}
    assert {name for name, names in writing.items() if "force" not in names} == set()
    assert len(writing) >= 12
    record_property("cases", len(writing))


def commands(files, folder: Path) -> list[tuple[object, ...]]:
    """Return the commands that write a file, with the option that names it last."""
    return [
        ("fit", files.cell, files.samples, "--predictor", "registration", "--out"),
        ("predict", files.map, files.test, "--out"),
        ("update", files.map, files.test, "--out"),
        ("report", files.map, "--out"),
        ("import", files.cell, files.test, "--plan", files.test, "--out"),
        ("import", files.cell, files.test, "--plan", files.test, "--columns", "x=1,y=2,z=3", "--save-columns"),
        ("similarity", files.cell, files.samples, "--plot"),
        ("iso9283", files.cell, "--poses"),
    ]


@pytest.mark.promise(
    "An existing result stays and --force is named; links, devices and pipes are refused also with it."
)
@pytest.mark.parametrize("k", range(8))
def test_existing_files_stay(run, cell_files, tmp_path, k):
    command = commands(cell_files, tmp_path)[k]
    result, link, pipe = (tmp_path / f"{name}.html" for name in ("result", "link", "pipe"))
    os.mkfifo(pipe)
    result.write_bytes(b"mine")
    link.symlink_to(result)
    assert (
        f"{result}: exists already; choose another output path, or overwrite it with --force"
        in run(*command, result).failed()
    )
    assert f"{link}: is a link" in run(*command, link, "--force").failed()
    assert f"{pipe}: is a device or a pipe, not a file" in run(*command, pipe, "--force").failed()
    assert result.read_bytes() == b"mine"
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.exhaustive
@pytest.mark.promise("--force overwrites a result, but never a map, a cell file, samples, readings, plan or poses.")
def test_force(run, cell_files, tmp_path):
    out, linked = tmp_path / "out.csv", tmp_path / "linked.csv"
    poses = tmp_path / "poses.csv"
    poses.write_bytes(cell_files.test.read_bytes())
    os.link(poses, linked)
    before = poses.read_bytes()
    out.write_bytes(b"earlier")
    assert run("predict", cell_files.map, poses, "--out", out, "--force").code == 0
    assert out.read_bytes() != b"earlier"
    whole = cell_files.map.read_bytes()
    for command in (
        ("predict", cell_files.map, poses, "--out", poses),
        ("predict", cell_files.map, poses, "--out", linked),
        ("predict", cell_files.map, poses, "--out", cell_files.map),
        ("update", cell_files.map, poses, "--anyway", "--out", cell_files.map),
        ("fit", cell_files.cell, poses, "--predictor", "registration", "--out", cell_files.cell),
        ("fit", cell_files.cell, poses, "--predictor", "registration", "--out", linked),
    ):
        assert "is an input, and inputs are never overwritten" in run(*command, "--force").failed()
    assert poses.read_bytes() == before
    assert cell_files.map.read_bytes() == whole


@pytest.mark.promise("Commands that write a folder of files overwrite none of them without --force.")
def test_folders_of_results(run, cell_files, tmp_path):
    for name, command in (
        ("plan.csv", ("plan", cell_files.cell, "--n", "3", "--method", "sobol", "--out", tmp_path)),
        ("cell.toml", ("demo", tmp_path)),
        ("cell.toml", ("init", tmp_path, "--robot", "kuka-kr150-2")),
        ("sure.svg", ("explain", cell_files.map, "--out", tmp_path)),
        ("table.md", ("study", tmp_path)),
    ):
        (tmp_path / name).write_bytes(b"mine")
        assert f"{name}: exists already" in run(*command).failed()
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {name: b"mine"}
        (tmp_path / name).unlink()
