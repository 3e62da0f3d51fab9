"""Every page of the gallery runs and draws one figure; the short scripts of the documentation run and print."""

import runpy
import shutil
import warnings
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from truepose.studies.demo import run_demo

SCRIPTS = Path(__file__).parents[1] / "docs" / "scripts"
EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("plot_*.py"))


@pytest.mark.filterwarnings("ignore:.*no sill within the samples:truepose.errors.VariogramWarning")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_runs(path: Path) -> None:
    with mpl.rc_context({"backend": "agg"}), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        runpy.run_path(str(path), run_name="__main__")
        assert len(plt.get_fignums()) == 1
        plt.close("all")


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_has_at_most_20_lines(script: Path) -> None:
    assert len(script.read_text().splitlines()) <= 20


def test_the_script_of_the_paper_runs(capsys: pytest.CaptureFixture[str]) -> None:
    said = runpy.run_path(str(SCRIPTS / "paper_experiment.py"))
    out = capsys.readouterr().out
    assert "ordinary-kriging" in out
    assert "semivariance" in out
    before, after = (np.linalg.norm(said[name], axis=1).max() for name in ("before", "after"))
    assert after < 0.5 * before


def test_the_script_of_a_production_cell_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the folder of the demonstration, whose own results are removed first."""
    run_demo(tmp_path, progress=str)
    for path in (tmp_path / "map.truepose", tmp_path / "report.html"):
        path.unlink()
    shutil.rmtree(tmp_path / "corrected")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(SCRIPTS / "production_cell.py"))
    assert "kinematic-kriging" in capsys.readouterr().out
    assert {"map.truepose", "report.html", "corrected"} <= {path.name for path in tmp_path.iterdir()}
    written, programmed = ((tmp_path / folder / "panel.dat").read_bytes() for folder in ("corrected", "program"))
    assert written != programmed
