"""The files for administrators name commands and options that exist, and parts of one another that exist."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from tests.needs import needed

from truepose.cli import app

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
IMAGE = (DEPLOY / "Containerfile").read_text("utf-8").replace("\\\n", " ")
DOCS = (ROOT / "docs" / "administration.md").read_text("utf-8")
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


def instructions(name: str) -> list[str]:
    """Return what follows each instruction of a kind in the container file."""
    return re.findall(rf"^{name} +(.+)$", IMAGE, re.MULTILINE)


def test_the_image_copies_what_exists_and_installs_extras_that_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = {name for line in instructions("RUN") for name in re.findall(r"--extra (\w+)", line)}
    assert {"app", "postgres", "scale", "store"} <= extras <= set(project["optional-dependencies"])
    assert (ROOT / "uv.lock").is_file()  # --locked
    stages = set(re.findall(r"^FROM .+ AS (\w+)$", IMAGE, re.MULTILINE))
    for line in instructions("COPY"):
        *sources, _ = line.split()
        if sources[0].startswith("--from="):
            assert sources[0].removeprefix("--from=") in stages
        else:
            assert all((ROOT / source).exists() for source in sources), line
    parse(["warm-up"])
    assert any("truepose warm-up" in line for line in instructions("RUN"))
    assert instructions("ENTRYPOINT") == [f'["{next(iter(project["scripts"]))}"]']


def test_ports_and_volumes_agree(compose: dict[str, Any]) -> None:
    command: Any = typer.main.get_command(app)
    port = next(one.default for one in command.commands["app"].params if one.name == "port")
    assert instructions("EXPOSE") == [str(port)]
    assert f"reverse_proxy app:{port} " in (DEPLOY / "Caddyfile").read_text("utf-8")
    assert f"proxy_pass http://127.0.0.1:{port};" in DOCS
    mounted = {mount.split(":")[1] for mount in compose["services"]["app"]["volumes"]}
    assert set(instructions("VOLUME")) <= mounted
    scheduler = next(word for word in compose["services"]["scheduler"]["command"] if word.startswith("--port="))
    address = f"tls://scheduler:{scheduler.removeprefix('--port=')}"
    assert address == compose["services"]["app"]["environment"]["TRUEPOSE_CLUSTER"]
    assert address in compose["services"]["worker"]["command"]


def test_compiled_loops_can_be_written_where_they_are_looked_for(compose: dict[str, Any]) -> None:
    place = re.search(r"NUMBA_CACHE_DIR=(\S+)", IMAGE)
    assert place
    for name in ("app", "worker"):  # numba does not read a folder that it cannot write, and stops without one
        writable = {mount.split(":")[1] for mount in compose["services"][name]["volumes"] if not mount.endswith(":ro")}
        assert not compose["services"][name].get("read_only") or place[1] in writable
    stated = re.search(r"^NUMBA_CACHE_DIR=/var/cache/(\w+)$", environment_example(), re.MULTILINE)
    assert stated
    for unit in UNITS:
        text = unit.read_text("utf-8")
        if "dask worker" in text or "truepose app" in text:
            assert f"CacheDirectory={stated[1]}\n" in text, unit.name


def environment_example() -> str:
    return (DEPLOY / "systemd" / "environment.example").read_text("utf-8")


def test_variables_are_those_that_the_program_reads(compose: dict[str, Any]) -> None:
    source = "\n".join(path.read_text("utf-8") for path in (ROOT / "src" / "truepose").rglob("*.py"))
    named = {name for service in compose["services"].values() for name in service.get("environment", {})}
    named |= set(re.findall(r"^(\w+)=", environment_example(), re.MULTILINE))
    own = {name for name in named if name.startswith("TRUEPOSE_")} - {"TRUEPOSE_URL"}  # for --url and the Caddyfile
    assert {"TRUEPOSE_STORE", "TRUEPOSE_CLUSTER", "TRUEPOSE_STATE"} <= own
    assert {name for name in own if f'"{name}"' not in source} == set()
    used = set(re.findall(r"\$\{(\w+)", (DEPLOY / "compose.yaml").read_text("utf-8")))
    assert used == set(re.findall(r"^(\w+)=", (DEPLOY / ".env.example").read_text("utf-8"), re.MULTILINE))


def dask_lines(compose: dict[str, Any]) -> list[list[str]]:
    """Return the words after ``dask`` of all files."""
    lines = [
        [service["entrypoint"][1], *service["command"]]
        for service in compose["services"].values()
        if "entrypoint" in service
    ]
    found = [re.search(r"^ExecStart=\S+/dask (.+)$", unit.read_text("utf-8"), re.MULTILINE) for unit in UNITS]
    return lines + [shlex.split(one[1]) for one in found if one]


def test_options_of_dask_exist(compose: dict[str, Any]) -> None:
    needed("distributed", "'truepose[scale]'")
    from distributed.cli import dask_scheduler, dask_worker

    commands: dict[str, Any] = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}
    lines = dask_lines(compose)
    assert len(lines) == 4
    for name, *words in lines:
        known = {text for one in commands[name].params for text in (*one.opts, *one.secondary_opts)}
        assert {word.split("=")[0] for word in words if word.startswith("-")} <= known
        commands[name].make_context("dask", words)


def test_commands_of_the_page_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEPOSE_STORE", "x")  # of the environment of the application
    lines = re.findall(
        r"^[$#] (?:/opt/truepose/bin/truepose|truepose|docker compose run --rm app) (.+)$", DOCS, re.MULTILINE
    )
    assert len(lines) >= 5
    for line in lines:
        parse(shlex.split(line, comments=True))
    assert set(re.findall(r"deploy/[\w./]+\w", DOCS)) <= {str(path.relative_to(ROOT)) for path in DEPLOY.rglob("*")} | {
        "deploy/tls",
        "deploy/systemd",
    }


def test_folders_that_units_write_are_made() -> None:
    for unit in UNITS:
        for folder in re.findall(r"^ReadWritePaths=(\S+)$", unit.read_text("utf-8"), re.MULTILINE):
            assert re.search(rf"install -d .*{folder}", DOCS), (unit.name, folder)  # systemd does not make it


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("unit", [*UNITS, *sorted((DEPLOY / "systemd").glob("*.timer"))], ids=lambda path: path.name)
def test_systemd_accepts_the_units(unit: Path, tmp_path: Path) -> None:
    text = unit.read_text("utf-8")
    for command in re.findall(r"/opt/truepose/bin/\w+", text):  # which is installed elsewhere only
        text = text.replace(command, "/bin/true")
    (tmp_path / unit.name).write_text(text, "utf-8")
    if unit.suffix == ".timer":
        shutil.copy(unit.with_suffix(".service"), tmp_path)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(tmp_path / unit.name)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, [line for line in done.stderr.splitlines() if "truepose" in line]) == (0, [])
