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
    LocalKriging,
    Nearest,
    OrdinaryKriging,
    RadialBasis,
    SimpleKriging,
    UniversalKriging,
    VecchiaKriging,
    VectorKriging,
)
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


@parametrize_with_checks([OrdinaryKriging(), *QUICK])
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


def test_bad_targets(model, samples):
    model.fit(*samples)
    with pytest.raises(DataError, match=r"X has 2 features, but .* is expecting 3"):
        model.predict([[0.0, 0.0]])
    with pytest.raises(DataError, match="X has NaN or infinity in row 1"):
        model.predict([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]])
