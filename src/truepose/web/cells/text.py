"""The text of a cell file as the pages change it: key by key, with comments and order kept."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, MutableMapping, Sequence
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any, Final

import tomlkit
from pydantic import BaseModel, Field, JsonValue
from tomlkit.exceptions import TOMLKitError

from truepose._io.strict import parse_toml
from truepose.cell import Cell
from truepose.errors import DataError, FileError, TrueposeError

SOURCE: Final = "cell.toml"
_DEEPEST: Final = 4
_BOM: Final = b"\xef\xbb\xbf"


class Change(BaseModel):
    """A value of one key, or of a table; null removes it.

    The path names the tables and the key, such as ``["obstacles", "table", "x_mm"]``.
    """

    path: list[str] = Field(min_length=1, max_length=_DEEPEST)
    value: JsonValue = None


def etag_of(content: bytes) -> str:
    """Return the version of a file; by its content, since clocks may be set back."""
    return f'"{hashlib.sha256(content).hexdigest()[:32]}"'


def as_file(text: str, before: bytes) -> bytes:
    """Return the content of a file with a text from a page, in the line ends and the mark of the old content."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n")
    if b"\r\n" in before:
        lines = lines.replace("\n", "\r\n")
    return (_BOM if before.startswith(_BOM) else b"") + lines.encode("utf-8")


def values_of(text: str) -> dict[str, Any] | None:
    """Return the values of a cell file as JSON; None if it is not TOML. Numbers that are not finite become null."""
    try:
        values: dict[str, Any] = _plain(parse_toml(text, SOURCE))
    except FileError:
        return None
    return values


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value if isinstance(value, bool | int | float | str) else str(value)


def changed(text: str, changes: Sequence[Change]) -> str:
    """Return the text of a cell file with some keys changed.

    Raises
    ------
    FileError
        If the text is not TOML.
    DataError
        If a value has no form in TOML, or a path leads through a key that is no table.
    """
    parse_toml(text, SOURCE)
    try:
        document = tomlkit.parse(text)
        for change in changes:
            _apply(document, change)
        text = tomlkit.dumps(document)
        text.encode("utf-8")  # half of a pair of surrogates is no text
        return text
    except TrueposeError:
        raise
    except (TOMLKitError, TypeError, ValueError, AttributeError, KeyError) as error:
        raise DataError(f"this change cannot be written: {error}; change the text itself") from None


def _apply(document: MutableMapping[str, Any], change: Change) -> None:
    *tables, key = change.path
    at: Any = document
    for depth, name in enumerate(tables):
        if name not in at:
            if change.value is None:
                return
            at[name] = tomlkit.table(is_super_table=depth + 1 < len(tables))
        at = at[name]
        if not isinstance(at, MutableMapping):
            raise DataError(f"{'.'.join(tables[: depth + 1])} is no table; change the text itself")
    if change.value is None:
        at.pop(key, None)
        return
    at[key] = _item(_typed(change.value, _schema_at(change.path)))


def _item(value: Any) -> Any:
    """Return a value with its own tables, so that a box becomes a table and not one long line."""
    if not isinstance(value, dict):
        return value
    table = tomlkit.table()
    for key, one in value.items():
        table[key] = _item(one)
    return table


def _typed(value: Any, schema: Mapping[str, Any]) -> Any:
    """Return a value of JSON in the type of its key: 5 becomes 5.0 in a key of numbers, a text of a day a date."""
    forms = [schema, *schema.get("anyOf", [])]
    if isinstance(value, dict):
        return {key: _typed(one, _child(schema, key)) for key, one in value.items() if one is not None}
    if isinstance(value, list):
        items = next((one for form in forms for one in _items(form)), {})
        return [_typed(one, items) for one in value]
    types = {form.get("type") for form in forms}
    if isinstance(value, int) and not isinstance(value, bool) and "number" in types:
        return float(value)
    if isinstance(value, str) and any(form.get("format") == "date" for form in forms):
        try:
            return date.fromisoformat(value)
        except ValueError:
            return value
    return value


def _items(form: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [form["items"]] if "items" in form else list(form.get("prefixItems", []))[:1]


@cache
def cell_schema() -> dict[str, Any]:
    """Return the JSON schema of cell files."""
    return Cell.model_json_schema()


def _schema_at(path: Sequence[str]) -> Mapping[str, Any]:
    schema: Mapping[str, Any] = cell_schema()
    for name in path:
        schema = _child(schema, name)
    return schema


def _child(schema: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the schema of a key; empty if there is none."""
    for form in (schema, *schema.get("anyOf", [])):
        form = _resolved(form)
        if name in form.get("properties", {}):
            return _resolved(form["properties"][name])
        if isinstance(more := form.get("additionalProperties"), dict):
            return _resolved(more)
    return {}


def _resolved(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    reference = schema.get("$ref")
    return schema if reference is None else cell_schema()["$defs"][reference.rpartition("/")[2]]


class KeyProblem(BaseModel):
    """An error of a cell file, in the words of the command line."""

    table: str = Field(description="the table, such as tool or obstacles.box; empty for the whole text")
    key: str
    path: list[str]
    line: int | None
    message: str = Field(description="cause and remedy")


def problems_in(text: str, folder: Path) -> list[KeyProblem]:
    """Return the errors of the text of a cell file; nothing is written."""
    found = []
    for problem in Cell.problems(text, folder=folder):
        path = [str(part) for part in problem.loc]
        at = {"table": ".".join(path[:-1]) or "".join(path[-1:]), "key": path[-1] if len(path) > 1 else ""}
        found.append(KeyProblem(**at, path=path, line=problem.line, message=problem.words))
    return found
