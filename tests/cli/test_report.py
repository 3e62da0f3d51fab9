"""The report command: languages, PDF, and what it refuses."""

from __future__ import annotations

import pytest


@pytest.mark.exhaustive
def test_report_in_german_as_pdf_and_page(run, cell_files, tmp_path):
    for ending in ("html", "pdf"):
        out = tmp_path / f"bericht.{ending}"
        done = run("report", cell_files.map, "--test", cell_files.test, "--locale", "de", "--out", out, "--json")
        assert done.json.keys() == {"report", "decision", "held_out", "programs", "tolerances_mm", "facts"}
        assert done.json["report"] == str(out)
    assert 'lang="de"' in (tmp_path / "bericht.html").read_text()
    assert (tmp_path / "bericht.pdf").read_bytes().startswith(b"%PDF-")


def test_report_refuses(run, cell_files, tmp_path):
    out = tmp_path / "r.html"
    assert (
        "expected a locale of en, de, zh; got 'fr'"
        in run("report", cell_files.map, "--locale", "fr", "--out", out).failed()
    )
    assert (
        "expected a name that ends in .html or .pdf"
        in run("report", cell_files.map, "--out", tmp_path / "r.odt").failed()
    )
    bad = run("report", cell_files.map, "--program", cell_files.cell, "--out", out).failed()
    assert "is not the record of a corrected program" in bad
    assert not out.exists()


@pytest.mark.exhaustive
def test_report_takes_the_records_of_a_folder(run, cell_files, near_samples, tmp_path):
    options = ("--config-dat", tmp_path / "config.dat", "--tool", "1", "--base", "0", "--out", tmp_path / "out")
    assert run("correct", cell_files.map, *near_samples[:1], *options).code == 0
    out = tmp_path / "r.html"
    assert run("report", cell_files.map, "--program", tmp_path / "out", "--out", out).code == 0
    assert "a.src" in out.read_text()
    (tmp_path / "empty").mkdir()
    refused = run("report", cell_files.map, "--program", tmp_path / "empty", "--out", tmp_path / "s.html").failed()
    assert "empty: holds no record of a corrected program (*.corrections.json)" in refused
