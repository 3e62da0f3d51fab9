import sys

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.metrics import r2_score

from truepose.errors import DataError, TrueposeError
from truepose.predictors import (
    InverseDistance,
    KinematicCalibration,
    KinematicKriging,
    LocalKriging,
    RegistrationOnly,
    ResidualNetwork,
)
from truepose.robots import load_robot
from truepose.similarity import VariogramModel

ROBOT = load_robot("kuka-kr150-2")
MODEL = VariogramModel("matern52", nugget=0.01, sill=1.0, range=1.0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "model",
    [
        RegistrationOnly(),
        InverseDistance(),
        LocalKriging(12, MODEL),
        KinematicCalibration(ROBOT),
        ResidualNetwork(ROBOT, hidden=4),
    ],
    ids=lambda model: type(model).__name__,
)
def test_blocks_left_out_are_refitted_without_what_they_told(model, rng):
    """Of a block, nothing is known: other errors of its samples do not change what is predicted there."""
    q = rng.uniform(-0.5, 0.5, (60, 6))
    e = 0.2 * ROBOT.error_jacobian(q, parameters=["a2"])[:, :, 0] + rng.normal(scale=0.02, size=(60, 3))
    noise = np.full((60, 3), 0.05)
    blocks = np.arange(60) // 20
    residual, std = model.fit(q, e, noise).leave_blocks_out(blocks)
    again = clone(model).fit(q[20:], e[20:], noise[20:])
    mean, spread = again.predict(q[:20], return_std=True, include_nugget=True)
    np.testing.assert_allclose(residual[:20], e[:20] - mean, atol=1e-3)
    np.testing.assert_allclose(std[:20] ** 2, spread**2 + 0.05**2, rtol=0.05)


def test_blocks_must_be_labels_of_the_samples(rng):
    model = InverseDistance().fit(rng.random((10, 3)), rng.random((10, 3)))
    with pytest.raises(DataError, match=r"blocks have shape \(3,\); expected \(10,\)"):
        model.leave_blocks_out([0, 1, 2])


def test_calibration_leaves_small_and_large_blocks_out_alike(rng):
    """Both forms of the inverse are what refitting gives."""
    q = rng.uniform(-0.8, 0.8, (80, 6))
    e = 0.2 * ROBOT.error_jacobian(q, parameters=["a2"])[:, :, 0] + rng.normal(scale=0.02, size=(80, 3))
    model = KinematicCalibration(ROBOT, misfit_std=0.02).fit(q, e)
    for m in (5, 40):  # 15 and 120 equations, some 30 parameters
        blocks = np.repeat([0, 1], [m, 80 - m])
        residual, std = model.leave_blocks_out(blocks)
        again = clone(model).fit(q[m:], e[m:])
        mean, spread = again.predict(q[:m], return_std=True, include_nugget=True)
        np.testing.assert_allclose(residual[:m], e[:m] - mean, atol=1e-3)
        np.testing.assert_allclose(std[:m], spread, rtol=1e-2)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_score_is_that_of_scikit_learn(rng, weighted):
    x, e = rng.random((20, 3)), rng.random((20, 3))
    e[:, 1] = 0.25  # without variance, and predicted exactly
    model = InverseDistance().fit(x, e)
    test_x, test_e = rng.random((15, 3)), rng.random((15, 3))
    test_e[:, 1:] = 0.25, 0.5  # the last without variance, and not predicted exactly
    weights = rng.random(15) if weighted else None
    expected = r2_score(test_e, model.predict(test_x), sample_weight=weights)
    assert model.score(test_x, test_e, weights) == pytest.approx(expected, rel=1e-9)
    one = InverseDistance().fit(x, e[:, 0])
    for shaped in (test_e[:, 0], test_e[:, :1]):
        expected = r2_score(shaped, one.predict(test_x), sample_weight=weights)
        assert one.score(test_x, shaped, weights) == pytest.approx(expected, rel=1e-9)


def test_a_score_needs_all_columns(rng):
    model = InverseDistance().fit(rng.random((10, 3)), rng.random((10, 3)))
    with pytest.raises(DataError, match=r"expected y of shape \(4, 3\), got \(4, 2\)"):
        model.score(rng.random((4, 3)), rng.random((4, 2)))


@pytest.fixture
def alone(monkeypatch):
    """An installation without scikit-learn."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "sklearn"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "sklearn", None)


@pytest.mark.parametrize(
    "given", [np.ndarray.tolist, lambda x: tuple(map(tuple, x)), np.float32, np.asfortranarray, np.int64]
)
def test_without_scikit_learn_arrays_and_lists_are_the_same(rng, given, request):
    x, e = np.rint(50 * rng.random((12, 3))), np.rint(50 * rng.random((12, 3)))
    expected = InverseDistance().fit(given(x), given(e)).predict(given(x[:4] + 1))
    request.getfixturevalue("alone")
    model = InverseDistance().fit(given(x), given(e))
    np.testing.assert_array_equal(model.predict(given(x[:4] + 1)), expected)


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([[1.0, 2.0], [3.0]], [1.0, 2.0], r"X: expected real numbers in rows of one length"),
        ([["1", "2"]], [1.0], r"X: expected real numbers"),
        ([[1j, 2.0]], [1.0], r"X: expected real numbers"),
        ([[1.0, np.nan], [1.0, 2.0]], [1.0, 2.0], r"X has NaN or infinity in row 0"),
        ([[1.0, 2.0], [1.0, 2.0]], [1.0, np.inf], r"y has NaN or infinity in row 1"),
        ([1.0, 2.0], [1.0, 2.0], r"got X of shape \(2,\)"),
        ([], [], r"got X of shape \(0,\)"),
        ([[1.0, 2.0]], [1.0, 2.0], r"got X of shape \(1, 2\) and y of shape \(2,\)"),
        ([[1.0, 2.0]], 1.0, r"y as float needs the package sklearn"),
        (memoryview(np.eye(3)), np.eye(3), r"X as memoryview needs the package sklearn.*truepose\[network\]"),
    ],
)
def test_without_scikit_learn_other_inputs_are_refused(alone, x, y, message):
    with pytest.raises(TrueposeError, match=message):
        InverseDistance().fit(x, y)


def test_without_scikit_learn_the_width_counts(alone, rng):
    model = InverseDistance().fit(rng.random((5, 3)).tolist(), rng.random((5, 3)))
    with pytest.raises(DataError, match="X has 2 columns, but 3 in the fit"):
        model.predict([[1.0, 2.0]])


def test_a_model_that_is_not_fitted_says_so(request):
    for error in (NotFittedError, DataError):  # with scikit-learn its own class, which its tools expect
        with pytest.raises(error, match="this InverseDistance is not fitted; call fit first"):
            InverseDistance().predict(np.eye(3))
        request.getfixturevalue("alone")


ROW, ERROR = np.zeros((1, 6)), np.zeros((1, 3))


@pytest.mark.parametrize(
    ("method", "arguments"),
    [
        *(("predict", (ROW,)), ("predict_together", (ROW,)), ("predict_covariance", (ROW,)), ("explain", (ROW,))),
        *(("joint_curves", ()), ("parameter_estimates", ()), ("optimum", ()), ("with_turns", (ROW, ["approach"]))),
        *(("update", (ROW, ERROR)), ("member", ("name",)), ("at_work", ({},))),
    ],
)
def test_every_method_of_kinematic_kriging_needs_a_fit(method, arguments):
    model = KinematicKriging(ROBOT)
    with pytest.raises(NotFittedError, match="not fitted; call fit first"):
        getattr(model, method)(*arguments)
