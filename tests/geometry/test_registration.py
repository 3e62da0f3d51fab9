"""Registration: exact without noise, robust against outliers, and explicit about undetermined directions."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from tests.tiers import examples

from truepose.errors import DataError, IdentifiabilityError
from truepose.geometry import (
    apply_transform,
    invert_transform,
    make_transform,
    register,
    register_known,
    register_with_tool,
)
from truepose.geometry.robust import OUTLIER_LIMIT, robust_scale
from truepose.robots import load_robot


@dataclass
class Station:
    """A tracker somewhere, a tool, and readings with noise of one axis `noise` [mm]."""

    flange: np.ndarray
    tf_base_tracker: np.ndarray
    p_flange_tool: np.ndarray
    p_commanded: np.ndarray
    p_measured: np.ndarray


def make_station(rng: np.random.Generator, n: int = 40, noise: float = 0.0, turn: float = 1.0) -> Station:
    rotations = Rotation.from_rotvec(turn * rng.normal(size=(n, 3)))
    flange = make_transform(rotations, np.array([1500, 0, 900]) + rng.uniform(-400, 400, (n, 3)))
    tf = make_transform(Rotation.random(rng=rng), rng.normal(scale=3000, size=3))
    tool = rng.normal(scale=200, size=3)
    p_base = apply_transform(flange, tool)
    p_measured = apply_transform(invert_transform(tf), p_base + noise * rng.normal(size=(n, 3)))
    return Station(flange, tf, tool, p_base, p_measured)


def rotation_error(tf: np.ndarray, other: np.ndarray) -> np.ndarray:
    return (Rotation.from_matrix(other[:3, :3]) * Rotation.from_matrix(tf[:3, :3]).inv()).as_rotvec()


class TestExact:
    @settings(max_examples=examples(30))
    @given(seed=st.integers(0, 2**32 - 1), n=st.integers(3, 30), robust=st.booleans())
    def test_rigid(self, seed: int, n: int, robust: bool) -> None:
        s = make_station(np.random.default_rng(seed), n)
        found = register(s.p_commanded, s.p_measured, robust=robust)
        np.testing.assert_allclose(found.tf_base_tracker, s.tf_base_tracker, atol=1e-6)
        np.testing.assert_allclose(found.residuals, 0.0, atol=1e-8)
        assert not found.outliers.any()
        assert found.hint == ""

    @settings(max_examples=examples(30))
    @given(seed=st.integers(0, 2**32 - 1), n=st.integers(5, 30), robust=st.booleans())
    def test_with_tool(self, seed: int, n: int, robust: bool) -> None:
        s = make_station(np.random.default_rng(seed), n)
        found = register_with_tool(s.flange, s.p_measured, robust=robust)
        np.testing.assert_allclose(found.tf_base_tracker, s.tf_base_tracker, atol=1e-5)
        np.testing.assert_allclose(found.p_flange_tool, s.p_flange_tool, atol=1e-6)
        np.testing.assert_allclose(found.residuals, 0.0, atol=1e-8)

    def test_points_in_a_plane(self, rng: np.random.Generator) -> None:
        s = make_station(rng)
        plane = s.flange.copy()
        plane[:, 2, 3] = 700.0
        p_measured = apply_transform(invert_transform(s.tf_base_tracker), apply_transform(plane, s.p_flange_tool))
        found = register_with_tool(plane, p_measured)
        np.testing.assert_allclose(found.tf_base_tracker, s.tf_base_tracker, atol=1e-6)
        flat = s.p_commanded * [1, 1, 0]
        found = register(flat, apply_transform(invert_transform(s.tf_base_tracker), flat))
        np.testing.assert_allclose(found.tf_base_tracker, s.tf_base_tracker, atol=1e-6)

    def test_flange_that_only_turns_about_its_origin(self, rng: np.random.Generator) -> None:
        s = make_station(rng)
        flange = s.flange.copy()
        flange[:, :3, 3] = [1000.0, 100.0, 500.0]
        p_measured = apply_transform(invert_transform(s.tf_base_tracker), apply_transform(flange, s.p_flange_tool))
        found = register_with_tool(flange, p_measured)
        np.testing.assert_allclose(found.p_flange_tool, s.p_flange_tool, atol=1e-6)


class TestLeastSquares:
    """Optima and covariances against scipy and against repetition."""

    def test_with_tool_is_the_optimum_of_scipy(self, rng: np.random.Generator) -> None:
        s = make_station(rng, n=25, noise=0.5)
        found = register_with_tool(s.flange, s.p_measured, robust=False)

        def residuals(x: np.ndarray) -> np.ndarray:
            tf = make_transform(Rotation.from_rotvec(x[3:6]), x[:3])
            return (apply_transform(tf, s.p_measured) - apply_transform(s.flange, x[6:])).ravel()

        true = np.r_[s.tf_base_tracker[:3, 3], Rotation.from_matrix(s.tf_base_tracker[:3, :3]).as_rotvec()]
        optimum = least_squares(
            residuals, np.r_[true, s.p_flange_tool], x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        np.testing.assert_allclose(np.linalg.norm(found.residuals) ** 2, 2 * optimum.cost, rtol=1e-9)
        np.testing.assert_allclose(found.p_flange_tool, optimum.x[6:], atol=1e-4)

    @pytest.mark.parametrize("with_tool", [False, True])
    def test_covariance_matches_the_scatter(self, rng: np.random.Generator, with_tool: bool) -> None:
        normalised = []
        for _ in range(60):
            s = make_station(rng, n=30, noise=0.1)
            if with_tool:
                found = register_with_tool(s.flange, s.p_measured, robust=False)
            else:
                found = register(s.p_commanded, s.p_measured, robust=False)
            error = [s.tf_base_tracker[:3, 3] - found.tf_base_tracker[:3, 3]]
            error.append(rotation_error(found.tf_base_tracker, s.tf_base_tracker))
            if with_tool:
                error.append(s.p_flange_tool - found.p_flange_tool)
            x = np.concatenate(error)
            assert found.covariance.shape == (len(x), len(x))
            normalised.append(x @ np.linalg.solve(found.covariance, x) / len(x))
        assert 0.8 < np.mean(normalised) < 1.25  # mean of 60 chi-square values over their degrees of freedom

    @settings(max_examples=examples(20))
    @given(seed=st.integers(0, 2**32 - 1))
    def test_moving_the_tracker_moves_only_the_station(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        s = make_station(rng, n=20, noise=0.3)
        move = make_transform(Rotation.random(rng=rng), rng.normal(scale=1000, size=3))
        for first, second in [
            (register(s.p_commanded, s.p_measured), register(s.p_commanded, apply_transform(move, s.p_measured))),
            (
                register_with_tool(s.flange, s.p_measured),
                register_with_tool(s.flange, apply_transform(move, s.p_measured)),
            ),
        ]:
            np.testing.assert_allclose(second.tf_base_tracker @ move, first.tf_base_tracker, atol=1e-4)
            np.testing.assert_allclose(second.residuals, first.residuals, atol=1e-5)
            np.testing.assert_array_equal(second.outliers, first.outliers)


class TestOutliers:
    @pytest.mark.parametrize("with_tool", [False, True])
    @pytest.mark.parametrize("size", [3.0, 50.0, 5e4])
    def test_one_in_five_is_gross(self, rng: np.random.Generator, with_tool: bool, size: float) -> None:
        s = make_station(rng, n=50, noise=0.1)
        rows = np.sort(rng.choice(50, 10, replace=False))
        direction = rng.normal(size=(10, 3))
        s.p_measured[rows] += size * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        found = register_with_tool(s.flange, s.p_measured) if with_tool else register(s.p_commanded, s.p_measured)
        np.testing.assert_array_equal(np.flatnonzero(found.outliers), rows)
        assert np.linalg.norm(rotation_error(found.tf_base_tracker, s.tf_base_tracker)) < 1e-3
        assert 0.08 < found.noise_std < 0.12
        named, sizes = found.outlier_rows()
        assert sorted(named) == rows.tolist()
        assert (np.diff(sizes) <= 0).all()
        np.testing.assert_allclose(sizes, size, atol=1.0)
        assert "10 of 50 readings are outliers" in found.hint

    def test_without_robust_nothing_is_left_out(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        s.p_measured[3] += 50.0
        assert not register(s.p_commanded, s.p_measured, robust=False).outliers.any()

    def test_exact_readings_with_gross_ones(self, rng: np.random.Generator) -> None:
        s = make_station(rng)
        s.p_measured[[2, 5]] += [0.01, 0.0, 0.0]
        found = register_with_tool(s.flange, s.p_measured)
        assert np.flatnonzero(found.outliers).tolist() == [2, 5]
        np.testing.assert_allclose(found.tf_base_tracker, s.tf_base_tracker, atol=1e-5)

    def test_swapped_rows_are_paired(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        s.p_measured[[4, 9]] = s.p_measured[[9, 4]]
        found = register_with_tool(s.flange, s.p_measured)
        assert found.swapped.tolist() == [[4, 9], [9, 4]]
        assert (
            "the reading of row 9 fits the command of row 4, the reading of row 4 fits the command of row 9"
            in found.hint
        )

    def test_result_does_not_depend_on_the_seed(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        s.p_measured[[4, 9]] += 5.0
        a, b = (register_with_tool(s.flange, s.p_measured, rng=seed) for seed in (0, 7))
        np.testing.assert_allclose(a.tf_base_tracker, b.tf_base_tracker, atol=1e-6)


class TestMeasuredRobot:
    """The measured UR10: figures from its README."""

    @pytest.fixture
    def table(self, ur10: Path) -> np.ndarray:
        return np.genfromtxt(ur10 / "samples.csv", delimiter=",", names=True)

    def test_station_and_tool_leave_072_mm(self, table: np.ndarray) -> None:
        q = np.deg2rad(np.column_stack([table[f"q{i}_deg"] for i in range(1, 7)]))
        measured = np.column_stack([table[f"{axis}_meas_mm"] for axis in "xyz"])
        found = register_with_tool(load_robot("universal-robots-ur10").forward(q), measured)
        norms = np.linalg.norm(found.residuals, axis=1)
        assert abs(norms.mean() - 0.72) < 0.02
        assert abs(norms.max() - 1.9) < 0.05
        assert not found.outliers.any()
        assert "tool z with station translation y: known only to" in found.hint

    def test_rigid_alone_leaves_105_mm(self, table: np.ndarray) -> None:
        commanded = np.column_stack([table[f"{axis}_cmd_mm"] for axis in "xyz"])
        measured = np.column_stack([table[f"{axis}_meas_mm"] for axis in "xyz"])
        found = register(commanded, measured)
        assert abs(np.linalg.norm(found.residuals, axis=1).mean() - 1.05) < 0.01
        assert not found.outliers.any()


class TestNotIdentifiable:
    def refuse(self, flange: np.ndarray, match: str, noise: float = 0.0) -> None:
        rng = np.random.default_rng(1)
        p = apply_transform(flange, np.array([10.0, 20.0, 150.0])) + noise * rng.normal(size=(len(flange), 3))
        tf = make_transform(Rotation.random(rng=rng), [2000.0, 100.0, 0.0])
        with pytest.raises(IdentifiabilityError, match=match):
            register_with_tool(flange, apply_transform(tf, p))

    def test_one_orientation(self, rng: np.random.Generator) -> None:
        p = rng.uniform(-400, 400, (20, 3))
        match = (
            "the 20 poses cannot determine tool . with station translation .; tool . with station translation .; "
            r"tool . with station translation . \(rank 6 of 9, condition number .*\); measure more poses, with the "
            "flange turned about at least two axes"
        )
        self.refuse(make_transform(np.tile(np.eye(3), (20, 1, 1)), p), match)

    @pytest.mark.parametrize("noise", [0.0, 0.1])
    def test_turned_about_one_axis(self, rng: np.random.Generator, noise: float) -> None:
        turned = Rotation.from_rotvec(rng.uniform(0, 6, (30, 1)) * [0.0, 0.0, 1.0])
        flange = make_transform(turned, rng.uniform(-400, 400, (30, 3)))
        self.refuse(flange, r"cannot determine tool z with station translation z \(rank 8 of 9", noise)

    def test_nearly_one_axis_within_the_noise(self, rng: np.random.Generator) -> None:
        turned = Rotation.from_euler("zy", rng.uniform(0, 1, (30, 2)) * [360, 1e-3], degrees=True)
        flange = make_transform(turned, rng.uniform(-400, 400, (30, 3)))
        self.refuse(flange, r"cannot determine tool z with station translation z \(rank 8 of 9", noise=0.1)

    def test_a_direction_within_the_noise_is_taken_from_a_known_tool(self, rng: np.random.Generator) -> None:
        turned = Rotation.from_euler("zy", rng.uniform(0, 1, (30, 2)) * [360, 1e-3], degrees=True)
        flange = make_transform(turned, rng.uniform(-400, 400, (30, 3)))
        p = apply_transform(flange, np.array([10.0, 20.0, 150.0])) + 0.1 * rng.normal(size=(30, 3))
        found = register_with_tool(flange, p, [12.0, 19.0, 140.0], tool_std=30.0)
        assert found.p_flange_tool is not None
        np.testing.assert_allclose(found.p_flange_tool, [10.0, 20.0, 140.0], atol=0.2)
        assert abs(np.sqrt(found.covariance[8, 8]) - 30.0) < 1.0
        assert "tool z with station translation z: not determined by these poses" in found.hint
        assert np.linalg.norm(found.residuals, axis=1).mean() < 0.3

    def test_a_known_tool_does_not_help_at_one_orientation(self, rng: np.random.Generator) -> None:
        flange = make_transform(np.tile(np.eye(3), (20, 1, 1)), rng.uniform(-400, 400, (20, 3)))
        with pytest.raises(IdentifiabilityError, match="rank 6 of 9"):
            register_with_tool(flange, flange[:, :3, 3] + 0.1 * rng.normal(size=(20, 3)), [0.0, 0, 0], tool_std=30.0)

    def test_points_on_a_line(self) -> None:
        line = np.outer(np.linspace(0, 500, 10), [0.0, 0.0, 1.0])
        with pytest.raises(
            IdentifiabilityError, match=r"cannot determine station rotation z \(rank 5 of 6.*; the points lie on a line"
        ):
            register(line + 100.0, line)

    def test_all_points_in_one_spot(self) -> None:
        with pytest.raises(IdentifiabilityError, match="rank 3 of 6"):
            register(np.ones((10, 3)), np.ones((10, 3)))


class TestBadInput:
    @pytest.mark.parametrize("factor", [1e-3, 0.1, 1 / 25.4])
    def test_other_units(self, rng: np.random.Generator, factor: float) -> None:
        s = make_station(rng, noise=0.1)
        unit = {1e-3: "m", 0.1: "cm", 1 / 25.4: "in"}[factor]
        with pytest.raises(DataError, match=f"measured positions look like {unit}, expected mm"):
            register(s.p_commanded, s.p_measured * factor)
        with pytest.raises(DataError, match=f"commanded positions look like {unit}, expected mm"):
            register(s.p_commanded * factor, s.p_measured)

    def test_metres_with_tool(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        with pytest.raises(DataError, match="measured positions look like m, expected mm"):
            register_with_tool(s.flange, s.p_measured / 1000)

    @pytest.mark.parametrize("with_tool", [False, True])
    @pytest.mark.parametrize("robust", [False, True])
    @pytest.mark.parametrize("mirror", [np.diag([1, -1, 1]), np.eye(3)[[1, 0, 2]]])
    def test_mirrored(self, rng: np.random.Generator, with_tool: bool, robust: bool, mirror: np.ndarray) -> None:
        s = make_station(rng, noise=0.1)
        fit = partial(register_with_tool, s.flange) if with_tool else partial(register, s.p_commanded)
        with pytest.raises(DataError, match="mirrored they fit: one axis has the wrong sign, or two columns"):
            fit(s.p_measured @ mirror, robust=robust)

    @pytest.mark.sampled(2)
    @pytest.mark.parametrize("with_tool", [False, True])
    @pytest.mark.parametrize("shift", [1, -1, 3])
    def test_shifted_rows(self, rng: np.random.Generator, with_tool: bool, shift: int) -> None:
        s = make_station(rng, noise=0.1)
        moved = np.roll(s.p_measured, -shift, axis=0)
        fit = partial(register_with_tool, s.flange) if with_tool else partial(register, s.p_commanded)
        match = rf"with row i of the readings at row i\{shift:+d} of the commands they fit"
        with pytest.raises(DataError, match=match):
            fit(moved)

    def test_rows_that_do_not_belong_together(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        with pytest.raises(
            DataError,
            match=r"median residual .* mm over a spread of .*; check that commands and readings belong together",
        ):
            register(s.p_commanded, rng.permutation(s.p_measured))

    @pytest.mark.parametrize(
        ("commanded", "measured", "match"),
        [
            (np.eye(3), np.eye(4, 3), "3 commanded and 4 measured positions"),
            (np.eye(2, 3), np.eye(2, 3), "2 readings are too few to register; expected at least 3"),
            (np.eye(3, 2), np.eye(3), r"p_commanded has shape \(3, 2\), expected \(n, 3\)"),
            (np.eye(3), np.diag([1, np.nan, 1]), "p_measured has NaN or infinite numbers in row 1"),
            (np.zeros((0, 3)), np.zeros((0, 3)), "p_commanded is empty"),
        ],
    )
    def test_arrays(self, commanded: np.ndarray, measured: np.ndarray, match: str) -> None:
        with pytest.raises(DataError, match=match):
            register(commanded, measured)

    def test_with_tool(self, rng: np.random.Generator) -> None:
        s = make_station(rng, n=4)
        with pytest.raises(DataError, match="4 readings are too few to register; expected at least 5"):
            register_with_tool(s.flange, s.p_measured)
        with pytest.raises(DataError, match=r"tf_base_flange has shape \(4, 3\)"):
            register_with_tool(s.p_commanded, s.p_measured)
        s = make_station(rng)
        with pytest.raises(DataError, match=r"p_flange_tool has shape \(2,\), expected \(3,\)"):
            register_with_tool(s.flange, s.p_measured, p_flange_tool=[1, 2])

    def test_guess_of_the_tool_changes_nothing(self, rng: np.random.Generator) -> None:
        s = make_station(rng, noise=0.1)
        free = register_with_tool(s.flange, s.p_measured)
        guessed = register_with_tool(s.flange, s.p_measured, p_flange_tool=[0, 0, 500])
        np.testing.assert_allclose(guessed.p_flange_tool, free.p_flange_tool, atol=1e-6)


def test_apply_brings_readings_to_the_base(rng: np.random.Generator) -> None:
    s = make_station(rng)
    found = register(s.p_commanded, s.p_measured)
    np.testing.assert_allclose(found.apply(s.p_measured), s.p_commanded, atol=1e-8)
    np.testing.assert_allclose(found.tf_tracker_base @ found.tf_base_tracker, np.eye(4), atol=1e-9)


def test_repr_and_dict(rng):
    p = rng.uniform(-500, 500, (40, 3))
    reading = p - [100.0, 200.0, 300.0] + rng.normal(scale=0.02, size=p.shape)
    reading[7] += 5.0
    found = register(p, reading)
    text = repr(found)
    assert len(text) < 240
    assert "40 readings, 1 outlier (row 7); noise 0.0" in text
    assert "tracker at (100.0" in text
    plain = json.loads(json.dumps(found.to_dict()))
    np.testing.assert_allclose(plain["tf_base_tracker"], found.tf_base_tracker)
    assert plain["p_flange_tool"] is None
    flange = make_transform(Rotation.random(20, rng=rng), rng.uniform(-500, 500, (20, 3)))
    with_tool = register_with_tool(flange, apply_transform(flange, np.array([10.0, 20.0, 150.0])))
    assert "no outliers" in repr(with_tool)
    assert "tool at (10.000, 20.000, 150.000) mm" in repr(with_tool)


@pytest.mark.parametrize("share", [0.99, 1.01])
@pytest.mark.parametrize("robust", [True, False])
def test_a_stated_station_marks_readings_beyond_the_limit(share: float, robust: bool) -> None:
    """Nothing is fitted: residuals of 0.1 mm, and one 1 % to either side of the limit for outliers."""
    rng = np.random.default_rng(0)
    tf = make_transform(Rotation.from_rotvec([0.1, -0.2, 0.3]), [100.0, 200.0, 300.0])
    commanded = rng.uniform(-500.0, 500.0, (20, 3))
    off = 0.1 * np.eye(3)[np.arange(20) % 3]
    size = share * OUTLIER_LIMIT * robust_scale(np.full(20, 0.1), 3, 0.0)
    off[4] *= size / 0.1
    reading = apply_transform(invert_transform(tf), commanded + off)
    found = register_known(tf, commanded, reading, robust=robust)
    assert np.flatnonzero(found.outliers).tolist() == ([4] if robust and share > 1.0 else [])
    np.testing.assert_allclose(found.residuals, off, atol=1e-9)
    np.testing.assert_array_equal(found.tf_base_tracker, tf)
    assert not found.covariance.any()
    kept = np.linalg.norm(off, axis=1)[~found.outliers]
    assert found.noise_std == pytest.approx(np.sqrt(np.mean(kept**2) / 3.0))
    assert found.hint == ""  # one of 20 is not many


def test_a_stated_station_needs_three_readings_of_as_many_positions() -> None:
    p = np.eye(3)
    assert register_known(np.eye(4), p, p).noise_std == 0.0
    with pytest.raises(DataError, match="2 readings are too few to register; expected at least 3"):
        register_known(np.eye(4), p[:2], p[:2])
    with pytest.raises(DataError, match="3 commanded and 2 measured positions"):
        register_known(np.eye(4), p, p[:2])


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        ([np.nan, 0.0, 100.0], "p_flange_tool has NaN or infinite numbers"),
        ([0.0, 100.0], r"p_flange_tool has shape \(2,\), expected \(3,\)"),
    ],
)
def test_an_estimate_of_the_tool_has_three_finite_numbers(
    rng: np.random.Generator, guess: list[float], message: str
) -> None:
    s = make_station(rng)
    with pytest.raises(DataError, match=message):
        register_with_tool(s.flange, s.p_measured, guess)
