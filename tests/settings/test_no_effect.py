"""Options that can have no effect are refused, not passed over."""

import pytest

import truepose as tp
from truepose.errors import DataError


@pytest.mark.promise("Options that can have no effect are refused.")
def test_options_without_effect_are_refused(run, map_path, krl, tmp_path, record_property):
    cell, readings = tmp_path / "cell.toml", tmp_path / "readings.txt"
    program = krl()
    cases = {
        ("import", cell, readings, "--plan", readings, "--save-columns", tmp_path / "c.toml"): "without --columns",
        ("import", cell, readings, "--plan", readings, "--keep", "1"): "without --reflectors",
        ("correct", map_path, program, "--in-place", "--out", tmp_path / "out"): "--out has no effect with --in-place",
    }
    for arguments, message in cases.items():
        assert message in run(*arguments).failed()
    assert not (tmp_path / "out").exists()
    record_property("cases", len(cases))


@pytest.mark.promise("Settings of the choice among predictors are refused where one is named.")
def test_candidates_of_a_named_predictor_are_refused(samples, cell_text, record_property):
    cell = tp.Cell.from_toml(cell_text)
    for more in ({"candidates": "all"}, {"splits": ("points",)}, {"folds": 3}):
        with pytest.raises(DataError, match="have no effect with the predictor 'idw'"):
            tp.fit_cell(cell, samples, "idw", **more)
    record_property("cases", 3)


@pytest.mark.promise("The report lists the limits that held for a corrected program, and who stated them.")
def test_the_report_lists_the_limits(run, map_path, krl, tmp_path, no_figures):
    done = run("correct", map_path, krl(), "--out", tmp_path / "out", "--on-guard", "skip")
    assert done.code == 0, done.err
    page, record = tmp_path / "report.html", tmp_path / "out" / "a.corrections.json"
    done = run("report", map_path, "--program", record, "--out", page)
    assert done.code == 0, done.err
    text = page.read_text(encoding="utf-8")
    assert "Limits in force and their source, for a.src" in text
    assert "max_correction_mm" in text
    assert "1.5 times the widest gap" in text
