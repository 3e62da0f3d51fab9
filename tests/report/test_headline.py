"""The decision at the head of a report: the worst of all that it contains, in its text, its JSON and its exit code."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from tests.report.test_verification import verification

from truepose.report import headline
from truepose.report.document import Table
from truepose.report.headline import tile
from truepose.report.locale import LOCALES, load_locale
from truepose.report.records import read_record
from truepose.verification.conformity import ASSESSMENTS

ORDER = {name: k for k, name in enumerate(ASSESSMENTS)}


def verified(decision: str, **changes):
    """Return a verification with a decision."""
    one = verification(**changes)
    good = tuple(replace(target, decision="pass") for target in one.targets)
    if decision in ("undecided", "fail"):
        good = (replace(good[0], decision=decision), *good[1:])
    return replace(one, targets=good, unmeasured=("P9",) if decision == "not assessed" else ())


def evidence(monkeypatch, poses: str | None, *programs, tolerance: float | None = 0.4, records=(), held_out=True):
    monkeypatch.setattr(headline, "decision", lambda _: poses)
    cell = SimpleNamespace(tolerance_mm=tolerance)
    return SimpleNamespace(cell=cell, verifications=list(programs), records=list(records), held_out=held_out or None)


@pytest.mark.promise("the head of a report never says PASS where anything in it is not PASS")
@pytest.mark.parametrize("poses", ["pass", "undecided", "fail"])
@pytest.mark.parametrize("programs", list(itertools.product(ASSESSMENTS, repeat=2)))
def test_the_head_is_the_worst_of_all(monkeypatch, poses, programs):
    found = headline.headline(evidence(monkeypatch, poses, *map(verified, programs)))
    assert found.decision == max((poses, *programs), key=ORDER.__getitem__)
    assert found.held_out == poses
    assert [decision for _, decision in found.programs] == list(programs)


def test_held_out_poses_that_nothing_decides_are_no_pass(monkeypatch):
    assert headline.headline(evidence(monkeypatch, None, verified("pass"))).decision == "not assessed"
    assert headline.headline(evidence(monkeypatch, None, verified("fail"))).decision == "fail"
    assert headline.headline(evidence(monkeypatch, None, verified("pass"), held_out=False)).decision == "pass"
    assert headline.headline(evidence(monkeypatch, None, held_out=False)).decision == "not assessed"


@pytest.mark.parametrize("locale", LOCALES)
def test_both_tolerances_are_named(monkeypatch, locale):
    say = load_locale(locale)
    given = evidence(monkeypatch, "pass", verified("pass"))
    found = headline.headline(given)
    assert found.tolerances_mm == (0.2, 0.4)
    word, caption = tile(found, say)
    assert word == say("conformity.pass")
    assert say.number(0.2, ".3f") in caption
    assert say.number(0.4, ".3f") in caption
    texts = [block.text for block in headline.section(given, found, say).blocks if getattr(block, "warns", False)]
    assert len(texts) == 1
    alike = headline.headline(evidence(monkeypatch, "pass", verified("pass", tolerance_mm=0.4)))
    assert alike.tolerances_mm == (0.4,)


def record(folder, name: str, corrected: int):
    path = folder / f"{name}.corrections.json"
    summary = {
        "targets": 10, "corrected": corrected, "clipped": 0, "skipped": 10 - corrected, "refused": 0,
        "largest_correction_mm": 0.5, "largest_std_mm": 0.1,
    }  # fmt: skip
    content = {
        "program": f"{name}.src", "map_sha256": None, "on_guard": "skip", "summary": summary, "files": [],
        "targets": [],
    }  # fmt: skip
    path.write_text(json.dumps(content))
    return read_record(path)


def test_each_program_has_one_row(monkeypatch, tmp_path):
    """29 corrected programs have as many rows, whether they were verified or not; a verification alone has its own."""
    say = load_locale("en")
    records = [record(tmp_path, f"p{k}", k % 11) for k in range(29)]
    of_third = verified("fail", program="somewhere/p3.src", record="elsewhere/p3.corrections.json")
    alone = verified("not assessed", program="other.src", record="other.corrections.json")
    given = evidence(monkeypatch, "pass", of_third, alone, records=records)
    (table,) = [b for b in headline.section(given, headline.headline(given), say).blocks if isinstance(b, Table)]
    rows = {row[0]: row[1:] for row in table.rows}
    assert len(table.rows) == len(rows) == 30
    assert rows["p3.src"] == ["10", "3", "7", "0.500", "8", "0.200", "FAIL"]
    assert rows["p4.src"] == ["10", "4", "6", "0.500", "–", "–", "not verified"]
    assert rows["other.src"] == ["9", "–", "–", "–", "8", "0.200", "NOT ASSESSED"]
