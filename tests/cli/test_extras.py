"""A base installation does its work, and what needs an extra says so in one line: no traceback, no work for nothing."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
MODULES = {
    "argon2-cffi": "argon2",
    "fonttools": "fontTools",
    "psycopg[binary]": "psycopg",
    "scikit-learn": "sklearn",
}
"""The modules of packages with another name."""
OPTIONAL = {
    name: extra
    for extra, needs in EXTRAS.items()
    for name in (need.partition(">=")[0] for need in needs)
    if not name.startswith("truepose")
}
"""All optional packages, each with its extra."""

BLOCK = """
import contextlib, importlib.abc, io, json, os, sys, warnings

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
import numpy as np
import truepose as tp
from truepose.errors import TrueposeError
from truepose.problem import problem

def run(*words):
    from truepose.cli import main

    sys.argv = ["truepose", *words]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            return end.code or 0, err.getvalue()
    return 0, err.getvalue()

def call(text):
    try:
        exec(text, {"tp": tp, "np": np, "demo": f"{OUT}/demo", "out": OUT})
    except TrueposeError as error:
        return problem(error)["type"], problem(error)["detail"]  # as jobs and the application show it
    return "", ""
"""

COMMANDS: dict[str, tuple[str, str | None]] = {
    "demo": ("demo {demo}", None),  # whose files the others read
    "plot": ("similarity {demo}/cell.toml {demo}/fit_samples.csv --plot {out}/a.svg", "report"),
    "pictures": ("explain {demo}/map.truepose --out {out}/pictures", "report"),
    "page": ("correct {demo}/map.truepose {demo}/program --dry-run --report {out}/a.html", "report"),
    "report": ("report {demo}/map.truepose --out {out}/a.html", "report"),
    "study": ("study {out}/study", "report"),
    "app": ("app {out}", "app"),
    "network": (
        "fit {demo}/cell.toml {demo}/fit_samples.csv --predictor calibration-network --out {out}/b.truepose",
        "network",
    ),
    "store": ("store init --store {out}/store", "store"),
    "restore": ("store restore {demo}/cell.toml --store {out}/store", "store"),
    "recorded": ("fit {demo}/cell.toml {demo}/fit_samples.csv --out {out}/c.truepose --store {out}/store", "store"),
    "parquet": ("predict {demo}/map.truepose {demo}/none.parquet --out {out}/a.parquet", "scale"),
    "cluster": (
        "predict {demo}/map.truepose {demo}/fit_plan.csv --out {out}/b.csv --cluster tcp://127.0.0.1:9",
        "scale",
    ),
    "similarity": ("similarity {demo}/cell.toml {demo}/fit_samples.csv", None),
    "explain": ("explain {demo}/map.truepose", None),
    "check": ("correct {demo}/map.truepose {demo}/program --dry-run --report {out}/a.csv", None),
    "workbook": ("predict {demo}/map.truepose {demo}/held_out_samples.csv --out {out}/a.xlsx", None),
}
"""Commands in the order in which they run, and the extra that each needs."""

CALLS: dict[str, tuple[str, str | None]] = {
    "plot": ("tp.plot", "report"),
    "report": ("tp.write_report", "report"),
    "frame": ("tp.read_samples(f'{demo}/fit_samples.csv').to_frame()", "pandas"),
    "named": ("tp.OrdinaryKriging().fit(memoryview(np.eye(3)), np.eye(3))", "network"),
    "lists": ("tp.Nearest().fit([[0, 0, 0], [1, 1, 1]], [[0, 0, 1], [0, 1, 0]]).predict([[0, 0, 0]])", None),
    "score": ("assert tp.Nearest().fit(np.eye(3), np.eye(3)).score(np.eye(3), np.eye(3)) == 1", None),
}
"""Statements of Python, and the extra that each needs."""


def python(code: str, *, blocked: set[str], out: Path) -> Any:
    """Run code in a process without some packages; return what it prints as JSON."""
    head = f"BLOCKED, OUT = {blocked!r}, {str(out)!r}\n"
    done = subprocess.run(
        [sys.executable, "-c", head + BLOCK + code], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def module(package: str) -> str:
    return MODULES.get(package, package.replace("-", "_"))


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What commands and statements do in one process without any optional package."""
    out = tmp_path_factory.mktemp("base")
    lines = {name: line.format(demo=out / "demo", out=out).split() for name, (line, _) in COMMANDS.items()}
    code = f"""
commands = {{name: run(*words) for name, words in {lines!r}.items()}}
calls = {{name: call(text) for name, (text, _) in {CALLS!r}.items()}}
print(json.dumps({{"commands": commands, "calls": calls}}))
"""
    return {**python(code, blocked=set(map(module, OPTIONAL)), out=out), "out": out}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_works_or_names_the_extra(base: dict[str, Any], name: str) -> None:
    code, errors = base["commands"][name]
    extra = COMMANDS[name][1]
    if extra is None:
        assert code == 0, errors
        return
    assert code == 1, errors
    last = errors.splitlines()[-1]
    assert f"install it with: pip install 'truepose[{extra}]'" in last
    assert "Traceback" not in errors


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CALLS)
def test_a_call_works_or_names_the_extra(base: dict[str, Any], name: str) -> None:
    kind, message = base["calls"][name]
    extra = CALLS[name][1]
    assert kind == ("" if extra is None else "MissingPackageError"), message
    assert extra is None or f"install it with: pip install 'truepose[{extra}]'" in message


@pytest.mark.exhaustive
def test_the_demonstration_leaves_out_its_report_only(base: dict[str, Any]) -> None:
    folder = base["out"] / "demo"
    assert (folder / "corrected" / "panel.src").is_file()
    assert not (folder / "report.html").exists()
    (line,) = [line for line in base["commands"]["demo"][1].splitlines() if "report" in line]
    assert line.startswith("truepose: warning: the demonstration goes on without a report: ")
    assert line.endswith("install it with: pip install 'truepose[report]'")


def test_what_cannot_be_written_costs_no_work(base: dict[str, Any]) -> None:
    # found before the work begins, not after it
    for name in ("a.svg", "a.html", "pictures", "study", "b.truepose", "c.truepose"):
        assert not (base["out"] / name).exists(), name


STORE = "from truepose.store.store import Store; "
APPLICATION = "from truepose.cli.browser import app; app(out)"
PROVIDER = (
    "from truepose.web.team.oidc import Provider, Settings; Provider(Settings('https://a', 'b', 'c'), 'https://d')"
)
REPORT = "tp.write_report(tp.load_map(f'{demo}/map.truepose'), f'{out}/a.html')"
USES = {
    "alembic": "from truepose.cli.store import opened\nwith opened(f'{out}/store', create=True): pass",
    "argon2-cffi": "from truepose.store.passwords import hashed; hashed('correct horse')",
    "authlib": PROVIDER,
    "distributed": "from truepose.jobs.executor.cluster import Cluster; Cluster('tcp://127.0.0.1:9')",
    "fast-simplification": "from truepose.web.meshes.reduction import reduced; reduced(np.eye(3), np.eye(3), 4)",
    "fastapi": APPLICATION,
    "fonttools": "from truepose.report import fonts; fonts.characters()",
    "httpx": PROVIDER,
    "jinja2": REPORT,
    "joserfc": PROVIDER,
    "matplotlib": REPORT,
    "pandas": CALLS["frame"][0],
    "psycopg[binary]": STORE + "Store.open('postgresql://nobody@127.0.0.1:9/none')",
    "pyarrow": "from truepose.samples.parquet import ParquetTable; ParquetTable(f'{out}/a.parquet')",
    "python-multipart": APPLICATION,
    "scikit-learn": CALLS["named"][0],
    "sqlalchemy": "from truepose.cli.store import opened\nwith opened(f'{out}/store', create=True): pass",
    "tomlkit": APPLICATION,
    "typst": REPORT.replace("a.html", "a.pdf"),
    "uvicorn": APPLICATION,
}
"""A use of each optional package in Python."""


def test_each_optional_package_has_a_use() -> None:
    assert USES.keys() == OPTIONAL.keys()


@pytest.mark.parametrize("package", sorted(USES))
@pytest.mark.sampled(1)
def test_one_missing_package_names_its_extra(base: dict[str, Any], package: str) -> None:
    kind, message = python(f"print(json.dumps(call({USES[package]!r})))", blocked={module(package)}, out=base["out"])
    assert kind == "MissingPackageError", message
    assert f"needs the package {module(package)}; install it with: pip install 'truepose[" in message
    assert OPTIONAL[package] in message
