"""Conditions of a pose in kinematic Kriging: the direction of approach."""

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.numerics.frozen import predict, scratch
from truepose.numerics.frozen_deviation import deviations
from truepose.planning.prior import Prior
from truepose.predictors.conditions import joined, separated
from truepose.predictors.kinematic import KinematicKriging
from truepose.robots import load_robot

ROBOT = load_robot("kuka-kr210-r2700-extra")
TOOL = np.array([[1.0, 0, 0, 110], [0, 1, 0, 20], [0, 0, 1, 360], [0, 0, 0, 1]])
HOME = np.deg2rad([0, -75, 95, 10, 50, 20])
LAG = np.array([3e-4, -2e-4, 1e-4, 3e-4, 2e-4, 0.0])  # rad, by the direction of approach


def simulate(n, seed, noise=0.01):
    """Configurations, directions of approach, and errors of one link and of backlash [mm]."""
    rng = np.random.default_rng(seed)
    q = HOME + rng.uniform(-1, 1, size=(n, 6)) * np.deg2rad([40, 25, 25, 60, 40, 90])
    signs = rng.choice([-1.0, 1.0], size=q.shape)
    link = 0.3 * ROBOT.error_jacobian(q, tool=TOOL, parameters=["a3"])[:, :, 0]
    reached, nominal = (ROBOT.forward(joints, tool=TOOL)[:, :3, 3] for joints in (q + LAG * signs, q))
    return q, signs, link + reached - nominal + rng.normal(scale=noise, size=link.shape)


def reversing(q, signs):
    return joined(q, ["approach"], {"approach": signs})


@pytest.fixture(scope="module", params=["covariance", "basis"])
def fitted(request):
    q, signs, e = simulate(80, 0)
    return KinematicKriging(ROBOT, TOOL, conditions=("approach",), solver=request.param).fit(reversing(q, signs), e)


def test_backlash_of_each_joint_is_found(fitted):
    rows = [row for row in fitted.parameters_ if row["group"] == "backlash"]
    assert [row["name"] for row in rows] == [f"backlash q{j + 1}" for j in range(6)]
    for row, lag in zip(rows, LAG, strict=True):
        assert abs(row["estimate"] - lag) < 4 * row["std"]
    assert max(row["std"] for row in rows[:5]) < 2e-5


def test_a_known_direction_is_predicted(fitted):
    q, signs, e = simulate(100, 1, noise=0.0)
    left = np.linalg.norm(fitted.predict(reversing(q, signs)) - e, axis=1)
    opposite = np.linalg.norm(fitted.predict(reversing(q, -signs)) - e, axis=1)
    assert left.mean() < 0.03
    assert opposite.mean() > 10 * left.mean()


@pytest.mark.parametrize("unknown", ["no columns", "not a number", "zero"])
@pytest.mark.sampled(1)
def test_an_unknown_direction_is_the_mean_of_both_with_their_difference_in_the_deviation(fitted, unknown):
    q = simulate(20, 2)[0]
    x = {"no columns": q, "not a number": reversing(q, np.full_like(q, np.nan)), "zero": reversing(q, 0 * q)}[unknown]
    mean, std = fitted.predict(x, return_std=True)
    rng = np.random.default_rng(3)
    drawn = np.array([fitted.predict(reversing(q, rng.choice([-1.0, 1.0], size=q.shape))) for _ in range(400)])
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=0.15)
    known = fitted.predict(reversing(q, np.ones_like(q)), return_std=True)[1]
    np.testing.assert_allclose(np.sqrt(known**2 + drawn.var(axis=0)), std, rtol=0.15)


def test_the_covariance_of_an_unknown_direction_agrees_with_its_deviation(fitted):
    q = simulate(5, 4)[0]
    _, covariance = fitted.predict_covariance(q)
    np.testing.assert_allclose(np.sqrt(np.einsum("naa->na", covariance)), fitted.predict(q, return_std=True)[1])


def test_a_plan_after_a_map_with_conditions_is_made_without_them(fitted):
    q = simulate(20, 6)[0]
    std = np.sqrt(np.einsum("naa->n", Prior.after(fitted, simulate(80, 0)[0], q).covariance(q)))
    known = fitted.predict(reversing(q, np.ones_like(q)), return_std=True)[1] / np.sqrt(fitted.inflation_)
    assert 0.6 < std.mean() / np.linalg.norm(known, axis=1).mean() < 1.2


def test_contributions_sum_to_the_prediction(fitted):
    q, signs, _ = simulate(10, 5)
    x = reversing(q, signs)
    parts = fitted.explain(x)
    assert np.abs(parts["backlash"]).max() > 0.1
    np.testing.assert_allclose(sum(parts.values()), fitted.predict(x), atol=1e-9)


def test_another_tool_point_lags_with_its_own_lever(fitted):
    q, signs, _ = simulate(10, 6)
    offset = np.tile([0.0, 0.0, 200.0], (len(q), 1))
    pose, std = fitted.predict_pose(q, return_std=True, offset=offset)
    known, known_std = fitted.predict_pose(reversing(q, signs), return_std=True, offset=offset)
    assert np.abs(known - pose)[:, :3].max() > 0.1
    assert (std >= known_std).all()
    assert (std > 1.5 * known_std)[:, :3].any()


def test_backlash_that_is_not_there_is_left_out():
    q, signs, _ = simulate(80, 0)
    rng = np.random.default_rng(1)
    e = 0.3 * ROBOT.error_jacobian(q, tool=TOOL, parameters=["a3"])[:, :, 0] + rng.normal(scale=0.01, size=(80, 3))
    model = KinematicKriging(ROBOT, TOOL, conditions=("approach",)).fit(reversing(q, signs), e)
    np.testing.assert_allclose(model.predict(reversing(q, signs)), model.predict(q), atol=2e-3)
    plain = KinematicKriging(ROBOT, TOOL).fit(q, e)
    unknown, std = (one.predict(q, return_std=True)[1] for one in (model, plain))
    np.testing.assert_allclose(unknown, std, rtol=0.1)


def test_new_samples_update_a_model_with_directions():
    q, signs, e = simulate(60, 0)
    x = reversing(q, signs)
    model = KinematicKriging(ROBOT, TOOL, conditions=("approach",)).fit(x[:40], e[:40])
    again = model.with_fitted_parameters().fit(x[:40], e[:40])
    np.testing.assert_allclose(again.predict(x[40:]), model.predict(x[40:]), atol=1e-6)
    model.update(x[40:], e[40:])
    assert model.points_.shape == (60, 12)


def test_the_frozen_deviation_covers_an_unknown_direction(fitted):
    q = simulate(30, 7)[0]
    constants = fitted.constants()
    bound = fitted.deviation(constants, q, np.zeros(3))
    mean, std = fitted.predict(q, return_std=True)
    e = np.empty((len(q), 3))
    assert predict(q, e, constants, scratch(constants)) == 0
    np.testing.assert_allclose(e, mean, atol=1e-3)
    assert (deviations(q, constants, bound) >= 0.999 * std).all()


@pytest.mark.parametrize(
    ("columns", "part"),
    [
        (np.zeros((3, 7)), "7 columns; expected 6 joints"),
        (np.c_[np.zeros((3, 6)), np.full((3, 6), 0.5)], "in row 0; expected -1, 0 or 1"),
        (np.c_[np.zeros((3, 6)), np.full((3, 6), np.inf)], "expected -1, 0 or 1"),
    ],
)
def test_wrong_columns_are_named(columns, part):
    with pytest.raises(DataError, match=part):
        separated(columns, ["approach"], 6)


def test_an_unknown_condition_is_named():
    q, _, e = simulate(10, 0)
    with pytest.raises(DataError, match="condition 'wind' is unknown; expected one of: approach"):
        KinematicKriging(ROBOT, TOOL, conditions=("wind",)).fit(q, e)


def uneven(n, seed, noise=0.01, share=0.5):
    """As `simulate`, with a lost motion of joints 1 to 3 that varies once around by a share of it."""
    rng = np.random.default_rng(seed)
    q = HOME + rng.uniform(-1, 1, size=(n, 6)) * np.deg2rad([90, 40, 40, 60, 40, 90])
    signs = rng.choice([-1.0, 1.0], size=q.shape)
    lag = LAG * (1.0 + share * np.sin(q) * (np.arange(6) < 3))
    reached, nominal = (ROBOT.forward(joints, tool=TOOL)[:, :3, 3] for joints in (q + lag * signs, q))
    return q, signs, reached - nominal + rng.normal(scale=noise, size=(n, 3))


@pytest.mark.parametrize("solver", ["covariance", "basis"])
@pytest.mark.exhaustive
def test_backlash_may_vary_with_the_angle(solver):
    """Taken where it varies; left out, with the same predictions, where it does not."""
    left, taken = {}, {}
    for share in (0.5, 0.0):
        q, signs, e = uneven(120, 5, share=share)
        q_new, signs_new, e_new = uneven(100, 6, noise=0.0, share=share)
        for shaped in (False, True):
            options = {} if shaped else {"backlash_shape": False}
            model = KinematicKriging(ROBOT, TOOL, conditions=("approach",), solver=solver, **options)
            model.fit(reversing(q, signs), e, 0.01)
            miss = np.linalg.norm(model.predict(reversing(q_new, signs_new)) - e_new, axis=1)
            left[share, shaped] = miss.mean()
            rows = [row for row in model.parameters_ if row["group"] == "backlash shape"]
            assert len(rows) == 24 * shaped
            taken[share, shaped] = max((abs(row["estimate"]) for row in rows), default=0.0) > 1e-5
    assert taken == {(0.5, False): False, (0.5, True): True, (0.0, False): False, (0.0, True): False}
    assert left[0.5, True] < 0.7 * left[0.5, False]
    assert left[0.0, True] < 1.05 * left[0.0, False]


def test_an_unknown_side_counts_the_largest_shape():
    """The deviation where the side is not known includes the shape, in the frozen form as a bound from above."""
    q, signs, e = uneven(100, 7)
    model = KinematicKriging(ROBOT, TOOL, conditions=("approach",)).fit(reversing(q, signs), e, 0.01)
    new = uneven(50, 8)[0]
    _, std = model.predict(new, return_std=True)
    constants = model.constants()
    assert (deviations(new, constants, model.deviation(constants, new, np.zeros(3))) >= 0.999 * std).all()
    known = model.predict(reversing(new, np.ones_like(new)), return_std=True)[1]
    assert (np.linalg.norm(std, axis=1) > np.linalg.norm(known, axis=1)).all()


@pytest.mark.exhaustive
def test_an_offset_that_moves_is_followed():
    """Joint 2 moves by 0.3 mrad while 120 poses are measured; predictions are for its mean, and say how far it went."""
    rng = np.random.default_rng(3)
    q, time = simulate(120, 3)[0], np.linspace(0.0, 3600.0, 120)
    q_new, middle = simulate(80, 4)[0], np.zeros(80)

    def errors(q, share):
        moved = q.copy()
        moved[:, 1] += 3e-4 * (share - 0.5)
        reached, nominal = (ROBOT.forward(joints, tool=TOOL)[:, :3, 3] for joints in (moved, q))
        return reached - nominal + 0.3 * ROBOT.error_jacobian(q, tool=TOOL, parameters=["a3"])[:, :, 0]

    e = errors(q, time / 3600.0) + rng.normal(scale=0.01, size=(120, 3))
    known = KinematicKriging(ROBOT, TOOL, conditions=("time",)).fit(joined(q, ["time"], {"time": time}), e, 0.01)
    unknown = KinematicKriging(ROBOT, TOOL).fit(q, e, 0.01)
    truth = errors(q_new, 0.5 + middle)
    left = [np.linalg.norm(one.predict(q_new) - truth, axis=1).mean() for one in (known, unknown)]
    assert left[0] < 0.02
    assert left[0] < left[1]
    walk = sum(row["estimate"] for row in known.parameters_ if row["name"].startswith("offset q2"))
    assert walk == pytest.approx(3e-4, rel=0.15)
    mean, std = known.predict(q_new, return_std=True)
    end = errors(q_new, 1.0 + middle)
    assert np.mean(np.abs(mean - end) < 2.0 * std) > 0.9
