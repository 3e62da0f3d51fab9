"""Record which tests reach which functions: a pytest plugin, and copies of the sources with marks.

Functions that a fixture of wider scope reaches count for every test that uses it, and those that a process reaches for
the test or fixture that started it.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mutation.reached import FOLDER, begin
from mutation.settings import Settings

TOOLS = Path(__file__).parents[1]
PYTEST = ("-q", "-o", "addopts=--strict-markers --import-mode=importlib", "-p", "no:cacheprovider")
"""Options of pytest: doctests are left out, since they are examples and no checks."""

_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


# --- the plugin -------------------------------------------------------------------------------------------------------

_wide: dict[str, float] = {}
"""Seconds of the set-up of fixtures since the last test."""
_test: dict[str, Any] = {}


def _key(definition: pytest.FixtureDef[object]) -> str:
    return f"{definition.baseid}::{definition.argname}"


def _write(**row: Any) -> None:
    with Path(os.environ[FOLDER], f"{os.getpid()}.tests").open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def _grows(item: pytest.Item) -> bool:
    """Return whether a test does more in the second tier than in the first."""
    module = vars(getattr(item, "module", None) or item)
    own = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
    return bool(own or "examples" in module or "EXHAUSTIVE" in module)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note what a test reaches."""
    begin(item.nodeid)
    _wide.clear()
    _test.clear()
    _test.update(passed=True, seconds=0.0, fixtures=[])
    result = yield
    second = item.get_closest_marker("exhaustive") is not None
    seconds = max(_test["seconds"] - sum(_wide.values()), 0.0)
    _write(test=item.nodeid, second=second, grows=second or _grows(item), **{**_test, "seconds": round(seconds, 4)})
    begin("")
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Note the time and the result of a part of a test, and its fixtures of wider scope, also those asked for late."""
    report: Any = yield
    _test["seconds"] += call.duration
    _test["passed"] = _test["passed"] and report.outcome == "passed"
    if call.when == "call":
        used = item._request._fixture_defs.values()  # type: ignore[attr-defined]
        _test["fixtures"] = sorted({_key(one) for one in used if one.scope != "function"})
    return report


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
    """Note what a fixture of wider scope reaches."""
    if fixturedef.scope == "function":
        return (yield)
    before, start = begin(_key(fixturedef)), time.perf_counter()
    try:
        return (yield)
    finally:
        seconds = time.perf_counter() - start
        _wide[_key(fixturedef)] = seconds
        _write(fixture=_key(fixturedef), seconds=round(seconds, 4))
        begin(before)


# --- copies with marks ------------------------------------------------------------------------------------------------


def marked(source: bytes, file: str) -> str:
    """Return a source in which each function says that it runs."""
    tree = ast.parse(source)
    _mark(tree, file, ())
    first = 1 + max((k for k, one in enumerate(tree.body) if _is_first(one)), default=-1)
    tree.body[first:first] = ast.parse("from mutation.reached import reached as _mutation_reached").body
    return ast.unparse(ast.fix_missing_locations(tree))


def _mark(node: ast.AST, file: str, names: tuple[str, ...]) -> None:
    for child in ast.iter_child_nodes(node):
        inner = (*names, child.name) if isinstance(child, (*_FUNCTIONS, ast.ClassDef)) else names
        _mark(child, file, inner)
        if isinstance(child, _FUNCTIONS):
            at = 1 if ast.get_docstring(child, clean=False) is not None else 0
            child.body[at:at] = ast.parse(f"_mutation_reached({f'{file}:' + '.'.join(inner)!r})").body


def _is_first(statement: ast.stmt) -> bool:
    """Return whether a statement must stay at the beginning of a module."""
    if isinstance(statement, ast.ImportFrom):
        return statement.module == "__future__"
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


# --- the record -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RecordedTest:
    """A test that passes: its tier, its seconds with fixtures, and the functions that it reaches."""

    id: str
    second: bool
    grows: bool
    seconds: float
    functions: frozenset[str]

    @property
    def file(self) -> str:
        """The file of the test."""
        return self.id.partition("::")[0]


def record(settings: Settings, pytest_arguments: list[str], *, second_tier: bool) -> int:
    """Run tests and keep what they reach, in place of what the same files reached before; return pytest's exit code."""
    settings.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mutation-") as made:
        copy, found = settings.prepared(Path(made, "source")), Path(made, "reached")
        found.mkdir()
        for file in settings.files():
            path = copy / settings.package / file
            path.write_text(marked(path.read_bytes(), file), "utf-8")
        environment = {
            **os.environ,
            **(settings.second_tier if second_tier else {}),
            FOLDER: str(found),
            "PYTHONPATH": os.pathsep.join(filter(None, [str(copy), str(TOOLS), os.environ.get("PYTHONPATH")])),
        }
        command = [sys.executable, "-m", "pytest", *PYTEST, "-p", "mutation.recording", *pytest_arguments]
        code = subprocess.call(command, cwd=settings.root, env=environment)
        _keep(settings.folder / "reached.json", _collected(found))
    return code


def _collected(folder: Path) -> dict[str, Any]:
    """Return what the processes of a run noted."""
    functions: dict[str, set[str]] = defaultdict(set)
    for path in folder.glob("*.reached"):
        for line in path.read_text("utf-8").splitlines():
            owner, _, function = line.partition("\t")
            functions[owner].add(function)
    tests, fixtures = {}, {}
    for path in folder.glob("*.tests"):
        for row in map(json.loads, path.read_text("utf-8").splitlines()):
            if "test" in row:
                name = row.pop("test")
                tests[name] = {**row, "functions": sorted(functions[name])}
            else:
                name = row["fixture"]
                fixtures[name] = {"seconds": row["seconds"], "functions": sorted(functions[name])}
    return {"tests": tests, "fixtures": fixtures}


def _keep(path: Path, new: dict[str, Any]) -> None:
    """Write a record, with what older ones knew of other files."""
    files = {name.partition("::")[0] for name in new["tests"]}
    old = json.loads(path.read_text("utf-8")) if path.exists() else {"tests": {}, "fixtures": {}}
    kept = {name: row for name, row in old["tests"].items() if name.partition("::")[0] not in files}
    whole = {"tests": kept | new["tests"], "fixtures": old["fixtures"] | new["fixtures"]}
    path.write_text(json.dumps(whole, indent=0), "utf-8")


def recorded(settings: Settings) -> list[RecordedTest]:
    """Return the tests of the record that pass and whose files are there.

    Examples of the sources are left out: to run them imports the sources without a change.
    """
    path = settings.folder / "reached.json"
    if not path.exists():
        raise SystemExit(f"{path} is missing: run 'python tools/mutate.py record' first")
    found = json.loads(path.read_text("utf-8"))
    tests = []
    for name, row in found["tests"].items():
        file = settings.root / name.partition("::")[0]
        if row["passed"] and file.exists() and not file.is_relative_to(settings.root / settings.source):
            fixtures = [found["fixtures"][key] for key in row["fixtures"] if key in found["fixtures"]]
            seconds = row["seconds"] + sum(one["seconds"] for one in fixtures)
            functions = frozenset(row["functions"]).union(*(one["functions"] for one in fixtures))
            tests.append(RecordedTest(name, row["second"], row["grows"], seconds, functions))
    return tests


def leave_out(settings: Settings, names: list[str]) -> None:
    """Mark tests of the record as failing."""
    path = settings.folder / "reached.json"
    found = json.loads(path.read_text("utf-8"))
    for name in names:
        found["tests"][name]["passed"] = False
    path.write_text(json.dumps(found, indent=0), "utf-8")
