"""Distances from fixed points in the fit: rows along the direction to the point, with their own noise."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from truepose import Cell, ErrorMap, fit_cell, load_map, update_map
from truepose.cli import app
from truepose.errors import DataError, FileError
from truepose.geometry import apply_transform
from truepose.predictors.distances import DistanceRows
from truepose.predictors.kinematic.distances import aimed, owners
from truepose.samples import Distances, Poses, Samples, mask_table, on_arm, read_distances, read_samples, write_samples
from truepose.simulation import VirtualCell
from truepose.trackers import write_readings

PREDICTOR = "kinematic-kriging"
NOISE = 0.01
GROSS = 7


class Bench:
    """A virtual cell with three fixed points around it, whose places the tracker knows."""

    def __init__(self) -> None:
        self.virtual = VirtualCell("hard", seed=1)
        self.samples = self.virtual.measure(self.virtual.design(40, seed=1), seed=1)
        self.alone = fit_cell(self.virtual.cell, self.samples, PREDICTOR)
        self.tf = self.alone.registration.tf_base_tracker
        p_base = np.array([[2500.0, -1500.0, 200.0], [2500.0, 1500.0, 800.0], [900.0, 0.0, 1500.0]])
        self.points = dict(zip("ABC", apply_transform(np.linalg.inv(self.tf), p_base), strict=True))
        self.cell = Cell.from_toml(self.virtual.cell.to_toml() + self.toml(self.points))
        q = self.virtual.design(60, seed=2)
        origin = np.array(list("ABC"))[np.arange(60) % 3]
        far = np.linalg.norm(self.true(q) - p_base[np.arange(60) % 3], axis=1)
        far += np.random.default_rng(0).normal(0.0, NOISE, 60)
        self.distances = Distances(q=q, distance=far, origin=origin, source="distances")
        self.full = replace(self.samples, distances=self.distances)

    @staticmethod
    def toml(points: dict[str, np.ndarray]) -> str:
        keys = ("x_mm", "y_mm", "z_mm")
        rows = {
            name: "\n".join(f"{key} = {value:.9f}" for key, value in zip(keys, p, strict=True))
            for name, p in points.items()
        }
        return "".join(f"\n[distances.{name}]\n{text}\nstd_mm = {NOISE}\n" for name, text in rows.items())

    def true(self, q: np.ndarray) -> np.ndarray:
        """Return where the tool is, as the registration of the samples sees it."""
        tf = self.tf @ np.linalg.inv(self.virtual.truth.tf_base_tracker)
        return (tf @ self.virtual.true_poses(q))[:, :3, 3]

    def missed(self, error_map: ErrorMap) -> float:
        q = self.virtual.design(80, seed=77)
        e = self.true(q) - self.virtual.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, 3]
        return float(np.linalg.norm(error_map.predict_errors(Poses(q=q))[0] - e, axis=1).mean())


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


@pytest.fixture(scope="module")
def fitted(bench) -> ErrorMap:
    wrong = bench.distances.distance.copy()
    wrong[GROSS] += 3.0
    return fit_cell(bench.cell, replace(bench.full, distances=replace(bench.distances, distance=wrong)), PREDICTOR)


# --- the rows ---------------------------------------------------------------------------------------------------------


def test_a_distance_is_linearised_where_the_arm_is():
    rng = np.random.default_rng(0)
    p, e = rng.normal(0, 500, (9, 3)), rng.normal(0, 2, (9, 3))
    origin = p + rng.normal(0, 400, (9, 3))
    rows = DistanceRows(np.zeros((9, 6)), origin, np.linalg.norm(p + e - origin, axis=1), np.full(9, 0.01))
    u, along = aimed(rows, p, e)
    np.testing.assert_allclose(along, u * np.einsum("na,na->n", u, e)[:, None], atol=1e-9)  # exact at the truth
    _, near = aimed(rows, p, e + rng.normal(0, 0.01, (9, 3)))
    np.testing.assert_allclose(near, along, atol=1e-3)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("solver", ["covariance", "basis"])
def test_three_distances_from_far_points_are_a_position(bench, solver):
    """From points so far that their directions do not change, along the axes: the same information."""
    model, n = bench.alone.predictor, len(bench.samples) - 1
    assert model.conditions == ()
    x, e, noise = bench.alone.fitted_inputs, bench.alone.e, np.full((n + 1, 3), NOISE)
    same = model.with_fitted_parameters().set_params(solver=solver)
    whole = same.set_params(weight=[1.0] * (n + 1)).fit(x, e, noise)
    p = bench.alone.p_cmd[n] + e[n]
    origin = p - 1e7 * np.eye(3)
    rows = DistanceRows(np.tile(x[n], (3, 1)), origin, np.full(3, 1e7), np.full(3, NOISE))
    other = model.with_fitted_parameters().set_params(solver=solver, distance_rows=rows, weight=[1.0] * (n + 3))
    other.fit(x[:n], e[:n], noise[:n])
    found, wanted = (one.predict(bench.distances.q, return_std=True) for one in (other, whole))
    without = other.set_params(distances=False, weight=[1.0] * n).fit(x[:n], e[:n], noise[:n])
    assert np.abs(without.predict(bench.distances.q) - wanted[0]).max() > 1e-3
    atol = 2e-5 if solver == "covariance" else 5e-4  # the knots of a basis span the sampled angles
    np.testing.assert_allclose(found[0], wanted[0], atol=atol)
    np.testing.assert_allclose(found[1], wanted[1], atol=atol)


def test_distances_at_the_pose_of_a_sample_belong_to_it(bench):
    rows = DistanceRows(bench.samples.q[[4, 9]], np.zeros((2, 3)), np.ones(2), np.ones(2))
    np.testing.assert_array_equal(owners(rows, bench.samples.q), [4, 9])
    rows = DistanceRows(bench.distances.q[:2], np.zeros((2, 3)), np.ones(2), np.ones(2))
    np.testing.assert_array_equal(owners(rows, bench.samples.q), [40, 41])


# --- in a map ---------------------------------------------------------------------------------------------------------


def test_a_map_gains_from_distances(bench, fitted):
    alone, here = bench.missed(bench.alone), bench.missed(fitted)
    assert here < 0.9 * alone
    q = Poses(q=bench.distances.q)
    assert fitted.predict_errors(q)[1].mean() < bench.alone.predict_errors(q)[1].mean()
    assert "40 and 60 distances" in repr(fitted)
    left = fitted.predictor.leave_one_out().residual
    assert left.shape == (40, 3)
    assert not fitted.worth.weak


def test_a_wrong_distance_is_left_out_and_named(fitted):
    assert fitted.predictor.gross_distances_.tolist() == [GROSS]
    assert [(one["row"], one["reason"]) for one in fitted.excluded] == [
        (GROSS, "a distance that is contradicted by the others")
    ]


@pytest.mark.exhaustive
def test_a_wrong_fixed_point_leaves_the_map_as_it_was(bench):
    moved = {name: p + np.array([3.0, -3.0, 2.0]) for name, p in bench.points.items()}
    cell = Cell.from_toml(bench.virtual.cell.to_toml() + bench.toml(moved))
    found = fit_cell(cell, bench.full, PREDICTOR)
    q = Poses(q=bench.distances.q)
    np.testing.assert_allclose(found.predict_errors(q), bench.alone.predict_errors(q), atol=1e-12)
    assert len(found.excluded) == 60
    assert "do not gain from the distances" in found.excluded[0]["reason"]
    forced = fit_cell(cell, bench.full, f"{PREDICTOR}:distances=yes")
    assert np.abs(forced.predict_errors(q)[0] - found.predict_errors(q)[0]).max() > 0.01


def test_other_predictors_and_the_option_say_that_they_do_not_use_them(bench):
    for name, why in ((f"{PREDICTOR}:distances=no", "do not gain"), ("registration", "kinematic-kriging does")):
        found = fit_cell(bench.cell, bench.full, name)
        assert len(found.excluded) == 60
        assert why in found.excluded[0]["reason"]


def test_maps_keep_them(bench, fitted, tmp_path):
    q = Poses(q=bench.distances.q)
    fitted.save(tmp_path / "map.truepose")
    again = load_map(tmp_path / "map.truepose")
    np.testing.assert_allclose(again.predict_errors(q), fitted.predict_errors(q), atol=1e-7)
    np.testing.assert_allclose(again.samples.distances.p_origin, fitted.samples.distances.p_origin)
    more = bench.virtual.measure(bench.virtual.design(5, seed=9), seed=9)
    for name, changed in (("joined", update_map(fitted, more)), ("moved", update_map(fitted, more, "station"))):
        changed.save(tmp_path / f"{name}.truepose")
        found = load_map(tmp_path / f"{name}.truepose").predict_errors(q)
        np.testing.assert_allclose(found, changed.predict_errors(q), atol=1e-6)
    with pytest.raises(DataError, match="distances are not added to a map; leave them out, or fit a new map"):
        update_map(fitted, replace(more, distances=bench.distances))


@pytest.mark.exhaustive
def test_a_map_that_does_not_use_them_is_read_as_it_was(bench, tmp_path):
    found = fit_cell(bench.cell, bench.full, f"{PREDICTOR}:distances=no")
    found.save(tmp_path / "map.truepose")
    q = Poses(q=bench.distances.q[:5])
    np.testing.assert_allclose(
        load_map(tmp_path / "map.truepose").predict_errors(q), bench.alone.predict_errors(q), atol=1e-7
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def test_tables_are_read_as_written(bench, tmp_path):
    named = replace(bench.full, name=np.array([f"P{i}" for i in range(40)]))
    write_samples(tmp_path / "samples.csv", named)
    again = read_samples(tmp_path / "samples.csv")
    assert len(again) == 40
    np.testing.assert_allclose(again.p_meas, named.p_meas, rtol=1e-10)
    np.testing.assert_allclose(again.distances.distance, bench.distances.distance, rtol=1e-11)
    np.testing.assert_allclose(again.distances.q, bench.distances.q, atol=1e-12)
    np.testing.assert_array_equal(again.distances.origin, bench.distances.origin)
    assert again.distances.approach is None
    assert "60 distances" in repr(again)
    assert len(again[:5].distances) == 60
    frame = again.to_frame()
    assert len(frame) == 100
    assert len(Samples.from_frame(frame).distances) == 60
    masked = mask_table(tmp_path / "samples.csv", tmp_path / "masked.csv", None)
    assert len(masked.distances) == 60


def test_a_distance_beside_a_position_does_not_matter(bench, tmp_path):
    write_samples(tmp_path / "samples.csv", bench.samples)
    lines = (tmp_path / "samples.csv").read_text().splitlines()
    lines = [f"{lines[0]},distance_mm", *(f"{line},1234.5" for line in lines[1:])]
    (tmp_path / "samples.csv").write_text("\n".join(lines) + "\n")
    assert read_samples(tmp_path / "samples.csv").distances is None


def test_joints_of_the_display_are_converted(bench):
    arm = replace(bench.virtual.robot, coupling=[[3, 2, 1.0]])
    shown = bench.distances.q.copy()
    shown[:, 2] -= shown[:, 1]
    table = replace(bench.full, distances=replace(bench.distances, q=None, q_shown=shown))
    np.testing.assert_allclose(on_arm(table, arm).distances.q, bench.distances.q, atol=1e-12)


TABLE = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_meas_mm,y_meas_mm,z_meas_mm,distance_mm,distance_std_mm,origin"
Q = "10,-70,80,5,40,6"


@pytest.mark.parametrize(
    ("rows", "match"),
    [
        ([f"{Q},,,,1500,,A"], "all rows are distances .* the station and the tool are found from rows with x_meas_mm"),
        ([f"{Q},1,2,3,,,", f"{Q},,,,-5,,A"], "line 3.*distance_mm must be above 0"),
        ([f"{Q},1,2,3,,,", f"{Q},,,,5,0,A"], "line 3.*distance_std_mm must be above 0"),
        ([f"{Q},1,2,3,,,", f"{Q},,,,far,,A"], "distance_mm is 'far', which is not a number"),
        ([f"{Q},1,2,3,,,", f"{Q},,7,,1500,,A"], "which is not a number"),
        ([f"{Q},1,2,3,,,", f"{Q},,,,,,A"], "which is not a number"),
        ([f"{Q},1,2,3,,,", ",,,,,,,,,1500,,A"], "distances need the joints|neither joints"),
    ],
)
def test_rows_that_cannot_be(tmp_path, rows, match):
    (tmp_path / "samples.csv").write_text("\n".join([TABLE, *rows]) + "\n")
    with pytest.raises((FileError, DataError), match=match):
        read_samples(tmp_path / "samples.csv")


def test_distances_of_reflectors_and_without_unit_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text(f"{TABLE},reflector\n{Q},1,2,3,,,,A\n{Q},,,,1500,,A,A\n")
    with pytest.raises(DataError, match="to the tool point, not to a reflector"):
        read_samples(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text(f"{TABLE.replace('distance_mm', 'distance')}\n{Q},1,2,3,5,,\n")
    with pytest.raises(FileError, match="column distance has no unit; name it distance_mm"):
        read_samples(tmp_path / "b.csv")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"origin": np.full(60, "D")}, r"origin 'D' is not in the cell file \(it has A, B, C\); add \[distances.D\]"),
        ({"origin": None}, r"needs one table \[distances.NAME\] \(it states A, B, C\), or name one of several"),
        ({"metres": True}, r"distance_mm is up to .* mm off .* are distances in mm and to the tool point"),
        ({"swapped": True}, r"distance_mm is up to .* is the fixed point stated in the tracker frame"),
    ],
)
def test_fixed_points_that_are_not_known_or_not_there(bench, change, match):
    distances = bench.distances
    if change.pop("metres", False):
        distances = replace(distances, distance=distances.distance / 1000.0)
    if change.pop("swapped", False):
        distances = replace(distances, origin=np.roll(distances.origin, 1))
    with pytest.raises(DataError, match=match):
        fit_cell(bench.cell, replace(bench.full, distances=replace(distances, **change)), PREDICTOR)


def test_a_fixed_point_at_the_tool_is_refused(bench):
    p = bench.samples.p_meas[:1] + np.array([0.0, 0.0, 20.0])
    near = Distances(q=bench.samples.q[:1], distance=[20.0], distance_std=[0.01], p_origin=p)
    with pytest.raises(DataError, match="nearer than 50 mm the direction of a distance is not certain"):
        fit_cell(bench.cell, replace(bench.samples, distances=near), PREDICTOR)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('[distances."a b;"]\nx_mm = 1.0\ny_mm = 0.0\nz_mm = 0.0\nstd_mm = 0.01', "is not one word"),
        ("[distances.A]\nx_mm = 1.0\ny_mm = 0.0", "z_mm"),
        ("[distances.A]\nx_mm = 1.0\ny_mm = 0.0\nz_mm = 0.0\nstd_mm = 0.0", "std_mm"),
    ],
)
def test_cell_files_that_cannot_be(bench, text, match):
    with pytest.raises(FileError, match=match):
        Cell.from_toml(f"{bench.virtual.cell.to_toml()}\n{text}\n")


@pytest.mark.exhaustive
def test_on_the_command_line(bench, tmp_path: Path):
    (tmp_path / "cell.toml").write_text(bench.cell.to_toml())
    write_readings(tmp_path / "readings.csv", bench.samples, "tidy")
    write_samples(tmp_path / "plan.csv", Poses(q=bench.samples.q))
    columns = bench.distances.table_columns()
    rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    (tmp_path / "distances.csv").write_text("\n".join(rows) + "\n")
    assert len(read_distances(tmp_path / "distances.csv")) == 60

    def run(*arguments: str) -> dict:
        result = CliRunner().invoke(app, [*arguments, "--json"])
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout)

    here = str(tmp_path)
    found = run(
        *("import", f"{here}/cell.toml", f"{here}/readings.csv", "--plan", f"{here}/plan.csv"),
        *("--distances", f"{here}/distances.csv", "--out", f"{here}/samples.csv"),
    )
    assert found["distances"] == 60
    again = read_samples(tmp_path / "samples.csv")
    assert again.distances.row.tolist() == list(range(40, 100))
    run("fit", f"{here}/cell.toml", f"{here}/samples.csv", f"--predictor={PREDICTOR}", "--out", f"{here}/m.truepose")
    assert len(load_map(tmp_path / "m.truepose").predictor.distance_rows) == 60
    (tmp_path / "distances.csv").write_text("q1_deg\n1\n")
    result = CliRunner().invoke(
        app,
        [
            *("import", f"{here}/cell.toml", f"{here}/readings.csv", "--plan", f"{here}/plan.csv", "--force"),
            *("--distances", f"{here}/distances.csv", "--out", f"{here}/samples.csv"),
        ],
    )
    assert result.exit_code == 1
    assert "needs the column distance_mm" in str(result.exception)
