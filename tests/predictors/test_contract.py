"""What all predictors have in common: scikit-learn's contract, and ours on top."""

from __future__ import annotations

import json

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

from truepose.errors import DataError
from truepose.predictors import (
    GridCell,
    InverseDistance,
    KinematicCalibration,
    KinematicKriging,
    LocalKriging,
    Nearest,
    OrdinaryKriging,
    RadialBasis,
    RegistrationOnly,
    ResidualNetwork,
    SimpleKriging,
    UniversalKriging,
    VecchiaKriging,
    VectorKriging,
)
from truepose.robots import load_robot
from truepose.similarity import VariogramModel

PREDICTORS = [
    InverseDistance(),
    InverseDistance(power=3, neighbours=8),
    OrdinaryKriging(),
    OrdinaryKriging(exact=True),
    SimpleKriging(),
    UniversalKriging(),
    LocalKriging(12),
    VecchiaKriging(12),
    VectorKriging(),
    Nearest(),
    GridCell(),
    RadialBasis(),
]
MODEL = VariogramModel("matern52", nugget=0.01, sill=1.0, range=5.0)
QUICK = [  # their fit of the variogram is OrdinaryKriging's
    type(model)(**model.get_params() | {"variogram": MODEL}) if "variogram" in model.get_params() else model
    for model in PREDICTORS
]


class AnyColumns:
    """Turn the data of scikit-learn's checks, of any width, into joints of an arm and errors of three components."""

    def _fit(self, X, e, noise_std):
        self._width = e.shape[1]
        super()._fit(_joints(X), e[:, np.arange(3) % self._width], noise_std)

    def _predict(self, X, return_std):
        e, std = super()._predict(_joints(X), return_std)
        columns = np.arange(self._width) % 3
        return e[:, columns], None if std is None else std[:, columns]

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True  # the data of the checks are not the errors of an arm
        return tags


def _joints(x):
    rng = np.random.default_rng(0)
    return 2.0 * np.sin(3.0 * x / (1.0 + np.abs(x)) @ rng.normal(size=(x.shape[1], 6)) + rng.uniform(-3, 3, 6))


class AnyCalibration(AnyColumns, KinematicCalibration):
    """KinematicCalibration for data of any width."""


class AnyKriging(AnyColumns, KinematicKriging):
    """KinematicKriging for data of any width."""


class AnyNetwork(AnyColumns, ResidualNetwork):
    """ResidualNetwork for data of any width."""


ROBOT = load_robot("kuka-kr150-2")
ROBOT.frames(np.zeros((1, 6)))
_ = ROBOT.link_before  # cached now: a check compares the robot's attributes before and after a fit
ARMS = [AnyCalibration(ROBOT), AnyKriging(ROBOT, residual="none", joint_errors=False), AnyNetwork(ROBOT, hidden=3)]
_FILTERS = "partial_fit belongs to the Kalman filters; other methods refuse it"
_FEW = "the check has fewer than the 20 samples that five networks need"
EXPECTED_TO_FAIL = {
    AnyCalibration: dict.fromkeys(
        ["check_fit_score_takes_y", "check_n_features_in_after_fitting", "check_estimators_partial_fit_n_features"],
        _FILTERS,
    ),
    AnyNetwork: dict.fromkeys(
        [
            "check_n_features_in_after_fitting",
            "check_estimators_nan_inf",
            "check_regressor_multioutput",
            "check_regressors_no_decision_function",
            "check_fit2d_1feature",
        ],
        _FEW,
    ),
}


@pytest.mark.sampled(40)
@parametrize_with_checks(
    [OrdinaryKriging(), RegistrationOnly(), *QUICK, *ARMS],
    expected_failed_checks=lambda estimator: EXPECTED_TO_FAIL.get(type(estimator), {}),
)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.SkipTestWarning")
def test_scikit_learn(estimator, check):
    check(estimator)


@pytest.fixture(params=PREDICTORS, ids=str)
def model(request):
    return clone(request.param)


@pytest.fixture
def samples(rng):
    x = rng.random((60, 3)) * 1000
    return x, np.sin(x / 300) + rng.normal(scale=0.02, size=x.shape)


def test_shapes(model, samples):
    x, e = samples
    mean, std = model.fit(x, e).predict(x[:7] + 1, return_std=True)
    assert mean.shape == std.shape == (7, 3)
    assert (std > 0).all()
    mean, std = model.fit(x, e[:, 0]).predict(x[:7] + 1, return_std=True)
    assert mean.shape == std.shape == (7,)
    residual, std = model.leave_one_out()
    assert residual.shape == std.shape == (60,)


def test_constant_shift(model, samples, rng):
    """Adding a constant to the errors adds it to the prediction and leaves the rest as it is."""
    if isinstance(model, SimpleKriging):
        return  # its mean is known
    x, e = samples
    shift, targets = np.array([5.0, -3.0, 0.5]), rng.random((20, 3)) * 1000
    mean, std = model.fit(x, e).predict(targets, return_std=True)
    left_out = model.leave_one_out()
    shifted, shifted_std = model.fit(x, e + shift).predict(targets, return_std=True)
    np.testing.assert_allclose(shifted, mean + shift, atol=1e-5)
    np.testing.assert_allclose(shifted_std, std, rtol=1e-4)
    np.testing.assert_allclose(model.leave_one_out().residual, left_out.residual, atol=1e-5)


def test_beats_the_mean(model, samples, rng):
    x, e = samples
    targets = rng.uniform(100, 900, (200, 3))
    residual = np.sin(targets / 300) - model.fit(x, e).predict(targets)
    assert np.sqrt(np.mean(residual**2)) < 0.8 * np.sin(targets / 300).std()


@pytest.mark.sampled(4)
def test_pinned_copy_answers_the_same_bit_by_bit(model, samples, rng):
    x, e = samples
    noise, targets = rng.uniform(0, 0.05, (60, 3)), rng.random((50, 3)) * 1000
    for noise_std in (None, noise):
        model.fit(x, e, noise_std)
        plain = json.loads(json.dumps(model.to_dict()))
        for copy in (model.with_fitted_parameters(), type(model).from_dict(plain)):
            again = copy.fit(x, e, noise_std).predict(targets, return_std=True)
            np.testing.assert_array_equal(again, model.predict(targets, return_std=True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x, e: (x[:0], e[:0]), "X: Found array with 0 sample"),
        (lambda x, e: (x, e[:-1]), "X: Found input variables with inconsistent numbers of samples"),
        (lambda x, e: (x[0], e), "X: Expected 2D array, got 1D array"),
        (lambda x, e: (np.where(np.arange(60)[:, None] == 4, np.nan, x), e), "X has NaN or infinity in row 4 "),
        (
            lambda x, e: (x, np.where(np.arange(60)[:, None] >= 58, np.inf, e)),
            r"y has NaN or infinity in row 58 \(2 rows",
        ),
    ],
)
def test_bad_samples(model, samples, change, message):
    with pytest.raises(DataError, match=message) as caught:
        model.fit(*change(*samples))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("noise_std", "message"),
    [
        (np.ones(59), r"shape \(59,\); expected one number, \(60,\) or \(60, 3\)"),
        (-1.0, r"in row 0 \(60 rows in all\); expected finite numbers >= 0"),
        (np.where(np.arange(60) == 7, np.nan, 0.1), "in row 7 "),
    ],
)
def test_bad_noise(model, samples, noise_std, message):
    with pytest.raises(DataError, match=message):
        model.fit(*samples, noise_std=noise_std)


def test_parameters_are_set_by_name():
    model = KinematicCalibration().set_params(robot=ROBOT, method="ekf")
    assert (model.robot, model.method) == (ROBOT, "ekf")
    assert repr(InverseDistance(power=3)) == "InverseDistance(power=3)"
    with pytest.raises(DataError, match="InverseDistance has no parameter 'pover'; expected one of: neighbours, power"):
        InverseDistance().set_params(pover=3)


def test_parameters_of_inner_estimators_are_reached_by_both_names():
    class Outer(InverseDistance):
        def __init__(self, inner, power=2.0, neighbours=None):
            super().__init__(power, neighbours)
            self.inner = inner

    outer = Outer(InverseDistance(power=3))
    assert outer.get_params()["inner__power"] == 3
    copy = clone(outer).set_params(inner__power=5, power=4)
    assert (copy.power, copy.inner.power, outer.inner.power) == (4, 5, 3)
    assert repr(copy) == "Outer(inner=InverseDistance(power=5), power=4)"


def test_bad_targets(model, samples):
    model.fit(*samples)
    with pytest.raises(DataError, match=r"X has 2 features, but .* is expecting 3"):
        model.predict([[0.0, 0.0]])
    with pytest.raises(DataError, match="X has NaN or infinity in row 1"):
        model.predict([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]])
