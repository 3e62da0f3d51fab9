from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from truepose.errors import DataError
from truepose.predictors import InverseDistance


@pytest.mark.parametrize("power", [1, 2, 3.5])
def test_shepards_formula(power, rng):
    x, e, targets = rng.random((30, 3)), rng.standard_normal((30, 2)), rng.random((10, 3))
    weights = cdist(targets, x) ** -power
    expected = weights @ e / weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(InverseDistance(power).fit(x, e).predict(targets), expected)


def test_nearest_only(rng):
    x, e, targets = rng.random((30, 3)), rng.standard_normal((30, 2)), rng.random((10, 3))
    nearest = cdist(targets, x).argmin(axis=1)
    np.testing.assert_array_equal(InverseDistance(neighbours=1).fit(x, e).predict(targets), e[nearest])


def test_passes_through_samples_and_averages_repeats():
    model = InverseDistance().fit([[0.0], [1.0], [1.0]], [5.0, 1.0, 3.0])
    np.testing.assert_allclose(model.predict([[0.0], [1.0]]), [5.0, 2.0])


@pytest.mark.parametrize("neighbours", [None, 4])
def test_leave_one_out_is_refitting(neighbours, rng):
    x, e = rng.random((20, 2)), rng.standard_normal((20, 3))
    model = InverseDistance(neighbours=neighbours).fit(x, e)
    residual, std = model.leave_one_out()
    for i in range(20):
        rest = np.arange(20) != i
        refitted = InverseDistance(neighbours=neighbours).fit(x[rest], e[rest])
        np.testing.assert_allclose(residual[i], e[i] - refitted.predict(x[i : i + 1])[0])
    np.testing.assert_allclose(std, np.broadcast_to(np.sqrt(np.mean(residual**2, axis=0)), e.shape))


def test_far_distances_do_not_overflow():
    model = InverseDistance(power=50).fit([[0.0], [1e-6]], [1.0, 2.0])
    assert np.isfinite(model.predict([[1e9], [1e-12]])).all()


@pytest.mark.parametrize(
    ("arguments", "message"), [({"power": 0}, "power is 0"), ({"neighbours": 0}, "neighbours is 0")]
)
def test_refusals(arguments, message):
    with pytest.raises(DataError, match=message):
        InverseDistance(**arguments).fit(np.eye(3), np.eye(3))
