"""Hashes of rows and entries: the SHA-256 of their canonical JSON, which is put together fast enough for millions."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final

import sqlalchemy as sa

_quoted = json.encoder.encode_basestring_ascii
_as_it_is = json.encoder.encode_basestring
_WORDS: Final = {None: "null", True: "true", False: "false"}


def canonical(value: Any) -> str:
    """Return a value as JSON text: one text for one value.

    Examples
    --------
    >>> canonical({"b": 1, "a": None})
    '{"a":null,"b":1}'
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def canonical_list(values: Sequence[Any]) -> str:
    """Return what `canonical` returns of a list, faster for texts.

    Examples
    --------
    >>> canonical_list(["a", 1, None, True])
    '["a",1,null,true]'
    """
    texts = [_quoted(one) if type(one) is str else str(one) if type(one) is int else _other(one) for one in values]
    return f"[{','.join(texts)}]"


@lru_cache(maxsize=64)
def row_hasher(table: sa.Table) -> Callable[[Sequence[Any]], str]:
    """Return the function that hashes a row given in the order of the columns of its table.

    Empty columns do not count, so that a later schema can add columns; nor do columns that are not audited.
    """
    names = [column.name for column in table.columns]
    audited = [column.name for column in table.columns if column.info.get("audited", True)]
    columns = [(names.index(name), f"{_quoted(name)}:") for name in sorted(audited)]

    def hashed(row: Sequence[Any]) -> str:
        parts = [
            name + (_quoted(value) if type(value) is str else str(value) if type(value) is int else _other(value))
            for at, name in columns
            if (value := row[at]) is not None
        ]
        return sha256(f"{{{','.join(parts)}}}")

    return hashed


def line_writer(names: Sequence[str]) -> Callable[[Sequence[Any]], str]:
    """Return the function that writes a row as JSON with the names of its columns, as `json.dumps` does but faster.

    Examples
    --------
    >>> line_writer(["id", "name"])([1, "Zürich"])
    '{"id": 1, "name": "Zürich"}'
    """
    keys = [f"{_quoted(name)}: " for name in names]

    def written(row: Sequence[Any]) -> str:
        parts = [
            key + (_as_it_is(value) if type(value) is str else str(value) if type(value) is int else _other(value))
            for key, value in zip(keys, row, strict=True)
        ]
        return f"{{{', '.join(parts)}}}"

    return written


def sha256(text: str) -> str:
    """Return the SHA-256 of a text in ASCII."""
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _other(value: Any) -> str:
    """Return the text of a value that is neither text nor a whole number."""
    return _WORDS[value] if value is None or value is True or value is False else canonical(value)
