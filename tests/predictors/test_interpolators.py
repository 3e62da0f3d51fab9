from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator, RegularGridInterpolator

from truepose.errors import DataError, KrigingError
from truepose.predictors import GridCell, Nearest, RadialBasis


def test_nearest(rng):
    x, e, targets = rng.random((50, 3)), rng.random((50, 2)), rng.random((20, 3))
    near = np.argmin(np.linalg.norm(targets[:, None] - x, axis=2), axis=1)
    np.testing.assert_array_equal(Nearest().fit(x, e).predict(targets), e[near])


def test_grid_cell_uses_the_eight_corners(rng):
    axes = [np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0]), np.array([0.0, 5.0, 6.0])]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    e = rng.random((len(x), 2))
    target = np.array([[2.0, 1.0, 5.2]])
    corners = (np.abs(x - [2.0, 1.0, 5.5]) <= [1.0, 1.0, 0.5]).all(axis=1)
    assert corners.sum() == 8
    weight = 1 / np.linalg.norm(x[corners] - target, axis=1)
    np.testing.assert_allclose(GridCell().fit(x, e).predict(target)[0], weight @ e[corners] / weight.sum())
    centre = [[2.0, 1.0, 5.5]]
    linear = RegularGridInterpolator(axes, e.reshape(3, 2, 3, 2))(centre)
    np.testing.assert_allclose(GridCell().fit(x, e).predict(centre), linear)
    np.testing.assert_allclose(GridCell().fit(x, e).predict(x), e)


@pytest.mark.parametrize("kernel", ["linear", "thin_plate_spline", "cubic", "quintic"])
@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_radial_basis(kernel, smoothing, rng):
    x, e, targets = rng.random((60, 3)), rng.random((60, 2)), rng.random((20, 3))
    model = RadialBasis(kernel, smoothing).fit(x, e)
    peer = RBFInterpolator(x, e, kernel=kernel, smoothing=smoothing, degree={"linear": 0, "quintic": 2}.get(kernel, 1))
    np.testing.assert_allclose(model.predict(targets), peer(targets))
    residual = model.leave_one_out().residual
    for i in (0, 17, 59):
        rest = np.arange(60) != i
        others = RadialBasis(kernel, smoothing).fit(x[rest], e[rest]).predict(x[i : i + 1])
        np.testing.assert_allclose(residual[i], e[i] - others[0], atol=1e-8)


@pytest.mark.parametrize(
    ("model", "error", "message"),
    [
        (GridCell(power=0), DataError, "power is 0; expected a number above 0"),
        (RadialBasis("gauss"), DataError, "kernel is 'gauss'; expected linear, thin_plate_spline"),
        (RadialBasis(smoothing=-1), DataError, "smoothing is -1; expected a number of 0 or more"),
        (RadialBasis("cubic"), KrigingError, "3 points do not determine the cubic spline in 3 coordinates"),
    ],
)
def test_refusals(model, error, message, rng):
    with pytest.raises(error, match=message):
        model.fit(rng.random((3, 3)), rng.random((3, 3)))
