"""The equations that the code cites are in the theory."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CITED = re.compile(r"[Tt]heory \((\d+)\)((?: and | or |, )\(\d+\))*")


def cited() -> set[str]:
    """Return the numbers of all citations."""
    files = [*(ROOT / "src").rglob("*.py"), *(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").glob("*.py")]
    texts = (file.read_text("utf-8") for file in files if file != Path(__file__))
    return {number for text in texts for m in CITED.finditer(text) for number in re.findall(r"\d+", m[0])}


def test_every_cited_equation_is_in_the_theory() -> None:
    pages = "".join(page.read_text("utf-8") for page in (ROOT / "docs" / "theory").glob("*.md"))
    known = set(re.findall(r"^\(theory-(\d+)\)=$", pages, re.MULTILINE))
    assert known == {str(number) for number in range(1, 17)}
    assert len(cited()) > 10
    assert cited() <= known
