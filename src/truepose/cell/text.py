"""The text of a cell file: writing it, and explaining its errors with line and remedy."""

from __future__ import annotations

import difflib
import json
import re
from dataclasses import dataclass
from datetime import date
from types import UnionType
from typing import Any, TypeGuard, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from truepose.cell.poses import CellError


def tables(header: tuple[str, ...], table: dict[Any, Any]) -> list[str]:
    """Return the lines of a table and its subtables."""
    values = {key: value for key, value in table.items() if not isinstance(value, dict)}
    names = [name if re.fullmatch(r"[\w-]+", name, re.A) else json.dumps(name, ensure_ascii=False) for name in header]
    lines = [f"\n[{'.'.join(names)}]"] if values else []
    lines += [f"{key} = {_value(value)}" for key, value in values.items()]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += tables((*header, str(key)), value)
    return lines


def _value(value: Any) -> str:
    # a JSON string is a TOML string if non-ASCII letters are not escaped
    return value.isoformat() if isinstance(value, date) else json.dumps(value, ensure_ascii=False)


@dataclass(frozen=True)
class CellProblem:
    """An error of a cell file.

    Attributes
    ----------
    loc : tuple of str or int
        The tables and the key, such as ``("tool", "x_mm")``; empty for a text that is not TOML.
    words : str
        The cause and the remedy.
    line : int, optional
        The line of the key, or of its table if the key is missing; from 1.
    """

    loc: tuple[str | int, ...]
    words: str
    line: int | None

    def __str__(self) -> str:
        return f"{_name(self.loc)}: {self.words}" if self.loc else self.words


def problems_of(error: ValidationError, cell: type[BaseModel], text: str) -> list[CellProblem]:
    """Return the errors of a cell file, at most one for each key."""
    errors = error.errors()  # a misspelt key first, because a missing one may be the same
    errors.sort(key=lambda one: one["type"] != "extra_forbidden")
    found: dict[tuple[str | int, ...], CellProblem] = {}
    for one in errors:
        loc, words = _explain(one, cell)
        found.setdefault(loc, CellProblem(loc, words, line_of(text, loc)))
    return list(found.values())


def _explain(found: ErrorDetails, cell: type[BaseModel]) -> tuple[tuple[str | int, ...], str]:
    """Return the location of an error, and its cause and remedy."""
    cause = found.get("ctx", {}).get("error")
    loc = (*found["loc"], *cause.loc) if isinstance(cause, CellError) else found["loc"]
    loc = loc[:-1] if loc[-1:] == ("[key]",) else loc
    if isinstance(cause, Exception):
        return loc, str(cause)
    if found["type"] == "extra_forbidden":
        return loc, "unknown key; " + _nearest(loc, cell)
    if found["type"] == "missing":
        return loc, "is missing; `truepose init` writes a complete file"
    return loc, f"{found['msg'].removeprefix('Input ')}, not {found['input']!r}"


def _name(loc: tuple[str | int, ...]) -> str:
    *tables, key = loc
    return f"[{'.'.join(map(str, tables))}] {key}" if tables else f"[{key}]"


def _nearest(loc: tuple[str | int, ...], cell: type[BaseModel]) -> str:
    section: Any = cell
    for key in loc[:-1]:
        section = section.model_fields[str(key)].annotation if _is_section(section) else get_args(section)[1]
        section = next(filter(_is_section, get_args(section)), section) if isinstance(section, UnionType) else section
    known = list(section.model_fields) if _is_section(section) else []
    near = difflib.get_close_matches(str(loc[-1]), known, n=1, cutoff=0.5)
    in_metres = " Lengths are in mm." if str(loc[-1]).endswith("_m") else ""
    return f"did you mean {near[0]}?{in_metres}" if near else f"expected one of {', '.join(known)}"


def _is_section(annotation: object) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def line_of(text: str, loc: tuple[str | int, ...]) -> int | None:
    """Return the line of a key, or of its table if the key is missing."""
    *tables, key = (str(part).replace(" ", "") for part in loc)
    found, header = None, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if match := re.match(r"\s*\[\s*([^\]]+?)\s*\]", line):
            header = match[1].replace('"', "").replace(" ", "")
            if found is None and header in (".".join(tables), ".".join((*tables, key))):
                found = number
        elif (match := re.match(r"""\s*["']?([\w.-]+?)["']?\s*=""", line)) and f"{header}.{match[1]}".strip(
            "."
        ) == ".".join((*tables, key)):
            return number
    return found
