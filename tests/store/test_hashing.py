"""The fast hashes of rows and entries are those of the canonical JSON, whatever a row holds."""

from __future__ import annotations

import hashlib
import json
import random
from typing import Any

import pytest

from truepose.store import schema
from truepose.store.audit import entry_hash, row_hash
from truepose.store.hashing import canonical, canonical_list, line_writer, row_hasher

TEXTS = ("", "Zelle ö", 'a "quoted" \\ text', "tab\tline\nnul\x01", "\U0001f916", "ß\u2028", "null", "</script>")


def plainly(table: Any, row: dict[str, Any]) -> str:
    """Return the hash as its definition says."""
    kept = {c.name: row[c.name] for c in table.columns if row[c.name] is not None and c.info.get("audited", True)}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("table", schema.AUDITED, ids=lambda table: table.name)
def test_rows_of_all_tables(table: Any) -> None:
    choose = random.Random(table.name)
    values = (*TEXTS, None, True, False, 0, -7, 10**18)
    for _ in range(100):
        row = {column.name: choose.choice(values) for column in table.columns}
        assert row_hasher(table)(list(row.values())) == row_hash(table, row) == plainly(table, row)


def test_lines_of_a_backup_are_those_of_json() -> None:
    values = (*TEXTS, None, True, False, 0, -7, 10**18, 0.1)
    names = [f"column {text}" for text in TEXTS]
    for first in range(len(values)):
        row = [values[(first + i) % len(values)] for i in range(len(names))]
        expected = json.dumps(dict(zip(names, row, strict=True)), ensure_ascii=False)
        assert json.loads(line_writer(names)(row)) == json.loads(expected)
    assert line_writer(["a", "ö"])(["ß", 1]) == '{"a": "ß", "\\u00f6": 1}'


def test_entries() -> None:
    entry = [1, "2026-01-01T00:00:00.000000Z", "Zoë", "map.add", "map", None, '{"row":null}', "0" * 64, "unused"]
    text = json.dumps(entry[:-1], sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    assert entry_hash(entry) == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("value", [[1.5, "a"], [True, 1, None], [{"b": 1, "a": [2]}], [[], {}], list(TEXTS)])
def test_lists_of_other_values(value: list[Any]) -> None:
    assert canonical_list(value) == canonical(value)


def test_what_is_no_number_has_no_hash() -> None:
    with pytest.raises(ValueError, match="JSON"):
        canonical_list([float("nan")])
