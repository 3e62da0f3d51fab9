"""The files for administrators name commands and options that exist, and parts of one another that exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from truepose.cli import app

DEPLOY = Path(__file__).parents[1] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((DEPLOY / "compose.yaml").read_text("utf-8"))
    return found


def parse(words: list[str]) -> None:
    """Parse a command line of truepose without running it."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands"):
        command = command.commands[words[0]]
        words = words[1:]
    command.make_context("truepose", words)


def test_the_application_of_the_containers_starts_with_options_that_exist(compose: dict[str, Any]) -> None:
    given = compose["services"]["app"]["command"]
    words = [re.sub(r"\$\{(\w+):\?[^}]*\}", r"https://\1.example", word) for word in given]
    parse(words)


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.stem)
def test_units_start_commands_that_exist(unit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEPOSE_STORE", "x")  # as the file of the environment does
    found = re.search(r"^ExecStart=(.+)$", unit.read_text("utf-8"), re.MULTILINE)
    assert found
    line = found[1]
    if inner := re.search(r"-c '(.+)'", line):
        line = inner[1]
    command, _, rest = line.partition(" ") if not line.startswith("exec ") else line[5:].partition(" ")
    assert command.startswith("/opt/truepose/bin/")
    if command.endswith("/truepose"):
        parse([re.sub(r"\$\{?\w+\}?", "x", word) for word in shlex.split(rest)])


def test_units_read_variables_that_the_example_states() -> None:
    stated = set(re.findall(r"^(\w+)=", (DEPLOY / "systemd" / "environment.example").read_text("utf-8"), re.MULTILINE))
    used = {name for unit in UNITS for name in re.findall(r"\$\{?(TRUEPOSE_\w+)", unit.read_text("utf-8"))}
    assert used
    assert used <= stated


def test_mounted_files_and_networks_exist(compose: dict[str, Any]) -> None:
    made_by_the_administrator = {"./tls"}
    for name, service in compose["services"].items():
        for mount in service.get("volumes", []):
            source = mount.split(":")[0]
            known = (DEPLOY / source).exists() if source.startswith("./") else source in compose["volumes"]
            assert known or source in made_by_the_administrator, (name, mount)
        assert set(service["networks"]) <= set(compose["networks"]), name


def test_only_the_proxy_is_reached_from_outside(compose: dict[str, Any]) -> None:
    assert [name for name, one in compose["services"].items() if "ports" in one] == ["proxy"]
    assert compose["networks"]["inside"]["internal"]
    assert {name for name, one in compose["services"].items() if "front" in one["networks"]} == {"app", "proxy"}


def test_dask_uses_certificates_for_everything() -> None:
    settings = yaml.safe_load((DEPLOY / "tls.yaml").read_text("utf-8"))["distributed"]
    assert settings["comm"]["require-encryption"] is True
    assert {"ca-file", "scheduler", "worker", "client"} == set(settings["comm"]["tls"])
    assert settings["scheduler"]["worker-saturation"] == 1.0
