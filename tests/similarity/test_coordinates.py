from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from truepose.errors import DataError, KrigingError
from truepose.similarity import (
    equal_count_bins,
    experimental_variogram,
    joint_coordinates,
    lever_arm_weights,
    model_based_variogram,
    remove_drift,
)


def test_joint_distance_with_approach_signs(rng):
    q, s = rng.random((20, 6)), rng.choice([-1, 1], (20, 6))
    w, v = rng.random(6), rng.random(6)
    i, j = np.triu_indices(20, 1)
    expected = np.sqrt(((q[i] - q[j]) ** 2) @ w + (s[i] != s[j]) @ v)
    np.testing.assert_allclose(pdist(joint_coordinates(q, w, s, v)), expected)
    np.testing.assert_array_equal(joint_coordinates(q), q)


def test_lever_arms_turn_angles_into_millimetres(rng):
    """For a small move of one joint the weighted distance is the motion of the tool."""
    J = np.tile(rng.standard_normal((1, 3, 6)) * 500, (10, 1, 1))
    w = lever_arm_weights(J)
    move = 1e-3 * np.eye(6)[2]
    h = pdist(joint_coordinates(np.stack([np.zeros(6), move]), w))[0]
    assert h == pytest.approx(np.linalg.norm(J[0] @ move))


def test_equal_counts(rng):
    x = rng.random((300, 3))
    edges = equal_count_bins(x, 12)
    ev = experimental_variogram(x, x[:, 0], bins=edges)
    assert np.ptp(ev.pairs) <= 1
    assert edges[-1] <= pdist(x).max() / 2
    many = rng.random((4000, 2))
    pairs = experimental_variogram(many, many[:, 0], bins=equal_count_bins(many, 5)).pairs
    np.testing.assert_allclose(pairs, pairs.mean(), rtol=0.03)


def test_equation_6_pair_by_pair(rng):
    x, J, root = rng.random((40, 3)), rng.standard_normal((40, 3, 5)), rng.standard_normal((5, 5))
    sigma, edges = root @ root.T, [0.0, 0.3, 0.6]
    found = model_based_variogram(x, J, sigma, bins=edges)
    i, j = np.triu_indices(40, 1)
    spread = np.einsum("nap,pq,naq->na", J[i] - J[j], sigma, J[i] - J[j]) / 2
    h = pdist(x)
    expected = [spread[(h > a) & (h <= b)].mean(axis=0) for a, b in ((0, 0.3), (0.3, 0.6))]
    np.testing.assert_allclose(found.semivariance, expected, rtol=1e-10)
    np.testing.assert_allclose(found.vector, np.sum(expected, axis=1), rtol=1e-10)


def test_equation_6_is_the_mean_over_parameter_errors(rng):
    """Errors J Δpsi of many drawn Δpsi have that semivariogram in the mean."""
    x, J, std = rng.random((60, 3)), rng.standard_normal((60, 3, 4)), np.array([1.0, 2.0, 0.5, 0.0])
    drawn = np.einsum("nap,pm->nam", J, std[:, None] * rng.standard_normal((4, 4000))).reshape(60, -1)
    mean = experimental_variogram(x, drawn, bins=4).semivariance.reshape(4, 3, -1).mean(axis=2)
    np.testing.assert_allclose(model_based_variogram(x, J, std**2, bins=4).semivariance, mean, rtol=0.1)


def test_trend(rng):
    x = rng.random((200, 3)) * 1000
    e = np.stack([0.002 * x[:, 0], -0.001 * x[:, 2], np.zeros(200)], axis=1) + rng.normal(scale=0.05, size=(200, 3))
    linear, constant = remove_drift(x, e), remove_drift(x, e, "constant")
    assert linear.explained > 0.95
    assert constant.explained == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(linear.residual.std(), 0.05, rtol=0.1)
    noise = remove_drift(x, rng.standard_normal((200, 3)), "quadratic")
    assert noise.explained > abs(noise.adjusted)
    assert abs(noise.adjusted) < 0.05
    flat = np.column_stack([x[:, :2], np.full(200, 7.0)])
    assert remove_drift(flat, e).rank == 3


def test_refusals(rng):
    x = rng.random((5, 3))
    with pytest.raises(DataError, match="5 samples do not determine a drift of 10 columns"):
        remove_drift(x, x, "quadratic")
    with pytest.raises(DataError, match="drift is 'cubic'; expected constant"):
        remove_drift(x, x, "cubic")
    with pytest.raises(DataError, match=r"expected \(5, p\)"):
        remove_drift(x, x, np.ones((4, 1)))
    with pytest.raises(DataError, match=r"expected \(n, components, parameters\)"):
        model_based_variogram(x, x, np.eye(3))
    with pytest.raises(DataError, match=r"expected \(2, 2\) or \(2,\)"):
        model_based_variogram(x, np.ones((5, 3, 2)), np.eye(3))
    with pytest.raises(DataError, match="without negative eigenvalues"):
        model_based_variogram(x, np.ones((5, 3, 2)), [1.0, -1.0])
    with pytest.raises(DataError, match="each -1, 0 or 1"):
        joint_coordinates(x, approach=x)
    with pytest.raises(DataError, match="approach_weights"):
        joint_coordinates(x, approach=np.ones((5, 3)), approach_weights=-1.0)
    with pytest.raises(DataError, match=r"shape \(3,\)"):
        lever_arm_weights([1.0, 2.0, 3.0])
    with pytest.raises(DataError, match="cannot fill 20 bins"):
        equal_count_bins(x)
    with pytest.raises(KrigingError, match="are the same"):
        equal_count_bins(np.ones((5, 3)))
