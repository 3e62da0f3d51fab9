"""Identification: estimators agree, intervals cover the true parameters, inseparable parameters are listed."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares
from scipy.spatial.transform import Rotation

from truepose.errors import DataError, IdentifiabilityError
from truepose.geometry import invert_transform, make_transform, register_with_tool
from truepose.identification import (
    Distances,
    KalmanFilter,
    ParametricArm,
    PoseObservations,
    Positions,
    filtered,
    least_squares,
    levenberg_marquardt,
    minimal_subset,
    observability,
    parameter_table,
    poses_to_add,
)
from truepose.robots import Load, load_robot, to_mdh

TOOL = make_transform(Rotation.from_euler("y", 20, degrees=True), [110.0, -20.0, 360.0])
NOISE = 0.03


def draw(robot, n, rng):
    return rng.uniform(0.5 * robot.limits[:, 0], 0.5 * robot.limits[:, 1], (n, robot.dof)).clip(-2.5, 2.5)


def simulate(arm, n, rng, size=0.5, noise=NOISE):
    """Parameters drawn from the tolerances (their size times), and positions read with noise."""
    x = size * arm.tolerance * rng.normal(size=len(arm.parameters))
    q = draw(arm.model.robot, n, rng)
    p = arm.pose(q, x)[:, :3, 3] + noise * rng.normal(size=(n, 3))
    return x, Positions(q, p, np.zeros((n, 3, 3)))


@pytest.fixture(scope="module")
def arm():
    return ParametricArm.of(load_robot("kuka-kr210-r2700-extra"), TOOL)


@pytest.fixture
def case(arm, rng):
    return simulate(arm, 80, rng)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.sampled(1)
def test_estimators_agree_within_their_standard_errors(arm, seed):
    """Every parameter, base and tool too, is off by its whole tolerance."""
    _, data = simulate(arm, 60, np.random.default_rng(seed), size=1.0)
    reference = least_squares(arm, data, arm.tolerance)
    std = np.sqrt(np.diag(reference.covariance))
    damped = levenberg_marquardt(arm, data, arm.tolerance)
    assert np.abs((damped.x - reference.x) / std).max() < 1e-3
    for kind in ("ekf", "ukf"):
        found, misfit = filtered(arm, data, kind=kind)
        assert np.abs((found.x - reference.x) / std).max() < 0.05, kind
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), std, rtol=0.02)
        np.testing.assert_allclose(misfit, reference.misfit, rtol=0.02)


def test_levenberg_marquardt_is_at_the_optimum_of_scipy(arm, case, rng):
    """Another algorithm of scipy's (MINPACK), without our derivative, from another start."""
    _, data = case
    misfit = np.array([NOISE])
    found = levenberg_marquardt(arm, data, arm.tolerance, misfit=misfit)

    def fun(z):
        return np.concatenate([data.residual(arm, arm.tolerance * z).ravel() / NOISE, z])

    other = scipy_least_squares(
        fun, rng.normal(size=len(found.x)) * 0.1, jac="3-point", method="lm", xtol=1e-14, ftol=1e-14
    )
    assert np.abs(other.x - found.x / arm.tolerance).max() < 1e-3
    assert 0.5 * (fun(found.x / arm.tolerance) ** 2).sum() <= other.cost * (1 + 1e-9)


@pytest.mark.parametrize(("subset", "seeds"), [(False, 200), (True, 60)])
@pytest.mark.exhaustive
def test_intervals_hold_the_truth(subset, seeds):
    """Identifiable combinations lie in their 95 % intervals 93-97 % of the time, over 200 virtual robots."""
    robot = load_robot("kuka-kr210-r2700-extra")
    plain = ParametricArm.of(robot, TOOL)
    inside = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 7])
        truth, data = simulate(plain, 60, rng, size=1.0)
        if subset:
            found = least_squares(plain, data, free=minimal_subset(plain, data))
        else:
            found = least_squares(plain, data, plain.tolerance)
        columns = (found.whitener @ found.jacobian).reshape(-1, len(truth)) * plain.tolerance
        _, s, vt = np.linalg.svd(columns, full_matrices=False)
        told = vt[s > 3.0]  # what the data tell better than the tolerances by far
        error = told @ ((found.x - truth) / plain.tolerance)
        scaled = told @ (found.covariance / np.outer(plain.tolerance, plain.tolerance)) @ told.T
        inside.append(np.abs(error) < 1.959964 * np.sqrt(np.diag(scaled)))
    assert 0.93 <= np.concatenate(inside).mean() <= 0.97


def test_intervals_after_a_registration(rng):
    """Also when station and tool are found first with the nominal links, as in a cell."""
    robot = load_robot("kuka-kr210-r2700-extra")
    inside = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        size = {"alpha": 4e-4, "offset": 4e-4, "beta": 4e-4, "a": 0.4, "d": 0.4}
        error = {key: rng.normal(scale=s, size=6) for key, s in size.items()}
        true_robot = replace(robot, **{key: getattr(robot, key) + value for key, value in error.items()})
        q = draw(robot, 60, rng)
        station = make_transform(Rotation.random(rng=rng), rng.normal(scale=2000.0, size=3))
        p_base = true_robot.forward(q, TOOL)[:, :3, 3] + NOISE * rng.normal(size=(60, 3))
        readings = p_base @ station[:3, :3].T + station[:3, 3]
        registration = register_with_tool(robot.forward(q), readings, robust=False)
        tool = make_transform(TOOL[:3, :3], registration.p_flange_tool)
        arm = ParametricArm.of(robot, tool)
        found = least_squares(arm, Positions(q, registration.apply(readings), np.zeros((60, 3, 3))), arm.tolerance)
        # the truth in this arm's parameters: the registered base is off the true one, the tool, too
        shift = registration.tf_base_tracker @ station
        angles = Rotation.from_matrix(shift[:3, :3]).as_euler("XYZ")
        named = {
            f"{ours}{j + 1}": error[key][j]
            for ours, key in (("theta", "offset"), ("d", "d"), ("a", "a"), ("alpha", "alpha"), ("beta", "beta"))
            for j in range(6)
        }
        named |= dict(
            zip((f"base {c}" for c in ("x", "y", "z", "rx", "ry", "rz")), [*shift[:3, 3], *angles], strict=True)
        )
        named |= dict(zip(("tool x", "tool y", "tool z"), (invert_transform(tool) @ TOOL)[:3, 3], strict=True))
        truth = np.array([named[name] for name in arm.names])
        np.testing.assert_allclose(
            arm.pose(q, truth)[:, :3, 3],
            registration.apply(p_base @ station[:3, :3].T + station[:3, 3]),
            atol=6 * NOISE,
        )
        columns = (found.whitener @ found.jacobian).reshape(-1, len(truth)) * arm.tolerance
        _, s, vt = np.linalg.svd(columns, full_matrices=False)
        told = vt[s > 5.0]
        off = told @ ((found.x - truth) / arm.tolerance)
        scaled = told @ (found.covariance / np.outer(arm.tolerance, arm.tolerance)) @ told.T
        inside.append(np.abs(off) < 1.959964 * np.sqrt(np.diag(scaled)))
    assert 0.92 <= np.concatenate(inside).mean() <= 0.98


def test_gross_readings_do_not_move_a_robust_fit(arm, case, rng):
    x, data = case
    clean = levenberg_marquardt(arm, data, arm.tolerance)
    p = data.p.copy()
    p[::10] += rng.normal(scale=5.0, size=(8, 3))
    spoiled = Positions(data.q, p, data.covariance)
    targets = draw(arm.model.robot, 200, rng)

    def miss(found):
        return np.linalg.norm((arm.pose(targets, found.x) - arm.pose(targets, x))[:, :3, 3], axis=1).mean()

    plain = miss(levenberg_marquardt(arm, spoiled, arm.tolerance))
    for loss in ("huber", "soft_l1", "cauchy"):
        assert miss(levenberg_marquardt(arm, spoiled, arm.tolerance, loss=loss)) < 0.25 * plain
    assert miss(levenberg_marquardt(arm, data, arm.tolerance, loss="cauchy")) < 1.3 * miss(clean)


def test_readings_with_large_covariance_weigh_less(arm, case, rng):
    x, data = case
    std = np.where(np.arange(80) < 30, 2.0, 0.01)
    p = arm.pose(data.q, x)[:, :3, 3] + std[:, None] * rng.normal(size=(80, 3))
    covariance = std[:, None, None] ** 2 * np.eye(3)
    found = least_squares(arm, Positions(data.q, p, covariance), arm.tolerance)
    blind = least_squares(arm, Positions(data.q, p, 0 * covariance), arm.tolerance)
    near = np.linalg.norm((arm.pose(data.q, found.x) - arm.pose(data.q, x))[:, :3, 3], axis=1).mean()
    far = np.linalg.norm((arm.pose(data.q, blind.x) - arm.pose(data.q, x))[:, :3, 3], axis=1).mean()
    assert near < 0.1 * far
    assert found.misfit[0] < 0.02


def test_full_poses(rng):
    arm = ParametricArm.of(load_robot("kuka-kr210-r2700-extra"), TOOL, outputs="pose")
    x = 0.5 * arm.tolerance * rng.normal(size=len(arm.parameters))
    q = draw(arm.model.robot, 60, rng)
    tf = arm.pose(q, x)
    tf[:, :3, :3] = Rotation.from_rotvec(1e-5 * rng.normal(size=(60, 3))).as_matrix() @ tf[:, :3, :3]
    tf[:, :3, 3] += NOISE * rng.normal(size=(60, 3))
    data = PoseObservations(q, tf, np.zeros((60, 6, 6)))
    assert observability(data.jacobian(arm, 0 * x), arm.names).rank == 30
    found = least_squares(arm, data, arm.tolerance)
    np.testing.assert_allclose(found.misfit, [NOISE, 1e-5], rtol=0.15)
    ukf, _ = filtered(arm, data, kind="ukf")
    std = np.sqrt(np.diag(found.covariance))
    assert np.abs((ukf.x - found.x) / std).max() < 1.0
    targets = draw(arm.model.robot, 100, rng)
    assert np.abs((arm.pose(targets, found.x) - arm.pose(targets, x))[:, :3, 3]).max() < 4 * NOISE


def test_distances_only(arm, rng):
    x, data = simulate(arm, 60, rng)
    pairs = np.column_stack([rng.permutation(60) for _ in range(8)]).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    true = arm.pose(data.q, x)[:, :3, 3]
    distance = np.linalg.norm(true[pairs[:, 0]] - true[pairs[:, 1]], axis=1) + NOISE * rng.normal(size=len(pairs))
    lengths = Distances(data.q, pairs, distance, np.zeros((len(pairs), 1, 1)))
    seen = observability(lengths.jacobian(arm, 0 * x), arm.names)
    assert seen.rank == 21  # the station's six are not there
    assert {"base x", "base rz"} <= {name for name, others in seen.apart.items() if not others}
    found = least_squares(arm, lengths, arm.tolerance)
    targets = draw(arm.model.robot, 30, rng)

    def between(y):
        p = arm.pose(targets, y)[:, :3, 3]
        return np.linalg.norm(p[1:] - p[:-1], axis=1)

    before, after = (np.abs(between(y) - between(x)).mean() for y in (0 * x, found.x))
    assert after < 0.15 * before


def test_a_campaign_watched_as_it_goes(arm, case):
    x, data = case
    watched = KalmanFilter(arm)
    targets = draw(arm.model.robot, 50, np.random.default_rng(1))
    errors, spread = [], []
    for part in (slice(0, 10), slice(10, 30), slice(30, 80)):
        watched.update(Positions(data.q[part], data.p[part], data.covariance[part]), np.array([NOISE]))
        errors.append(np.linalg.norm((arm.pose(targets, watched.x) - arm.pose(targets, x))[:, :3, 3], axis=1).mean())
        spread.append(np.trace(watched.covariance / np.outer(arm.tolerance, arm.tolerance)))
    assert watched.n == 80
    assert errors[2] < 0.3 * errors[0]
    assert spread[0] > spread[1] > spread[2]
    once = KalmanFilter(arm)
    once.update(data, np.array([NOISE]))
    np.testing.assert_allclose(once.x, watched.x, rtol=1e-9)


def test_inseparable_parameters_are_listed(rng):
    robot = load_robot("kuka-kr150-2")
    arm = ParametricArm.of(robot, TOOL)
    _, data = simulate(arm, 60, rng)
    seen = observability(data.jacobian(arm, np.zeros(len(arm.parameters))), arm.names, arm.tolerance)
    assert seen.rank == 27
    assert seen.apart["theta1"] == ("base rz",)
    assert "d3" in seen.apart["d2"]
    assert "theta3" not in seen.apart
    found = least_squares(arm, data, free=minimal_subset(arm, data))
    rows = {row["parameter"]: row for row in parameter_table(arm, found, seen, prior=False)}
    assert rows["theta1"]["note"] == "not identifiable with base rz; kept"
    assert rows["theta1"]["change"] == 0.0
    assert rows["theta1"]["std"] is None
    assert rows["theta3"]["note"] == ""
    assert int(found.free.sum()) <= 27
    assert re.fullmatch(r"<Identification: 2\d of 39 parameters from 60 readings; misfit \S+ mm>", repr(found))
    assert repr(seen).startswith("<Observability: rank 27 of 39, condition number ")
    assert len(repr(seen)) < 400
    assert json.loads(json.dumps(seen.to_dict()))["rank"] == 27


def test_observability_indices_by_hand():
    columns = np.diag([4.0, 2.0, 1.0])[None]
    seen = observability(columns, ["a", "b", "c"], np.ones(3))
    expected = {"O1": 2.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 1 / (1 + 1 / 2 + 1 / 4)}
    assert seen.indices == pytest.approx(expected)
    assert seen.condition == pytest.approx(1.0)  # of the scaled columns
    assert seen.rank == 3
    assert seen.apart == {}
    with pytest.raises(DataError, match="3 columns and 2 names"):
        observability(columns, ["a", "b"])


def test_inseparable_parameters_are_an_error_without_tolerances(arm, case):
    with pytest.raises(IdentifiabilityError, match=r"rank 27 of 39 .*theta1 with base rz.*use tolerances"):
        least_squares(arm, case[1])


def test_poses_to_add_tell_more(arm, rng):
    q = np.tile(draw(arm.model.robot, 1, rng), (30, 1)) + rng.normal(scale=1e-3, size=(30, 6))
    added = poses_to_add(arm, q, count=8)
    assert (arm.model.robot.within_limits(added)).all()
    zero = np.zeros(len(arm.parameters))
    few = observability(arm.jacobian(q, zero), arm.names, arm.tolerance).indices
    more = observability(arm.jacobian(np.concatenate([q, added]), zero), arm.names, arm.tolerance).indices
    assert more["O5"] > 10 * few["O5"]


def test_compliance_is_found(rng):
    """A heavy payload bends joints; identified compliances are those of the simulated arm."""
    robot = load_robot("kuka-kr210-r2700-extra")
    load = Load(210.0, np.array([0.0, 0.0, 250.0]))
    arm = ParametricArm.of(robot, TOOL, terms=["compliance"], load=load)
    x = np.zeros(len(arm.parameters))
    true = np.array([5e-7, 5e-7, 5e-7, 2e-6, 2e-6, 2e-6])
    x[-6:] = true
    q = draw(robot, 150, rng)
    p = arm.pose(q, x)[:, :3, 3] + 0.02 * rng.normal(size=(150, 3))
    found = least_squares(arm, Positions(q, p, np.zeros((150, 3, 3))), arm.tolerance)
    std = np.sqrt(np.diag(found.covariance))[-6:]
    assert (np.abs(found.x[-6:] - true) < 4 * std)[1:].all()
    assert (std[1:3] < 2e-7).all()


def test_standard_and_modified_parameters_predict_the_same(rng):
    robot = load_robot("universal-robots-ur10")
    true = to_mdh(robot)
    true = replace(true, a=true.a + rng.normal(scale=0.3, size=6), offset=true.offset + rng.normal(scale=3e-4, size=6))
    q, targets = draw(robot, 80, rng), draw(robot, 40, rng)
    p = true.forward(q, TOOL)[:, :3, 3] + NOISE * rng.normal(size=(80, 3))
    for convention in ("hayati", "dh", "cpc", "mcpc", "poe"):
        arm = ParametricArm.of(robot, TOOL, convention=convention)
        found = least_squares(arm, Positions(q, p, np.zeros((80, 3, 3))), arm.tolerance)
        miss = (arm.pose(targets, found.x) - true.forward(targets, TOOL))[:, :3, 3]
        assert np.linalg.norm(miss, axis=1).mean() < NOISE, convention
