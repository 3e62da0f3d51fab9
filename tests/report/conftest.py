"""A map, its report in three languages, and records, for all tests of the report."""

from __future__ import annotations

import json
import warnings
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import pytest

from truepose.error_map.fit import fit_cell
from truepose.report.document import Document
from truepose.report.evidence import Evidence, gather
from truepose.report.locale import LOCALES, load_locale
from truepose.report.sections import document
from truepose.report.study import similarity_study
from truepose.simulation import VirtualCell

EN = load_locale("en")
DATE = datetime(2025, 3, 7, 9, 15, tzinfo=UTC)


@pytest.fixture(scope="session")
def cell():
    virtual = VirtualCell("paper", seed=4)
    samples, held_out = (virtual.measure(virtual.design(n, seed=n)) for n in (60, 30))
    return virtual, samples, held_out


@pytest.fixture(scope="session")
def error_map(cell):
    virtual, samples, _ = cell
    return fit_cell(virtual.cell, samples, "ordinary-kriging")


@pytest.fixture(scope="session")
def study(error_map):
    return similarity_study(error_map)


@pytest.fixture(scope="session")
def documents(evidence) -> dict[str, Document]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of a glyph that no font has
        return {locale: document(evidence, load_locale(locale)) for locale in LOCALES}


@pytest.fixture(scope="session")
def evidence(error_map, cell, study) -> Evidence:
    return gather(error_map, cell[2], study=study, date=DATE)


def record(map_sha256: str, n: int = 2, **changes) -> dict:
    target = {
        "file": "panel.dat", "line": 7, "name": "XP1", "before_mm": [1.0, -2.0, 3.0], "after_mm": [1.1, -2.0, 3.0],
        "correction_mm": [0.1, 0.0, 0.0], "std_mm": 0.0125, "verdict": "correct", "reason": "",
    }  # fmt: skip
    left = {
        **target,
        "name": "XP0",
        "std_mm": None,
        "correction_mm": [None] * 3,
        "verdict": "skip",
        "reason": "too far",
    }
    summary = {"targets": n, "corrected": n - 1, "clipped": 0, "skipped": 1, "refused": 0}
    return {
        "format": "truepose corrections",
        "schema": 1,
        "program": r"C:\krc\panel.src",
        "files": [{"file": r"C:\krc\panel.dat", "sha256_before": "a" * 64, "sha256_after": "b" * 64}],
        "map_sha256": map_sha256,
        "on_guard": "skip",
        "summary": {**summary, "largest_correction_mm": 0.1, "largest_std_mm": 0.0125},
        "targets": [left, *[target] * (n - 1)],
        **changes,
    }


@pytest.fixture
def sidecar(tmp_path):
    def write(content: dict) -> Path:
        path = tmp_path / "panel.corrections.json"
        path.write_text(json.dumps(content))
        return path

    return write


class Asked(HTMLParser):
    """What a page loads, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.loads += [
            value for name, value in attrs if name in ("src", "href", "xlink:href", "action", "data") and value
        ]

    def handle_data(self, data):
        self.text += data
