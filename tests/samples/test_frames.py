"""Tables for pandas: what goes out comes in again, and what is missing is said."""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
import pytest

import truepose as tp
from truepose.errors import DataError, FileError, MissingPackageError
from truepose.similarity import ExperimentalVariogram


@pytest.fixture(scope="module")
def error_map() -> tp.ErrorMap:
    virtual = tp.VirtualCell("paper", seed=3)
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "ordinary-kriging")


@pytest.fixture(scope="module")
def held_out() -> tp.Samples:
    virtual = tp.VirtualCell("paper", seed=3)
    return virtual.measure(virtual.design(25, seed=1))


def test_samples_come_back(ur10) -> None:
    samples = tp.load_example("ur10").samples
    frame = samples.to_frame()
    assert list(frame.columns) == (ur10 / "samples.csv").read_text("utf-8").splitlines()[0].split(",")
    again = tp.Samples.from_frame(frame)
    assert again.source == "frame"
    for name in ("q", "p_cmd", "p_meas", "p_std", "rotation_std", "temperature", "row"):
        np.testing.assert_allclose(getattr(again, name), getattr(samples, name), rtol=1e-14)
    assert (again.rotation_meas.inv() * samples.rotation_meas).magnitude().max() < 1e-12
    poses = tp.Poses.from_frame(frame)
    assert not hasattr(poses, "p_meas")
    np.testing.assert_allclose(poses.q, samples.q, rtol=1e-14)


def test_a_frame_of_ones_own() -> None:
    frame = pd.DataFrame(
        {"name": ["A", "=B"], "q1_rad": [0.1, 0.2], "x_meas_m": [1, 2], "y_meas_m": [0.0, 0.0], "z_meas_m": [0, 0]}
    )
    samples = tp.Samples.from_frame(frame.set_index(pd.Index([7, 9])))
    np.testing.assert_allclose(samples.p_meas[:, 0], [1000, 2000])
    assert samples.name.tolist() == ["A", "=B"]
    with pytest.raises(FileError, match=r"frame.*has x_meas_m, y_meas_m but not z_meas_mm"):
        tp.Samples.from_frame(frame.drop(columns="z_meas_m"))
    with pytest.raises(FileError, match=r"frame.*2.*x_meas_m is nan; measure again or remove the row"):
        tp.Samples.from_frame(frame.assign(x_meas_m=[1.0, np.nan]))
    with pytest.raises(FileError, match=r"^frame: needs columns x_meas_mm …; it has q1_rad; rename yours"):
        tp.Samples.from_frame(frame[["q1_rad"]])


@pytest.mark.parametrize(
    ("names", "ours"),
    [
        ("id theta1_rad", "name q1_rad"),
        ("Point ID,θ1 [rad]", "name,q1_rad"),
        ("Nr,Joint 1 (rad)", "name,q1_rad"),
        ("name,id,A1_rad", "name,other,q1_rad"),
    ],
)
def test_columns_under_the_names_of_papers(names: str, ours: str) -> None:
    def read(header: str) -> tp.Samples:
        columns = [*(header.split(",") if "," in header else header.split()), "x_meas_mm", "y_meas_mm", "z_meas_mm"]
        row = ["P7", *["12"] * (len(columns) - 5), 0.5, 1.0, 2.0, 3.0]
        return tp.Samples.from_frame(pd.DataFrame([row], columns=columns))

    theirs, plain = read(names), read(ours)
    assert theirs.name.tolist() == plain.name.tolist() == ["P7"]
    np.testing.assert_array_equal(theirs.q, plain.q)
    np.testing.assert_array_equal(theirs.q, [[0.5]])


def test_experimental_variogram_comes_back(rng: np.random.Generator) -> None:
    ev = tp.experimental_variogram(rng.uniform(0, 100, (50, 2)), rng.normal(size=(50, 3)), bins=8)
    frame = ev.to_frame()
    assert list(frame.columns) == ["from", "to", "lag", "pairs", "gamma_1_mm2", "gamma_2_mm2", "gamma_3_mm2"]
    again = ExperimentalVariogram.from_frame(frame)
    for name in ("lag", "semivariance", "vector", "pairs", "edges"):
        np.testing.assert_array_equal(getattr(again, name), getattr(ev, name))
    assert (again.dimensions, again.estimator) == (2, "matheron")
    assert tp.fit_variogram(again, "nugget") == tp.fit_variogram(ev, "nugget")
    with pytest.raises(DataError, match="the table has no column lag, gamma_1_mm2; expected lag, pairs, gamma_1_mm2"):
        ExperimentalVariogram.from_frame(frame[["pairs"]])


def test_validation_and_prediction(error_map: tp.ErrorMap, held_out: tp.Samples) -> None:
    result = error_map.validate(held_out)
    frame = result.to_frame()
    assert frame.index.tolist() == held_out.row.tolist()
    assert frame["before_mm"].mean() == pytest.approx(result["before"]["mean_mm"])
    assert frame["after_mm"].mean() == pytest.approx(result["after"]["mean_mm"])
    after = frame["x_before_mm"] - frame["x_predicted_mm"]
    np.testing.assert_allclose(frame["x_after_mm"], after)
    predicted = error_map.predict(held_out).to_frame()
    np.testing.assert_allclose(predicted["y_error_mm"], frame["y_predicted_mm"])


def test_corrections(error_map: tp.ErrorMap, held_out: tp.Samples) -> None:
    commands = error_map.correct(held_out.q, accept_weak_map=True)
    frame = commands.to_frame()
    np.testing.assert_array_equal(frame[["x_command_mm", "y_command_mm", "z_command_mm"]], commands.p_command)
    assert frame["verdict"].tolist() == commands.verdict.tolist()


def test_without_pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    message = r"needs the package pandas; install it with: pip install 'truepose\[pandas\]'"
    with pytest.raises(MissingPackageError, match=message):
        tp.Poses(q=np.zeros((2, 6))).to_frame()


def test_notebooks_show_tables(error_map: tp.ErrorMap, held_out: tp.Samples) -> None:
    result = error_map.validate(held_out)
    shown = result._repr_html_()
    assert f"<td>mean</td><td>{result['before']['mean_mm']:.4g}</td><td>{result['after']['mean_mm']:.4g}</td>" in shown
    assert "<p>inside the predicted 95 % intervals" in shown
    ev = tp.experimental_variogram(error_map.p_cmd, error_map.e, bins=4)
    assert ev._repr_html_().count("<tr>") == 5
    assert "<caption>spherical variogram</caption>" in tp.VariogramModel("spherical", sill=1.0, range=5.0)._repr_html_()
    assert held_out._repr_html_().startswith("<table><caption>Samples: 25 rows from ")
    commands = error_map.correct(held_out.q, accept_weak_map=True)
    assert "<caption>Corrections of 25 targets [mm]</caption>" in commands._repr_html_()
    virtual = tp.VirtualCell("paper", seed=3)
    choice = tp.choose(["idw", "registration"], virtual.measure(virtual.design(40)), virtual.cell)
    assert "<td>idw</td>" in choice._repr_html_()
    assert "<td>chosen</td>" in choice._repr_html_()
    assert error_map.predict(held_out)._repr_html_().startswith("<table><caption>Prediction, lengths in mm</caption>")
    envelope = tp.permutation_envelope(error_map.p_cmd, error_map.e, 4, permutations=99, rng=0)
    assert envelope._repr_html_().startswith(
        f"<table><caption>Similarity p = {envelope.p_value:.3g}; band of 95 % of 99"
    )
    assert envelope._repr_html_().count("<tr>") == 5
    frame = choice.to_frame()
    assert frame["predictor"].tolist() == [row["predictor"] for row in choice.ranking]
    assert frame["mean_mm"].tolist() == [row["mean_mm"] for row in choice.ranking]
    assert (frame["mean_low_mm"] < frame["mean_mm"]).all()
    assert (frame["mean_mm"] < frame["mean_high_mm"]).all()
