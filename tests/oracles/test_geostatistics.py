"""Published and independent numbers for variograms and ordinary Kriging."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from truepose.predictors import OrdinaryKriging, VectorKriging
from truepose.similarity import VariogramModel, experimental_variogram

ISAAKS_SRIVASTAVA = np.array(
    [(61, 139, 477), (63, 140, 696), (64, 129, 227), (68, 128, 646), (71, 140, 606), (73, 141, 791), (75, 128, 783)],
    dtype=float,
)
CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)])


def predict(model, X):
    e, std = model.predict(X, return_std=True)
    return e[0], std[0] ** 2


def test_isaaks_srivastava_chapter_12():
    """Isaaks & Srivastava, Applied Geostatistics (1989), chapter 12: C(h) = 10 exp(-0.3 h)."""
    variogram = VariogramModel("exponential", sill=10, range=1 / 0.3)
    xy, v = ISAAKS_SRIVASTAVA[:, :2], ISAAKS_SRIVASTAVA[:, 2]
    estimate, variance = predict(OrdinaryKriging(variogram, exact=True).fit(xy, v), [(65, 137)])
    assert estimate == pytest.approx(592.7289, abs=5e-5)
    assert variance == pytest.approx(8.95605, abs=5e-6)


def test_isaaks_srivastava_weights():
    """The weights are the prediction of unit vectors."""
    variogram = VariogramModel("exponential", sill=10, range=1 / 0.3)
    weights = OrdinaryKriging(variogram).fit(ISAAKS_SRIVASTAVA[:, :2], np.eye(7)).predict([(65, 137)])[0]
    np.testing.assert_allclose(weights, [0.173, 0.318, 0.129, 0.086, 0.151, 0.057, 0.086], atol=5e-4)


def test_isaaks_srivastava_lagrange_parameter():
    """Of the system in the book's form, C λ + μ = c0: the same for every sample, and what the variance contains."""
    variogram = VariogramModel("exponential", sill=10, range=1 / 0.3)
    xy = ISAAKS_SRIVASTAVA[:, :2]
    model = OrdinaryKriging(variogram, exact=True)
    weights = model.fit(xy, np.eye(7)).predict([(65, 137)])[0]
    to_target = variogram.covariance(np.linalg.norm(xy - (65, 137), axis=1))
    between = variogram.covariance(np.linalg.norm(xy[:, None] - xy, axis=2))
    lagrange = between @ weights - to_target
    np.testing.assert_allclose(lagrange, 0.907, atol=5e-4)
    _, std = model.fit(xy, ISAAKS_SRIVASTAVA[:, 2]).predict([(65, 137)], return_std=True)
    assert std[0] ** 2 == pytest.approx(10 - weights @ to_target + lagrange[0], rel=1e-9)


@pytest.mark.parametrize("exact", [True, False])
def test_kitanidis_example_3_2(exact):
    """Kitanidis, Introduction to Geostatistics (1997), example 3.2: gamma = 0.006 h + 0.1, variance with the nugget."""
    variogram = VariogramModel("linear", nugget=0.1, sill=0.006, range=1.0)
    model = OrdinaryKriging(variogram, exact=exact).fit([(9.7, 47.6), (43.8, 24.6)], [1.22, 2.822])
    estimate, std = model.predict([(18.8, 67.9)], return_std=True, include_nugget=True)
    assert estimate[0] == pytest.approx(1.6364, abs=5e-5)
    assert std[0] ** 2 == pytest.approx(0.4201, abs=5e-5)


@pytest.mark.parametrize(("points", "estimate", "variance"), [(4, 2.5, 1.017767), (2, 1.5, 1.267767)])
def test_four_corners(points, estimate, variance):
    """Four corners of a square under a spherical model that barely reaches its centre."""
    model = OrdinaryKriging(VariogramModel("spherical", sill=1, range=1)).fit(
        CORNERS[:points], np.arange(1.0, points + 1)
    )
    assert predict(model, [(0, 0)]) == pytest.approx((estimate, variance), abs=5e-7)


def test_ordinary_cokriging_with_a_shared_mean():
    """Two variables, each measured where the other was not; from gstat's own test output."""
    d1, d2 = np.diag([0.0, np.inf]), np.diag([np.inf, 0.0])
    model = VectorKriging(
        VariogramModel("exponential", sill=1.0, range=1.0), [[1.0, 0.5], [0.5, 1.0]], shared_drift=True
    )
    model.fit([(0, 0), (2, 0), (0, 2), (2, 2)], [(0, 0), (1, 0), (0, 4), (0, 5)], noise_cov=[d1, d1, d2, d2])
    np.testing.assert_allclose(model.predict([(1, 1)])[0], [2.031619, 2.968381], atol=5e-7)
    expected = [[0.929230, 0.457698], [0.457698, 0.929230]]
    np.testing.assert_allclose(model.predict_covariance([(1, 1)])[0], expected, atol=5e-7)


def test_meuse_experimental_variogram():
    """log(zinc) of the Meuse flood plain (scikit-gstat ships it), as gstat computes it."""
    skgstat = pytest.importorskip("skgstat")
    with (Path(skgstat.__file__).parent / "data" / "samples" / "meuse.txt").open() as file:
        rows = list(csv.DictReader(file))
    x = np.array([(float(row["x"]), float(row["y"])) for row in rows])
    zinc = np.array([float(row["zinc"]) for row in rows])
    cutoff = float(np.linalg.norm(np.ptp(x, axis=0))) / 3
    ev = experimental_variogram(x, np.log(zinc), bins=15, max_lag=cutoff)
    assert ev.pairs.tolist() == [57, 299, 419, 457, 547, 533, 574, 564, 589, 543, 500, 477, 452, 457, 415]
    expected = [
        0.1234479, 0.2162185, 0.3027859, 0.4121448, 0.4634128, 0.5646933, 0.5689683, 0.6186769,
        0.6471479, 0.6915705, 0.7033984, 0.6038770, 0.6517158, 0.5665318, 0.5748227,
    ]  # fmt: skip
    np.testing.assert_allclose(ev.semivariance[:, 0], expected, atol=5e-8)
    assert ev.lag[0] == pytest.approx(79.29244, abs=5e-6)
