import numpy as np
import pytest
from sklearn.base import clone

from truepose.errors import DataError
from truepose.predictors import InverseDistance, KinematicCalibration, LocalKriging, RegistrationOnly, ResidualNetwork
from truepose.robots import load_robot
from truepose.similarity import VariogramModel

ROBOT = load_robot("kuka-kr150-2")
MODEL = VariogramModel("matern52", nugget=0.01, sill=1.0, range=1.0)


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
