"""Records of corrected programs and their section: counts, reasons, warnings, tables to attach."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import re
from dataclasses import replace

import pytest
from tests.report.conftest import DATE, EN, record

from truepose.errors import FileError
from truepose.report.document import Table
from truepose.report.evidence import StoreEntry, gather
from truepose.report.locale import load_locale
from truepose.report.page import to_html, to_pdf
from truepose.report.records import read_record
from truepose.report.sections import document


def test_names_in_other_characters(error_map, study, sidecar, no_figures):
    made = document(gather(error_map, study=study, sidecars=[sidecar(record(error_map.hash, program="面板.src"))]), EN)
    assert b"TrueposeSans" in to_pdf(made, DATE)
    assert "@font-face" in to_html(made)
    lost = replace(made, title="\U00013000")  # a hieroglyph
    with pytest.raises(
        FileError, match=r"r\.pdf: cannot be typeset: .*\U00013000.*; install a font with this character"
    ):
        to_pdf(lost, DATE, "r.pdf")


def test_corrected_programs(error_map, study, sidecar, no_figures):
    say = load_locale("en")
    made = document(gather(error_map, study=study, sidecars=[sidecar(record(error_map.hash))]), say)
    programs = next(section for section in made.sections if section.title == say("programs.title"))
    tables = [block for block in programs.blocks if isinstance(block, Table)]
    assert tables[0].rows == [["panel.src", "2", "1", "0", "0", "1", "0", "0.100", "0.013"]]
    assert tables[1].rows == [["skipped", "too far", "1", "1"]]
    assert len(tables) == 2
    assert "All 2 targets are in the attached table targets.csv." in made.text()
    assert not any(getattr(block, "warns", False) for block in programs.blocks)
    assert "b" * 64 in made.text()


def test_programs_of_another_map_and_refusals_are_told(error_map, study, sidecar, no_figures):
    content = record("c" * 64, n=100)
    content["summary"]["refused"] = 4
    text = document(gather(error_map, study=study, sidecars=[sidecar(content)]), EN).text()
    assert "panel.src was corrected with another map (cccccccccccc), not with this one." in text
    assert "panel.src: 4 targets refused" in text
    assert "All 100 targets are in the attached table targets.csv." in text


@pytest.mark.exhaustive
def test_names_are_text_not_markup(error_map, study, sidecar, no_figures):
    name = '<b>&"#[*_$@`</b>'
    content = record(error_map.hash, n=2)
    content["targets"] = [{**target, "name": name, "reason": name} for target in content["targets"]]
    made = document(gather(error_map, study=study, sidecars=[sidecar(content)]), EN)
    page = to_html(made)
    assert name not in page
    assert "&lt;b&gt;&amp;" in page
    assert to_pdf(made, DATE).startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no json", r"panel.json: is not the record of a corrected program \(Invalid JSON"),
        ("[]", r"panel.json: is not the record of a corrected program \("),
        ("{}", r"\(program: Field required\); name a .json file written by 'truepose correct'"),
        (json.dumps(record("a", targets=[{"name": 3}])), r"\(targets.0.name: Input should be a valid string\)"),
    ],
)
def test_files_that_are_no_records(tmp_path, content, message):
    path = tmp_path / "panel.json"
    path.write_text(content)
    with pytest.raises(FileError, match=message) as raised:
        read_record(path)
    assert "\n" not in str(raised.value)


@pytest.mark.promise("the report has one row for each program, groups reasons, and attaches the complete tables")
def test_many_programs(error_map, study, tmp_path, no_figures):
    paths = []
    for k in range(4):
        content = record(error_map.hash, n=6, program=f"cell/p{k}.src")
        content["targets"][0]["reason"] = f"{0.31 + k / 100:.3f} mm, above P1's limit of 0.300 mm"
        content["limits"] = {"max_std_mm": {"value": 0.2 if k else 0.1, "origin": "option"}}
        paths.append(tmp_path / f"p{k}.corrections.json")
        paths[-1].write_text(json.dumps(content))
    made = document(gather(error_map, study=study, sidecars=paths, date=DATE), EN)
    section = next(section for section in made.sections if section.title == EN("programs.title"))
    rows, reasons, *limits = [block.rows for block in section.blocks if isinstance(block, Table)]
    assert [row[0] for row in rows] == ["p0.src", "p1.src", "p2.src", "p3.src", "total"]
    assert rows[-1][1:3] == ["24", "20"]
    assert reasons == [["skipped", "… mm, above P1's limit of … mm", "4", "4"]]
    assert len(limits) == 2
    poses, table, hashes = made.attachments
    assert (poses.name, table.name) == ("poses.csv", "targets.csv")
    assert len(poses.text.splitlines()) == 61
    listed = {row["file"]: row["sha256"] for row in csv.DictReader(io.StringIO(hashes.text))}
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
    assert listed == {**digests, "panel.dat": "b" * 64}
    listed = list(csv.DictReader(io.StringIO(table.text)))
    assert len(listed) == 24
    assert (listed[0]["verdict"], listed[0]["x_correction_mm"], listed[1]["file"]) == ("skip", "", "panel.dat")
    assert "/EmbeddedFile" in to_pdf(made, DATE).decode("latin-1")
    saved = re.search(r'<a download="targets.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)"', to_html(made))
    assert base64.b64decode(saved[1]).decode() == table.text


def test_two_hundred_programs_with_long_names(error_map, study, tmp_path, no_figures):
    """Warnings, targets and hashes are listed in part, and completely in the attached tables."""
    paths = []
    for k in range(200):
        content = record("c" * 64, n=3, program=f"cell/{'stringer_row_' * 6}{k}.src")
        content["summary"]["refused"] = 1
        paths.append(tmp_path / f"p{k}.corrections.json")
        paths[-1].write_text(json.dumps(content))
    made = document(gather(error_map, study=study, sidecars=paths, date=DATE), EN)
    section = next(section for section in made.sections if section.title == EN("programs.title"))
    other, refused = [block.text for block in section.blocks if getattr(block, "warns", False)]
    assert "and 194 more" in other
    assert "and 194 more: 200 targets refused" in refused
    tables = [block for block in section.blocks if isinstance(block, Table)]
    assert len(tables[0].rows) == 201
    assert [len(table.rows) for table in tables[1:]] == [1]
    assert "12 of 200 records are listed; the attached table hashes.csv contains all." in made.text()
    assert len(made.attachments[-1].text.splitlines()) == 401
    page = to_html(made)
    assert "stringer_<wbr>row_<wbr>" in page
    assert b"%PDF-" in to_pdf(made, DATE)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("locale", ["en", "de", "zh"])
def test_programs_corrected_with_a_draft_are_marked(error_map, study, sidecar, no_figures, locale):
    say = load_locale(locale)
    draft = say("programs.draft", program="panel.src")
    for state, marked in (("draft", True), ("released", False)):
        content = record(error_map.hash, map_state=state)
        assert (draft in document(gather(error_map, study=study, sidecars=[sidecar(content)]), say).text()) == marked


@pytest.mark.sampled(1)
@pytest.mark.parametrize("state", ["draft", "released", "superseded", "withdrawn"])
def test_a_report_made_with_a_store_shows_the_state_of_the_map_and_the_head(error_map, study, no_figures, state):
    made = document(gather(error_map, study=study, store=StoreEntry(17, "f" * 64, state)), EN)
    assert f"entry 17, head {'f' * 64}" in made.text()
    warned = {block.text for block in made.lead if block.warns}
    states = {one: EN(f"report.map_{one}") for one in ("draft", "superseded", "withdrawn")}
    assert warned & set(states.values()) == {text for one, text in states.items() if one == state}
    assert "audit trail" not in document(gather(error_map, study=study), EN).text()
