"""Every package that the sources import is a mandatory dependency, or its absence is one clear error."""

from __future__ import annotations

import ast
import importlib
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from truepose._extras import needed

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "truepose"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
MANDATORY = {re.split(r"[>=\[]", need)[0] for need in PROJECT["dependencies"]}
WITH_THEM = {"pydantic_core"}
"""Modules that come with a mandatory package."""
ROOMS = {"web": "app", "store": "store", "report/plots": "report"}
"""Rooms whose importers make the packages of an extra sure (`truepose._extras.needed`)."""


def unguarded(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of imported packages, but for types, in `needed`, and where there is another way."""
    if isinstance(node, ast.Import):
        yield from ((node.lineno, name.name.partition(".")[0]) for name in node.names)
    elif isinstance(node, ast.ImportFrom):
        yield node.lineno, (node.module or "").partition(".")[0]
    elif not is_guard(node):
        for child in ast.iter_child_nodes(node):
            yield from unguarded(child)


def is_guard(node: ast.AST) -> bool:
    match node:
        case ast.With():
            return any(called(item.context_expr) == "needed" for item in node.items)
        case ast.If():
            return getattr(node.test, "id", "") == "TYPE_CHECKING"
        case ast.Try():
            return any(getattr(handler.type, "id", "") == "ModuleNotFoundError" for handler in node.handlers)
        case ast.FunctionDef():
            return node.name == "__sklearn_tags__"  # scikit-learn itself asks
    return False


def called(node: ast.expr) -> str:
    return getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""


def foreign(path: Path) -> list[tuple[int, str]]:
    """Return the imports of a file that are neither Python's, nor the package's own, nor mandatory."""
    known = {*sys.stdlib_module_names, *MANDATORY, *WITH_THEM, "truepose"}
    return [(line, name) for line, name in unguarded(ast.parse(path.read_text("utf-8"))) if name not in known]


def test_the_room_of_the_pictures_is_found_to_need_something() -> None:
    assert foreign(SOURCE / "report" / "plots" / "figures.py")


@pytest.mark.sampled(67)
@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: path.relative_to(SOURCE).as_posix())
def test_optional_packages_are_imported_where_their_absence_is_told(path: Path) -> None:
    if any(path.is_relative_to(SOURCE / room) for room in ROOMS):
        return
    assert foreign(path) == []


def test_a_missing_module_of_the_package_itself_is_no_missing_extra() -> None:
    with pytest.raises(ModuleNotFoundError, match="truepose"), needed("it", "report"):
        importlib.import_module("truepose.nowhere")
