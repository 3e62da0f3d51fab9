"""The code of the how-to pages does what the pages say."""

from __future__ import annotations

import importlib.util
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

import truepose as tp
from truepose.errors import DataError
from truepose.predictors.registry import PREDICTORS, PredictorSpec

FILES = Path(__file__).parents[2] / "docs" / "how-to" / "files"
SCRIPTS = FILES / "scripts"


def load(path: Path) -> Any:
    """Import a module of the pages by its path."""
    specification = importlib.util.spec_from_file_location(path.stem, path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[path.stem] = module  # scikit-learn's checks pickle the estimator
    specification.loader.exec_module(module)
    return module


QuadraticTrend = load(FILES / "predictor" / "quadratic_trend.py").QuadraticTrend


@parametrize_with_checks([QuadraticTrend()])
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.SkipTestWarning")
def test_the_example_predictor_keeps_scikit_learns_contract(estimator: Any, check: Any) -> None:
    check(estimator)


def test_the_example_predictor_recovers_a_quadratic_error(rng: np.random.Generator) -> None:
    x, new = rng.random((60, 3)) * 1000, rng.random((20, 3)) * 1000

    def error(p: np.ndarray) -> np.ndarray:
        return 1e-6 * np.stack([p[:, 0] ** 2, p[:, 0] * p[:, 1], 1e3 * p[:, 2]], axis=1)

    predicted, std = QuadraticTrend(1e-9).fit(x, error(x)).predict(new, return_std=True)
    np.testing.assert_allclose(predicted, error(new), atol=1e-6)
    assert std.max() < 1e-5
    assert (QuadraticTrend().fit(x, error(x)).nugget_ < 1e-4).all()
    with pytest.raises(DataError, match="ridge must be above 0, got 0"):
        QuadraticTrend(0).fit(x, error(x))


def test_the_example_predictors_closed_form_is_refitting(rng: np.random.Generator) -> None:
    x, keep = rng.random((60, 3)) * 1000, np.arange(60) != 7
    e = np.sin(x / 300)
    residual, std = QuadraticTrend(1e-9).fit(x, e).leave_one_out()
    refitted = QuadraticTrend(1e-9).fit(x[keep], e[keep]).predict(x[[7]])[0]
    np.testing.assert_allclose(residual[7], e[7] - refitted, atol=1e-7)
    assert (std > 0).all()


def test_the_example_predictors_standard_deviation_is_honest(rng: np.random.Generator) -> None:
    x, new = rng.uniform(-1, 1, (80, 3)), rng.uniform(-1, 1, (4000, 3))
    model = QuadraticTrend().fit(x, x**2 + rng.normal(scale=0.1, size=x.shape))
    predicted, std = model.predict(new, return_std=True)
    assert 0.6 < np.sqrt(np.mean(((predicted - new**2) / std) ** 2)) < 1.5


@pytest.mark.exhaustive
def test_the_example_predictor_in_a_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(PREDICTORS, "quadratic-trend", raising=False)
    # [name]
    PREDICTORS["quadratic-trend"] = PredictorSpec(QuadraticTrend, space="cartesian")
    virtual = tp.VirtualCell("paper", seed=7)
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(100)), "quadratic-trend")
    # [/name]
    monkeypatch.delitem(PREDICTORS, "quadratic-trend")
    with pytest.raises(DataError, match="no predictor 'quadratic-trend'"):
        tp.fit_cell(virtual.cell, error_map.samples, "quadratic-trend")
    monkeypatch.setitem(PREDICTORS, "quadratic-trend", PredictorSpec(QuadraticTrend))
    held_out = virtual.measure(virtual.design(80, seed=3), seed=3)
    result = error_map.validate(held_out)
    assert result["after"]["mean_mm"] < 0.2 * result["before"]["mean_mm"]
    error_map.save(tmp_path / "map.truepose")
    loaded, q = tp.load_map(tmp_path / "map.truepose"), virtual.design(5, seed=9)
    np.testing.assert_array_equal(loaded.predict_measured(q), error_map.predict_measured(q))


@pytest.mark.filterwarnings("ignore:.*no sill within the samples:truepose.errors.VariogramWarning")
def test_the_papers_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    names = runpy.run_path(str(SCRIPTS / "paper_experiment.py"))
    result = tp.accuracy(names["before"], names["after"])
    assert result.reduction_max_percent > 75  # the paper's figure
    assert capsys.readouterr().out.startswith("ExperimentalVariogram(20 bins")


@pytest.mark.parametrize("name", ["paper_experiment", "production_cell"])
def test_a_script_is_short(name: str) -> None:
    lines = (SCRIPTS / f"{name}.py").read_text("utf-8").splitlines()
    assert sum(bool(line) for line in lines) <= 20


def test_the_notebook() -> None:
    with mpl.rc_context({"backend": "agg"}):
        names = runpy.run_path(str(SCRIPTS / "notebook.py"))
        assert names["after"].mean() < 0.2 * names["before"].mean()
        plt.close("all")


@pytest.fixture(scope="module")
def practice(tmp_path_factory: pytest.TempPathFactory, run: Any) -> Path:
    """Return the folder of the practice cell."""
    folder = tmp_path_factory.mktemp("practice") / "practice"
    assert run("demo", folder, "--seed", 7).code == 0
    return folder


def script(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, SCRIPTS / name, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.exhaustive
def test_a_command_is_followed(practice: Path, tmp_path: Path) -> None:
    cell, samples = practice / "cell.toml", practice / "fit_samples.csv"
    told = script("follow.py", "fit", cell, samples, "--predictor", "idw", "--out", tmp_path / "map.truepose")
    assert "step: Fitting idw" in told
    assert told.splitlines()[-1].startswith("result: ")
    assert (tmp_path / "map.truepose").is_file()
    refused = script("follow.py", "fit", cell, cell, "--out", tmp_path / "other.truepose")
    assert refused.splitlines()[-1].startswith(f"File not accepted: {cell}")


@pytest.mark.exhaustive
def test_the_control_loop(tmp_path: Path) -> None:
    told = script("control_loop.py", tmp_path)
    assert told.startswith("<FrozenMap of kuka-kr210-r2700-extra: kinematic-kriging, within 0.")
    assert "1000 set points, largest error " in told
    assert (tmp_path / "cell.frozen").stat().st_size < 500_000


@pytest.mark.exhaustive
def test_the_production_cell(practice: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(practice, tmp_path / "cell")
    assert " mm before, 0.0" in script("production_cell.py", folder)
    assert {path.name for path in (folder / "production").iterdir()} == {
        "panel.src", "panel.dat", "panel.corrections.json", "panel.corrections.csv",
    }  # fmt: skip
    assert (folder / "production.html").stat().st_size > 10_000


@pytest.mark.exhaustive
def test_verifying_at_the_machine(practice: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        patch.setattr(sys, "argv", ["run_program.py", str(practice)])
        runpy.run_path(str(FILES / "later" / "run_program.py"))
    lines = script("verify.py", practice, tmp_path / "after.txt").splitlines()
    before, after = (float(line.split()[2]) for line in lines)
    assert after < 0.2 * before


@pytest.mark.exhaustive
def test_two_arms_of_ones_own() -> None:
    lines = script("check_arm.py", FILES / "arms").splitlines()
    assert lines[0].endswith("flange [mm] [-817.2, -232.9, 62.8]")
    assert lines[1].endswith("flange [mm] [374.0, 0.0, 630.0]")
    assert lines[2].endswith("flange [mm] [0.0, 374.0, 630.0]")
    for file, name in (("ur5e.csv", "universal-robots-ur5e"), ("irb120.toml", "abb-irb120")):
        q = np.full(6, 0.4)
        np.testing.assert_allclose(tp.load_robot(FILES / "arms" / file).forward(q), tp.load_robot(name).forward(q))


@pytest.mark.exhaustive
def test_comparing(practice: Path) -> None:
    lines = script("compare.py", practice / "cell.toml", practice / "fit_samples.csv").splitlines()
    assert {line.split()[0] for line in lines[:4]} == {"registration", "idw", "ordinary-kriging", "calibration"}
    assert lines[3].startswith("registration")


def test_later_readings_of_the_practice_cell(tmp_path: Path) -> None:
    shutil.copytree(FILES / "later", tmp_path / "later")
    runpy.run_path(str(tmp_path / "later" / "measure.py"))
    checks, bumped = (tp.read_samples(tmp_path / "later" / f"{name}.csv") for name in ("checks", "bumped"))
    shift = np.linalg.norm(bumped.p_meas - checks.p_meas, axis=1)
    np.testing.assert_allclose(shift, 0.5, atol=1e-3)  # 0.3 and 0.4 mm in the frame of the tool


def test_a_rapid_task_is_corrected_only_whole() -> None:
    task = FILES / "rapid_task" / "TASK1"
    alone, whole = tp.read_program(task / "Points.mod"), tp.read_program(task)
    assert alone.counts() == {"correct": 0, "skip": 3, "refuse": 1}
    assert whole.counts() == {"correct": 2, "skip": 2, "refuse": 0}


def test_the_thirty_programs_of_the_integrators_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Thirty programs, of which one cannot be read and one uses an unknown tool, until they are mended."""
    from truepose.programs.reading import read_programs

    monkeypatch.chdir(tmp_path)
    frames = tp.FrameTable(tools={3: np.eye(4)}, bases={1: np.eye(4)})
    for arguments, unreadable, refused, n in (([], 1, 20, 1364), (["--mended"], 0, 0, 1384)):
        monkeypatch.setattr(sys, "argv", ["make_programs.py", *arguments])
        runpy.run_path(str(FILES / "plant" / "make_programs.py"))
        assert len(list(Path("programs").rglob("*.src"))) == 30
        found = read_programs([Path("programs")], frames)
        (project,) = found.programs
        assert len(found.unreadable) == unreadable
        assert project.counts() == {"correct": n - refused, "skip": 0, "refuse": refused}
        assert len(project.modules) == 30 - unreadable


@pytest.mark.exhaustive
def test_the_arm_of_the_tutorial(tmp_path: Path) -> None:
    shutil.copytree(FILES / "own_arm", tmp_path / "own_arm")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        laboratory = runpy.run_path("own_arm/measure.py")
    arm, modified = (tp.load_robot(tmp_path / "own_arm" / name) for name in ("arm.csv", "arm_mdh.toml"))
    tool = laboratory["TOOL"][:3] * 1000
    q = laboratory["q"]
    expected = 1000 * laboratory["positions"](laboratory["NOMINAL"], q)  # an independent calculation
    for robot in (arm, modified):
        np.testing.assert_allclose(robot.forward(q, tool=tool)[:, :3, 3], expected, atol=1e-9)
    virtual = tp.VirtualCell("ideal", robot=tmp_path / "own_arm" / "arm.csv")
    readings = virtual.measure(virtual.design(20))
    assert tp.fit_cell(virtual.cell, readings, "registration").validate(readings)["after"]["mean_mm"] < 0.1
    for wrong_call in ({"robot": arm}, {"preset": arm}):
        with pytest.raises(tp.TrueposeError, match=r"expected (a library name or|one of paper)"):
            tp.VirtualCell(**wrong_call)
    with pytest.raises(tp.TrueposeError, match='"theta_rad" in the header; use "offset_deg"'):
        tp.load_robot(tmp_path / "own_arm" / "table.csv")
    wrong = (tmp_path / "own_arm" / "arm.csv").read_text("utf-8").replace("convention = dh", "convention = mdh")
    (tmp_path / "own_arm" / "arm.csv").write_text(wrong, "utf-8")
    samples = tp.Samples(1000 * laboratory["read"], q=q, p_cmd=expected, source="measured.csv")
    with pytest.raises(DataError, match="is it this robot, with its D-H convention"):
        tp.fit_cell(tp.load_cell(tmp_path / "own_arm" / "cell.toml"), samples, "registration")
