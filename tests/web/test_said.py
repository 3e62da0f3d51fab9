"""What the server says in English has its text in German and Chinese: titles of problems and jobs, and steps."""

from __future__ import annotations

import ast
import functools
import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

import truepose
from truepose.cli import app
from truepose.jobs.job import COMMANDS

SOURCE = Path(truepose.__file__).parent
TEXTS = Path(__file__).parents[2] / "frontend" / "src" / "lib" / "i18n"
STEPS, TITLES = {"working", "progress"}, {"WebError": 1, "problem_response": 1}
ELSEWHERE = {"cli", "store", "jobs"}
"""Rooms whose steps no page shows, but for the commands that are jobs."""


def templates(node: ast.expr | None) -> Iterator[str]:
    """Yield the texts that an expression makes, with {} for what is filled in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        parts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
        yield "".join(map(str, parts))
    elif isinstance(node, ast.IfExp):
        yield from templates(node.body)
        yield from templates(node.orelse)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield from (left + right for left in templates(node.left) for right in templates(node.right))


def of_file(path: Path) -> Iterator[str]:
    """Yield the titles that a file gives to problems and jobs, and the steps that it tells."""
    steps = path.relative_to(SOURCE).parts[0] not in ELSEWHERE or path in of_jobs()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in STEPS and node.args and steps:
                yield from templates(node.args[0])
            elif name in TITLES and len(node.args) > TITLES[name]:
                yield from templates(node.args[TITLES[name]])
            elif name == "__init__" and len(node.args) > 1 and isinstance(getattr(node.args[0], "value", None), int):
                yield from templates(node.args[1])  # of a class of WebError: its status and its title
            elif name == "submit":
                yield from templates(next((word.value for word in node.keywords if word.arg == "title"), None))
            elif name == "emit":
                yield from templates(next((word.value for word in node.keywords if word.arg == "step"), None))
        elif isinstance(node, ast.Assign) and path.name in ("job.py", "problem.py"):
            names = [[getattr(one, "id", "") for one in getattr(goal, "elts", [goal])] for goal in node.targets]
            if ["status", "title"] in names and isinstance(node.value, ast.Tuple):
                yield from templates(node.value.elts[1])


@functools.cache
def of_jobs() -> set[Path]:
    """Return the files of the commands that can be jobs, and of what all of them use."""
    group: Any = typer.main.get_command(app)
    files = {inspect.getsourcefile(inspect.unwrap(group.commands[name].callback)) for name in COMMANDS}
    return {Path(file).resolve() for file in files if file} | {SOURCE / "cli" / "events.py"}


@pytest.fixture(scope="module")
def told() -> set[str]:
    """What the server can say."""
    from truepose.problem import _KINDS

    found = {title for _, title in _KINDS.values()} | {"Reading"}  # the step of commands that state none
    for path in SOURCE.rglob("*.py"):
        found.update(of_file(path))
    return {text for text in found if re.search(r"[A-Za-z]", text.replace("{}", ""))}


@pytest.mark.parametrize("language", ["de", "zh"])
def test_all_that_the_server_says_has_its_text(told: set[str], language: str) -> None:
    texts = json.loads((TEXTS / language / "said.json").read_text("utf-8"))
    assert len(told) > 60
    assert sorted(told - set(texts)) == []
    assert sorted(set(texts) - told) == [], "texts that nothing says"
    for english, other in texts.items():
        assert other.strip()
        assert sorted(re.findall(r"\{\d*\}", other)) == [f"{{{k}}}" for k in range(english.count("{}"))], english
