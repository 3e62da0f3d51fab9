"""Kinematic Kriging (10): its two solvers, its gradients, its closed forms, and what it is for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from truepose.errors import DataError, KrigingError
from truepose.predictors.kinematic import KinematicKriging, kriging
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.basis_form import BasisForm, BasisSums, gradient_by_hyper, negative_log_likelihood
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.terms import Terms
from truepose.predictors.kinematic.weights import robust_weights
from truepose.robots import load_robot

ROBOT = load_robot("kuka-kr210-r2700-extra")
TOOL = np.array([[1.0, 0, 0, 110], [0, 1, 0, 20], [0, 0, 1, 360], [0, 0, 0, 1]])
HOME = np.deg2rad([0, -75, 95, 10, 50, 20])


def true_curve(j: int, angle):
    """The error of joint j over its own angle [rad]: two gears' harmonics."""
    return 2e-4 * np.sin(7 * angle + j) + 1e-4 * np.cos(11 * angle - 2 * j)


def true_errors(q, tool=TOOL):
    """Errors of position [mm] and orientation [rad], both from the geometry and the gears, (n, 6)."""
    rng = np.random.default_rng(7)
    real = replace(
        ROBOT,
        a=ROBOT.a + rng.normal(scale=0.3, size=6),
        alpha=ROBOT.alpha + rng.normal(scale=3e-4, size=6),
        offset=ROBOT.offset + rng.normal(scale=3e-4, size=6),
    )
    turned = real.forward(q + np.stack([true_curve(j, q[:, j]) for j in range(6)], axis=1), tool=tool)
    nominal = ROBOT.forward(q, tool=tool)
    w = Rotation.from_matrix(turned[:, :3, :3] @ np.swapaxes(nominal[:, :3, :3], 1, 2)).as_rotvec()
    return np.concatenate([turned[:, :3, 3] - nominal[:, :3, 3], w], axis=1)


def simulate(n: int, rng, noise=0.01):
    """Configurations about home, and errors of geometry and joints with normal noise [mm]."""
    q = HOME + rng.uniform(-1, 1, size=(n, 6)) * np.deg2rad([40, 25, 25, 60, 40, 90])
    e = true_errors(q)[:, :3]
    return q, e + rng.normal(scale=noise, size=e.shape)


@pytest.fixture(scope="module")
def fitted():
    q, e = simulate(120, np.random.default_rng(0))
    return q, e, KinematicKriging(ROBOT, TOOL).fit(q, e)


def hyper(joints=6, ranges=6) -> Hyperparameters:
    start = Hyperparameters.start(joints, ranges, noise=0.02)
    theta = start.to_vector() + np.linspace(-0.4, 0.4, len(start.to_vector()))
    return start.with_vector(theta)


def test_held_out_errors_fall_to_the_noise(fitted):
    _, _, model = fitted
    q, e = simulate(200, np.random.default_rng(1))
    predicted, std = model.predict(q, return_std=True, include_nugget=True)
    length = np.linalg.norm(e - predicted, axis=1).mean()
    without = KinematicKriging(ROBOT, TOOL, joint_errors=False, residual="none").fit(
        *simulate(120, np.random.default_rng(0))
    )
    geometry_only = np.linalg.norm(e - without.predict(q), axis=1).mean()
    assert np.linalg.norm(e, axis=1).mean() > 0.3
    assert length < 0.5 * geometry_only
    standardised = (e - predicted) / std
    assert np.mean(np.abs(standardised) < 1.96) == pytest.approx(0.95, abs=0.04)


def test_joint_curves_are_the_gears(fitted):
    """The true curve, less what geometry and Z share with it (mean and first harmonic), lies in the 95 % band."""
    _, _, model = fitted
    inside = []
    for curve in model.joint_curves(61)[:3]:
        slow = np.stack([np.ones(61), np.cos(curve.angle), np.sin(curve.angle)], axis=1)
        both = [
            y - slow @ np.linalg.lstsq(slow, y, rcond=None)[0]
            for y in (true_curve(curve.joint, curve.angle), curve.error)
        ]
        inside.append(np.abs(both[0] - both[1]) < 1.96 * curve.std)
    assert np.mean(inside) > 0.9


def test_orientation_is_predicted_from_positions(fitted):
    """Most of the arm's orientation error is in its geometry and its joints; positions are predicted as before."""
    _, _, model = fitted
    q, _ = simulate(100, np.random.default_rng(2))
    true = true_errors(q)
    error, std = model.predict_pose(q, return_std=True)
    expected, expected_std = model.predict(q, return_std=True)
    np.testing.assert_allclose(error[:, :3], expected, atol=1e-12)
    # a variance is that of the prior less a sum of as many squares as there are readings, each rounded
    form = model._form
    rounding = np.finfo(float).eps * len(form.alpha) * form.prior_covariance(model._terms.at(q)).max()
    np.testing.assert_allclose(std[:, :3] ** 2, expected_std**2, rtol=0, atol=rounding)
    before, after = (np.linalg.norm(w, axis=1).mean() for w in (true[:, 3:], (true - error)[:, 3:]))
    assert before > 0.5e-3
    assert after < 0.25 * before
    assert np.mean(np.abs((true - error) / std)[:, 3:] < 1.96) > 0.93  # a turn of the last frame is known by its prior


def test_errors_at_another_point_of_the_tool(fitted):
    """As a model of that point would have it; better than taking the sampled point's error for it."""
    _, _, model = fitted
    q, _ = simulate(100, np.random.default_rng(2))
    away = np.array([150.0, -200.0, 100.0])
    other = TOOL.copy()
    other[:3, 3] += away
    offset = ROBOT.forward(q, tool=TOOL)[:, :3, :3] @ away
    true = true_errors(q, other)
    error, std = model.predict_pose(q, return_std=True, offset=offset)
    np.testing.assert_allclose(model.predict_pose(q, offset=offset), error)
    miss = np.linalg.norm((true - error)[:, :3], axis=1).mean()
    assert miss < 0.3 * np.linalg.norm(true[:, :3] - model.predict(q), axis=1).mean()
    assert np.mean(np.abs((true - error) / std)[:, :3] < 1.96) > 0.93
    assert np.all(std[:, :3].mean(axis=0) > model.predict(q, return_std=True)[1].mean(axis=0))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("residual", ["joint", "none"])
def test_orientation_in_both_forms(residual):
    q, e = simulate(60, np.random.default_rng(3))
    terms = Terms(ROBOT, TOOL, residual=residual)
    design = terms.at(q)
    values, joints = hyper(6, 6 if residual == "joint" else 0), np.arange(6)
    noise = np.full((60, 3), 0.02**2)
    exact = CovarianceForm.of(terms, design, joints, values, e, noise)
    anchor = design if residual == "joint" else None
    basis = Basis.of(terms, joints, values, anchor, angles=q, knots=40.0, most=1000, negligible=1e-8)
    found = BasisForm.of(basis, design, values, e, noise)
    new = terms.at(simulate(10, np.random.default_rng(4))[0], "pose")
    covariance = exact.covariance(new)
    std = np.sqrt(np.einsum("maa->ma", covariance))
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    assert np.abs((exact.mean(new) - found.mean(new)) / std.mean(axis=0)).max() < 0.2
    np.testing.assert_allclose(np.sqrt(np.einsum("maa->ma", found.covariance(new))), std, rtol=0.2)
    np.testing.assert_allclose(sum(exact.contributions(new).values()), exact.mean(new), atol=1e-8)


def test_contributions_sum_to_the_prediction(fitted):
    q, _, model = fitted
    part = model.explain(q[:7])
    assert set(part) == {"registration", "geometry", "compliance", *(f"joint {j}" for j in range(1, 7)), "rest"}
    np.testing.assert_allclose(sum(part.values()), model.predict(q[:7]), atol=1e-10)


def test_leave_one_out_is_refitting(fitted):
    q, e, model = fitted
    found = model.leave_one_out()
    for i in (0, 50, 119):
        kept = np.arange(len(q)) != i
        form = CovarianceForm.of(
            model._terms, model._terms.at(q[kept]), model.joints_, model.hyper_,
            (e - model._terms.curvature(model._terms.at(q)))[kept], model._noise_variance()[kept],
        )  # fmt: skip
        one = model._terms.at(q[i : i + 1])
        expected = e[i] - (form.mean(one) + model._terms.curvature(one))[0]
        np.testing.assert_allclose(found.residual[i], expected, atol=1e-8)
        variance = np.diag(form.covariance(one)[0]) + model._noise_variance()[i]
        np.testing.assert_allclose(found.std[i], np.sqrt(model.inflation_ * variance), rtol=1e-7)


def test_leave_block_out_in_both_forms(fitted):
    q, e, model = fitted
    block = np.arange(len(q)) // 10
    noise = model._noise_variance()
    design = model._terms.at(q)
    target = e - model._terms.curvature(design)
    covariance = CovarianceForm.of(model._terms, design, model.joints_, model.hyper_, target, noise)
    kept = block != 3
    without = CovarianceForm.of(
        model._terms, model._terms.at(q[kept]), model.joints_, model.hyper_, target[kept], noise[kept]
    )
    residual, _ = covariance.left_out(block)
    np.testing.assert_allclose(residual[~kept], target[~kept] - without.mean(model._terms.at(q[~kept])), atol=1e-8)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("finer", "tolerance"),
    [({}, 0.15), ({"knots": 40.0, "most": 2000, "negligible": 1e-8}, 0.02)],
    ids=["used", "finer"],
)
@pytest.mark.parametrize("residual", ["joint", "none"])
def test_basis_form_tends_to_the_covariance_form(residual, finer, tolerance):
    """Largest difference of means, in mean predicted standard deviations, and of the latter in each direction."""
    q, e = simulate(60, np.random.default_rng(3))
    terms = Terms(ROBOT, TOOL, residual=residual)
    design = terms.at(q)
    values, joints = hyper(6, 6 if residual == "joint" else 0), np.arange(6)
    noise = np.full((60, 3), 0.02**2)
    exact = CovarianceForm.of(terms, design, joints, values, e, noise)
    anchor = design if residual == "joint" else None
    basis = Basis.of(terms, joints, values, anchor, angles=q, **finer)
    found = BasisForm.of(basis, design, values, e, noise)
    new = terms.at(simulate(30, np.random.default_rng(4))[0])
    std = np.sqrt(np.einsum("maa->ma", exact.covariance(new)))
    assert np.abs(exact.mean(new) - found.mean(new)).max() < tolerance * std.mean()
    ratio = np.sqrt(np.einsum("maa->ma", found.covariance(new))) / std
    np.testing.assert_allclose(ratio, 1.0, atol=tolerance)
    for block in (np.arange(60), np.arange(60) // 7):
        (left_out, spread), (left_out_basis, spread_basis) = (form.left_out(block) for form in (exact, found))
        assert np.linalg.norm(left_out - left_out_basis) < tolerance * np.linalg.norm(left_out)
        np.testing.assert_allclose(spread_basis, spread, atol=2 * tolerance * np.abs(spread).max())


@pytest.mark.parametrize("size", [1, 4, 40], ids=["single", "short", "longer than the columns"])
def test_leave_block_out_in_the_basis_is_a_fit_of_the_others(size):
    q, e = simulate(80, np.random.default_rng(8))
    terms = Terms(ROBOT, TOOL, residual="none", compliance=False)
    values, noise = hyper(2, 0), np.random.default_rng(1).uniform(0.01, 0.03, (80, 3)) ** 2
    basis = Basis.of(terms, np.array([0, 2]), values, None, angles=q, most=12)
    form = BasisForm.of(basis, terms.at(q), values, e, noise)
    residual, covariance = form.left_out(np.arange(80) // size)
    out = np.arange(80) // size == 1
    others = BasisForm.of(basis, terms.at(q[~out]), values, e[~out], noise[~out])
    np.testing.assert_allclose(residual[out], e[out] - others.mean(terms.at(q[out])), atol=1e-9)
    columns = basis.columns(terms.at(q[out])).reshape(size, 3, -1) @ others.root
    np.testing.assert_allclose(covariance[out], columns @ np.swapaxes(columns, 1, 2) + form.noise[out], rtol=1e-7)


def central(function, theta, h=1e-5):
    out = np.empty_like(theta)
    for k in range(len(theta)):
        step = np.zeros_like(theta)
        step[k] = h
        out[k] = (
            8 * (function(theta + step) - function(theta - step))
            - (function(theta + 2 * step) - function(theta - 2 * step))
        ) / (12 * h)
    return out


@pytest.mark.parametrize("residual", ["joint", "cartesian", "both", "none"])
def test_gradient_of_the_likelihood(residual):
    q, e = simulate(15, np.random.default_rng(5))
    terms = Terms(ROBOT, TOOL, residual=residual)
    weight = np.linspace(0.3, 1.0, 15)
    likelihood = Likelihood(terms, terms.at(q), np.array([0, 2, 5]), e, np.full((15, 3), 0.01), weight)
    values = hyper(3, len(terms.range_names))
    numeric = central(lambda theta: likelihood(values.with_vector(theta))[0], values.to_vector(), h=1e-3)
    np.testing.assert_allclose(likelihood(values)[1], numeric, rtol=1e-5, atol=1e-4)  # rounding of wide priors


def test_gradient_of_the_likelihood_in_the_basis():
    q, e = simulate(30, np.random.default_rng(6))
    terms = Terms(ROBOT, TOOL)
    design, joints = terms.at(q), np.array([0, 2])
    values = hyper(2, 6)
    basis = Basis.of(terms, joints, values, design)
    sums = BasisSums.of(basis, design, values, e, np.full((30, 3), values.noise**2))

    def value(theta):
        other = values.with_vector(theta)
        return negative_log_likelihood(basis, sums, other, (other.noise / values.noise) ** 2)[0]

    _, by_variance, by_scale = negative_log_likelihood(basis, sums, values, 1.0)
    found = gradient_by_hyper(basis, values, by_variance, by_scale)
    numeric = central(value, values.to_vector(), h=1e-3)
    free = np.r_[0, 1, 4:8]  # lengths and ranges are the basis's own
    np.testing.assert_allclose(found[free], numeric[free], rtol=1e-5, atol=1e-5)
    assert not found[np.r_[2, 3, 8:14]].any()


@pytest.mark.promise("the log-likelihood of kinematic Kriging is the normal density of the errors, in both solvers")
@pytest.mark.parametrize("residual", ["joint", "none"])
def test_the_log_likelihood_is_the_normal_density(residual):
    q, e = simulate(12, np.random.default_rng(11))
    terms = Terms(ROBOT, TOOL, residual=residual)
    design, joints, values = terms.at(q), np.array([0, 2, 5]), hyper(3, len(terms.range_names))
    noise = np.full((12, 3), 0.01) ** 2 + values.noise**2
    form = CovarianceForm.of(terms, design, joints, values, e, noise)
    covariance = form.factor @ form.factor.T
    expected = multivariate_normal(cov=covariance).logpdf(e.reshape(-1))
    likelihood = Likelihood(terms, design, joints, e, np.full((12, 3), 0.01), np.ones(12))
    rounding = 1e-15 * np.linalg.cond(covariance) * abs(expected)
    assert -likelihood(values)[0] - likelihood.constant == pytest.approx(expected, abs=rounding)
    basis = Basis.of(terms, joints, values, design if terms.range_names else None, angles=q, knots=30, negligible=1e-12)
    sums = BasisSums.of(basis, design, values, e, noise)
    in_basis = -negative_log_likelihood(basis, sums, values, 1.0)[0] - sums.constant
    assert in_basis == pytest.approx(expected, abs=0.1)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("n", "solver"), [(400, "covariance"), (1100, "basis")])
def test_the_solver_is_chosen_by_size_and_told(n, solver):
    q, e = simulate(n + 50, np.random.default_rng(8))
    model = KinematicKriging(ROBOT, TOOL, robust=False, residual="none").fit(q[:n], e[:n])
    assert model.solver_ == solver
    assert np.linalg.norm(model.predict(q[n:]) - e[n:], axis=1).mean() < 0.03


def test_gross_readings_are_named_and_do_no_harm():
    q, e = simulate(120, np.random.default_rng(9))
    new, true = simulate(100, np.random.default_rng(10))
    clean = np.linalg.norm(KinematicKriging(ROBOT, TOOL).fit(q, e).predict(new) - true, axis=1).mean()
    rng = np.random.default_rng(11)
    rows = np.array([13, 77])
    direction = rng.normal(size=(2, 3))
    e[rows] += direction / np.linalg.norm(direction, axis=1)[:, None] * [[1.0], [5.0]]
    model = KinematicKriging(ROBOT, TOOL).fit(q, e)
    assert model.gross_.tolist() == [13, 77]
    assert np.linalg.norm(model.predict(new) - true, axis=1).mean() < 1.1 * clean


def test_a_joint_that_never_moves_is_left_out_and_named():
    q, _ = simulate(60, np.random.default_rng(12))
    q[:, 3] = 0.2
    e = np.random.default_rng(0).normal(scale=0.1, size=(60, 3))
    model = KinematicKriging(ROBOT, TOOL, residual="none").fit(q, e)
    assert model.unseen_ == [3]


def test_pinned_copy_predicts_the_same(fitted):
    q, e, model = fitted
    again = KinematicKriging.from_dict({**model.to_dict(), "robot": ROBOT, "tf_flange_tool": TOOL}).fit(q, e)
    new = simulate(20, np.random.default_rng(13))[0]
    for a, b in zip(again.predict(new, return_std=True), model.predict(new, return_std=True), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_a_far_branch_is_known_to_be_unknown(fitted):
    """Asked where the arm never was, the standard deviation rises."""
    q, _, model = fitted
    far = q[:20] + np.deg2rad([0, 0, 0, 180, -100, 180])
    near_std = model.predict(q[:20], return_std=True)[1].mean()
    assert model.predict(far, return_std=True)[1].mean() > 3 * near_std


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"robot": None}, KrigingError, "needs the nominal robot"),
        ({"solver": "magic"}, DataError, 'expected "auto", "covariance" or "basis"'),
        ({"residual": "polar"}, DataError, "residual is 'polar'"),
        ({"weight": [1.0]}, DataError, "expected 60 weights, one for each sample, got 1"),
    ],
)
def test_wrong_options(options, error, message):
    q, e = simulate(60, np.random.default_rng(0))
    with pytest.raises(error, match=message):
        KinematicKriging(**{"robot": ROBOT, **options}).fit(q, e)


def test_too_few_samples():
    q, e = simulate(5, np.random.default_rng(0))
    with pytest.raises(KrigingError, match="5 samples are too few"):
        KinematicKriging(ROBOT).fit(q, e)


@pytest.mark.exhaustive
def test_measured_ur10(ur10):
    """The figures of the data's README: 150 samples leave at most 0.14 mm in the mean on the others."""
    from truepose.geometry import register_with_tool
    from truepose.samples import read_samples

    robot = load_robot("universal-robots-ur10")
    samples = read_samples(ur10 / "samples.csv")
    order = np.random.default_rng(0).permutation(len(samples))
    fit, test = order[:150], order[150:]
    registration = register_with_tool(robot.forward(samples.q[fit]), samples.p_meas[fit])
    tool = np.eye(4)
    tool[:3, 3] = registration.p_flange_tool
    e = registration.apply(samples.p_meas) - robot.forward(samples.q, tool=tool)[:, :3, 3]
    model = KinematicKriging(robot, tool).fit(samples.q[fit], e[fit])
    predicted, std = model.predict(samples.q[test], return_std=True, include_nugget=True)
    assert np.linalg.norm(e[test] - predicted, axis=1).mean() < 0.14
    assert 0.9 < np.mean(np.abs((e[test] - predicted) / std) < 1.96) < 0.98


@pytest.mark.sampled(1)
@pytest.mark.parametrize("solver", ["covariance", "basis"])
def test_update_is_a_fit_of_all_samples_with_the_same_hyperparameters(solver):
    q, e = simulate(120, np.random.default_rng(20))
    e[-3] += [0.0, 2.0, 0.0]
    model = KinematicKriging(ROBOT, TOOL, solver=solver).fit(q[:90], e[:90], noise_std=0.01)
    hyper_before = model.hyper_
    assert model.update(q[90:], e[90:], noise_std=0.01) is model
    assert model.hyper_ is hyper_before
    assert model.gross_.tolist() == [117]
    again = model.with_fitted_parameters().fit(q, e, noise_std=0.01)
    new = simulate(20, np.random.default_rng(21))[0]
    for a, b in zip(model.predict(new, return_std=True), again.predict(new, return_std=True), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(model.leave_one_out().residual, again.leave_one_out().residual, atol=1e-9)


@pytest.mark.parametrize("robust", [True, False])
def test_an_update_keeps_the_old_weights(robust):
    """Those of the samples of a fit with given hyperparameters: some of no gross reading, one of a gross one."""
    q, e = simulate(100, np.random.default_rng(22))
    e[70] += [0.0, 0.0, 2.0]
    old = np.where(np.arange(60) % 3 == 0, 0.7, 1.0)
    old[5], old[7], old[8] = 0.02, 0.1, 0.099  # a weight of 0.1 is not yet one of a gross reading
    model = KinematicKriging(ROBOT, TOOL, robust=robust, hyper=hyper().to_dict(), weight=old).fit(q[:60], e[:60])
    assert model.gross_.tolist() == [5, 8]
    assert model.update(q[60:], e[60:]) is model
    np.testing.assert_array_equal(model.weight_[:60], old)
    fresh = model.weight_[60:]
    assert model.gross_.tolist() == ([5, 8, 70] if robust else [5, 8])
    assert (fresh[10] < 0.1 and np.sum(fresh < 1.0) < 5) if robust else (fresh == 1.0).all()
    again = KinematicKriging(ROBOT, TOOL, hyper=hyper().to_dict(), weight=model.weight_).fit(q, e)
    np.testing.assert_allclose(model.predict(q), again.predict(q), rtol=1e-9, atol=1e-12)
    assert [row["name"] for row in model.parameters_] == [row["name"] for row in again.parameters_]
    estimates = [[row["estimate"] for row in one.parameters_] for one in (model, again)]
    np.testing.assert_allclose(*estimates, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("off", "rounds"), [(0.0, {1}), (2.0, {2, 3})])
def test_robust_weights_of_an_update_end_when_they_settle(off, rounds, monkeypatch):
    """At once without a gross reading; else when its weight no longer changes."""
    q, e = simulate(80, np.random.default_rng(23))
    e[70] += [0.0, 0.0, off]
    model = KinematicKriging(ROBOT, TOOL, hyper=hyper().to_dict()).fit(q[:60], e[:60])
    counted = []

    def count(residual, covariance):
        counted.append(len(residual))
        return robust_weights(residual, covariance)

    monkeypatch.setattr(kriging, "robust_weights", count)
    model.update(q[60:], e[60:])
    assert len(counted) in rounds
    assert set(counted) == {80}


def test_update_says_what_does_not_fit(fitted):
    q, e, model = fitted
    with pytest.raises(DataError, match=r"new samples \(2, 5\), \(2, 3\): expected \(m, 6\) joints"):
        model.update(q[:2, :5], e[:2])
    with pytest.raises(DataError, match=r"new samples \(2, 6\), \(2, 6\): expected \(m, 6\) joints, \(m, 3\) errors"):
        model.update(q[:2], np.zeros((2, 6)))
    with pytest.raises(DataError, match="pass noise_std to update if and only if"):
        model.update(q[:2], e[:2], noise_std=0.1)


@pytest.mark.parametrize("solver", ["covariance", "basis"])
def test_errors_predicted_together(solver):
    q, e = simulate(80, np.random.default_rng(22))
    model = KinematicKriging(ROBOT, TOOL, solver=solver).fit(q, e)
    new = simulate(7, np.random.default_rng(23))[0]
    mean, covariance = model.predict_together(new)
    np.testing.assert_allclose(mean, model.predict(new), atol=1e-12)
    own = np.einsum("iaib->iab", covariance.reshape(7, 3, 7, 3))
    np.testing.assert_allclose(own, model.predict_covariance(new)[1], atol=1e-10)
    assert np.linalg.eigvalsh(covariance).min() > 0
