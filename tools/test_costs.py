"""Measure what the tests cost: processor seconds by room, by kind of test, and by fixture.

``python tools/test_costs.py run FILE [PYTEST ARGUMENTS]`` runs the tests and writes one JSON line for each test and
each fixture to FILE; ``python tools/test_costs.py show FILE`` prints the tables of docs/validation/tests.md. Times are
those of the test's process and of its ended children, so they hardly depend on what else the machine does; a browser
or a server that lives longer than a test is counted in the wall time only.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

VARIABLE = "TRUEPOSE_TEST_COSTS"
KINDS = ("unit", "property", "process", "server", "browser")
SHOWN = 25


def _spent() -> tuple[float, float, float]:
    """Return the processor seconds of this process, those of its ended children, and the wall clock."""
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime, time.perf_counter()


def _since(start: tuple[float, float, float]) -> dict[str, float]:
    own, children, wall = (now - then for now, then in zip(_spent(), start, strict=True))
    return {"own": round(own, 4), "children": round(children, 4), "wall": round(wall, 4)}


def _write(**row: Any) -> None:
    """Append a row to the file of this worker."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    with Path(f"{os.environ[VARIABLE]}.{worker}").open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def _kind(item: pytest.Item, children: float) -> str:
    names = set(getattr(item, "fixturenames", ()))
    if "tests/browser" in item.nodeid:
        return "browser"
    if getattr(getattr(item, "obj", None), "is_hypothesis_test", False):
        return "property"
    if names & {"client", "server", "team", "served"} or "tests/web" in item.nodeid:
        return "server"
    return "process" if children > 0.05 else "unit"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Measure a test with its set-up and its end."""
    start = _spent()
    result = yield
    spent = _since(start)
    _write(what="test", id=item.nodeid, kind=_kind(item, spent["children"]), **spent)
    return result


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
    """Measure a fixture."""
    start = _spent()
    result = yield
    _write(what="fixture", id=fixturedef.argname, scope=fixturedef.scope, **_since(start))
    return result


def read(path: Path) -> list[dict[str, Any]]:
    """Return the rows that all workers wrote, the processor seconds of each in ``cpu``."""
    files = sorted(path.parent.glob(f"{path.name}.*"))
    rows = [json.loads(line) for file in files for line in file.read_text("utf-8").splitlines()]
    return [{**row, "cpu": row["own"] + row["children"]} for row in rows]


def room(nodeid: str) -> str:
    """Return the room of a test: the folder below ``tests``, or ``doctests`` for those of the sources."""
    parts = nodeid.split("::")[0].split("/")
    if parts[0] != "tests":
        return "doctests"
    return parts[1] if len(parts) > 2 else "(loose modules)"


def show(rows: list[dict[str, Any]]) -> None:
    """Print the tables."""
    tests = [row for row in rows if row["what"] == "test"]
    fixtures = [row for row in rows if row["what"] == "fixture"]
    total = sum(row["cpu"] for row in tests)
    waited = sum(row["wall"] for row in tests)
    print(f"{len(tests)} tests, {total:.0f} processor seconds, {waited:.0f} seconds of work and waiting")
    _table("room", tests, lambda row: room(row["id"]))
    _table("kind", tests, lambda row: row["kind"])
    _table("module", tests, lambda row: row["id"].split("::")[0])
    _table("fixture", fixtures, lambda row: f"{row['id']} ({row['scope']})")
    _table("test", tests, lambda row: row["id"])


def _table(title: str, rows: list[dict[str, Any]], key: Any) -> None:
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[key(row)].append(row)
    ordered = sorted(groups.items(), key=lambda pair: -sum(row["cpu"] for row in pair[1]))
    print(f"\n| {title} | number | CPU s | wall s |\n|---|---:|---:|---:|")
    shown = ordered[:SHOWN]
    if len(ordered) > SHOWN:
        shown += [(f"{len(ordered) - SHOWN} others", [row for _, found in ordered[SHOWN:] for row in found])]
    for name, found in shown:
        print(f"| {name} | {len(found)} | {_sum(found, 'cpu')} | {_sum(found, 'wall')} |")


def _sum(rows: list[dict[str, Any]], key: str) -> str:
    return f"{sum(row[key] for row in rows):.1f}"


def main() -> int:
    """Run a command of this script; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["run", "show"])
    parser.add_argument("file", type=Path)
    arguments, rest = parser.parse_known_args()
    if arguments.command == "show":
        show(read(arguments.file))
        return 0
    for old in arguments.file.parent.glob(f"{arguments.file.name}.*"):
        old.unlink()
    arguments.file.parent.mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    environment = {**os.environ, VARIABLE: str(arguments.file.resolve()), "PYTHONPATH": paths}
    return subprocess.call([sys.executable, "-m", "pytest", "-p", "test_costs", *rest], env=environment)


if __name__ == "__main__":
    sys.exit(main())
