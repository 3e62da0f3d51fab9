import csv
import functools
import json

import pytest
from typer.testing import CliRunner

from truepose.cli import app
from truepose.studies.paper import METHODS, groups, markdown, run_study, spread, write_study

PAPERS, CALIBRATION, KINEMATIC = METHODS[0], METHODS[3], METHODS[4]


@pytest.fixture(scope="module")
def results():
    return run_study(seeds=[1], per_axis=5, methods=[PAPERS, CALIBRATION, KINEMATIC])


def reduction_max(results, orientation, method):
    return [
        spread(of, "reduction_max")[0]
        for (turned, _, title), of in groups(results).items()
        if turned == orientation and title == method.title
    ]


@pytest.mark.exhaustive
def test_papers_method_at_one_orientation(results):
    assert all(75 < reduction < 95 for reduction in reduction_max(results, "fixed", PAPERS))


@pytest.mark.exhaustive
def test_papers_method_knows_no_orientation(results):
    assert all(reduction < 75 for reduction in reduction_max(results, "free", PAPERS))


@pytest.mark.exhaustive
@pytest.mark.parametrize("orientation", ["fixed", "free"])
@pytest.mark.parametrize("method", [CALIBRATION, KINEMATIC], ids=lambda method: method.predictor)
def test_ours_removes_more_at_any_orientation(results, orientation, method):
    assert min(reduction_max(results, orientation, method)) > 85


@pytest.mark.exhaustive
def test_cells_are_as_the_paper_found_its_robot(results):
    assert 0.7 < spread([r for r in results if r.orientation == "fixed"], "max_before")[0] < 1.3


@pytest.mark.exhaustive
def test_all_methods_meet_the_same_errors(results):
    of_cell = [r for r in results if (r.seed, r.orientation, r.sampling) == (1, "fixed", "grid")]
    assert len(of_cell) == 3
    assert max(r.max_before for r in of_cell) == pytest.approx(min(r.max_before for r in of_cell), rel=0.05)


@pytest.mark.exhaustive
def test_folder(results, tmp_path):
    write_study(tmp_path, results)
    with (tmp_path / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["max_after"]) for row in rows] == pytest.approx([r.max_after for r in results], abs=1e-4)
    assert (tmp_path / "table.md").read_text("utf-8") == markdown(results)
    assert (tmp_path / "reductions.svg").read_text("utf-8").count("orientation") >= 2


@pytest.mark.exhaustive
def test_command(tmp_path, monkeypatch):
    monkeypatch.setattr("truepose.studies.paper.run_study", functools.partial(run_study, methods=[PAPERS]))
    answer = CliRunner().invoke(app, ["study", str(tmp_path), "--seeds", "1", "--per-axis", "3", "--json"])
    assert answer.exit_code == 0, answer.output
    assert len(json.loads(answer.stdout)["results"]) == 4
    assert (tmp_path / "table.md").exists()
