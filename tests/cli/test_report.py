"""The report command: languages, PDF, and what it refuses."""

from __future__ import annotations


def test_report_in_german_as_pdf_and_page(run, cell_files, tmp_path):
    for ending in ("html", "pdf"):
        out = tmp_path / f"bericht.{ending}"
        done = run("report", cell_files.map, "--test", cell_files.test, "--locale", "de", "--out", out, "--json")
        assert done.json == {"report": str(out)}
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
