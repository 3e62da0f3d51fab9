"""Tests whose needs are missing are skipped on an engineer's machine, and fail where they must run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.needs import needed

TESTS = Path(__file__).parents[1]
OPTIONAL = re.compile(r"importorskip\(\"(alembic|sqlalchemy|psycopg|argon2|pyarrow|cryptography|distributed)")


def test_a_missing_module_is_skipped_or_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRUEPOSE_STORE_TESTS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="no module nowhere: pip install elsewhere"):
        needed("nowhere", "elsewhere")
    monkeypatch.setenv("TRUEPOSE_STORE_TESTS", "require")
    with pytest.raises(pytest.fail.Exception, match="no module nowhere: pip install elsewhere"):
        needed("nowhere", "elsewhere")
    assert needed("json", "Python").loads("1") == 1


def test_no_test_of_the_store_or_of_clusters_is_skipped_where_it_must_run() -> None:
    skipping = [path.name for path in TESTS.rglob("test_*.py") if OPTIONAL.search(path.read_text("utf-8"))]
    assert skipping == []
