"""Anisotropic variograms in every Kriging predictor: with and without a nugget, exact and filtering."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from truepose.errors import KrigingError
from truepose.predictors import (
    LocalKriging,
    OrdinaryKriging,
    SimpleKriging,
    UniversalKriging,
    VecchiaKriging,
    VectorKriging,
)
from truepose.similarity import VariogramModel

N = 25
ANISOTROPIC = [
    VariogramModel("matern32", sill=1.0, range=(100.0, 250.0, 700.0)),
    VariogramModel("matern32", sill=1.0, range=(100.0, 250.0, 700.0), rotation=(0.3, -0.5, 0.9)),
]
MODELS = {
    "ordinary": lambda variogram, exact: OrdinaryKriging(variogram, exact=exact),
    "simple": lambda variogram, exact: SimpleKriging(variogram, exact=exact),
    "universal": lambda variogram, exact: UniversalKriging("linear", variogram, exact=exact),
    "vector": lambda variogram, exact: VectorKriging(variogram, np.eye(3), exact=exact),
    "local": lambda variogram, exact: LocalKriging(N, variogram, exact=exact),
    "vecchia": lambda variogram, exact: VecchiaKriging(N, variogram, exact=exact),
}


def bordered(variogram, drift, x, e, targets, exact):
    """Prediction and variance from the bordered system in covariances, the points stretched by hand."""
    axes = np.eye(3) if variogram.rotation is None else Rotation.from_rotvec(variogram.rotation).as_matrix()
    u, v = (points @ axes / np.array(variogram.range) for points in (x, targets))

    def covariance(a, b):
        r = np.sqrt(3) * cdist(a, b)
        return (1 + r) * np.exp(-r)

    p = drift(x).shape[1]
    system = np.zeros((N + p, N + p))
    system[:N, :N] = covariance(u, u) + variogram.nugget * np.eye(N)
    system[:N, N:], system[N:, :N] = drift(x), drift(x).T
    right = np.vstack([covariance(u, v), drift(targets).T])
    weights = np.linalg.solve(system, right)
    prior = 1.0 + (variogram.nugget if exact else 0.0)
    return weights[:N].T @ e, prior - (weights * right).sum(axis=0)


@pytest.mark.promise("every Kriging predictor takes anisotropic variograms, with and without a nugget")
@pytest.mark.parametrize("name", MODELS)
def test_anisotropic_kriging_is_the_bordered_system(name, rng, record_property):
    columns = {"simple": 0, "universal": 4}.get(name, 1)
    cases = list(product(ANISOTROPIC, (0.0, 0.2), (False, True)))
    record_property("cases", len(cases))
    for plain, nugget, exact in cases:
        variogram = VariogramModel("matern32", nugget=nugget, sill=1.0, range=plain.range, rotation=plain.rotation)
        x, targets = rng.random((N, 3)) * 800, rng.random((6, 3)) * 800
        e = rng.standard_normal((N, 3))
        model = MODELS[name](variogram, exact).fit(x, e)
        found, std = model.predict(targets, return_std=True)
        drift = lambda points: np.column_stack([np.ones(len(points)), points / 800])[:, :columns]  # noqa: E731
        mean, variance = bordered(variogram, drift, x, e, targets, exact)
        np.testing.assert_allclose(found, mean, atol=1e-8)
        np.testing.assert_allclose(std**2, variance[:, None] * np.ones(3), atol=1e-8)
        back, _ = model.predict(x, return_std=True)
        assert (np.abs(back - e).max() < 1e-8) == (exact or not nugget)


@pytest.mark.promise("near points that contradict each other are judged by the variogram along their direction")
@pytest.mark.parametrize("name", MODELS)
def test_near_points_are_judged_along_their_direction(name, rng, record_property):
    x = rng.random((N, 3)) * 800
    e = 0.01 * rng.standard_normal((N, 3))
    x[1], e[1] = x[0] + [0.0, 0.0, 0.5], e[0] + 0.3
    record_property("cases", 2)
    MODELS[name](VariogramModel("exponential", sill=1.0, range=(800.0, 800.0, 2.0)), False).fit(x, e)
    with pytest.raises(KrigingError, match=r"rows 0, 1 are 0\.5 apart"):
        MODELS[name](VariogramModel("exponential", sill=1.0, range=(2.0, 2.0, 800.0)), False).fit(x, e)
