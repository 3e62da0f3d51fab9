"""Ordinary Kriging agrees with gstools and pykrige on random problems."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from truepose.predictors import OrdinaryKriging
from truepose.similarity import VariogramModel

SETTINGS = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])

# Each family in the peers' own parameters: (gstools class, its arguments, pykrige name, its range).
PEERS = {
    "spherical": ("Spherical", lambda a: {"len_scale": a}, "spherical", lambda a: a),
    "exponential": ("Exponential", lambda a: {"len_scale": a}, "exponential", lambda a: 3 * a),
    "gaussian": ("Gaussian", lambda a: {"len_scale": a, "rescale": 1.0}, "gaussian", lambda a: 7 / 4 * a),
    "matern32": ("Matern", lambda a: {"len_scale": a / 2**0.5, "nu": 1.5, "rescale": 1.0}, None, None),
    "matern52": ("Matern", lambda a: {"len_scale": a / 2**0.5, "nu": 2.5, "rescale": 1.0}, None, None),
}


@st.composite
def problems(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = draw(st.sampled_from([2, 3]))
    n = draw(st.integers(3, 40))
    family = draw(st.sampled_from(list(PEERS)))
    nugget = draw(st.floats(0.01, 1.0))
    model = VariogramModel(family, nugget=nugget, sill=draw(st.floats(0.1, 10)), range=draw(st.floats(0.2, 2.0)))
    return model, rng.random((n, d)), rng.standard_normal(n), rng.random((12, d))


@SETTINGS
@given(problems(), st.booleans())
def test_gstools(problem, exact):
    gstools = pytest.importorskip("gstools")
    variogram, x, e, targets = problem
    name, arguments, *_ = PEERS[variogram.family]
    model = getattr(gstools, name)(
        dim=x.shape[1], var=variogram.sill, nugget=variogram.nugget, **arguments(variogram.range)
    )
    peer = gstools.krige.Ordinary(model, x.T, e, exact=exact, pseudo_inv=False)
    expected, variance = peer(targets.T)
    mine, std = OrdinaryKriging(variogram, exact=exact).fit(x, e).predict(targets, return_std=True, include_nugget=True)
    np.testing.assert_allclose(mine, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(std**2, variance, rtol=1e-9, atol=1e-9)


@SETTINGS
@given(problems())
def test_pykrige(problem):
    pykrige = pytest.importorskip("pykrige")
    variogram, x, e, targets = problem
    *_, name, length = PEERS[variogram.family]
    if name is None:
        return
    kind = pykrige.OrdinaryKriging if x.shape[1] == 2 else pykrige.OrdinaryKriging3D
    parameters = {"psill": variogram.sill, "range": length(variogram.range), "nugget": variogram.nugget}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer = kind(*x.T, e, variogram_model=name, variogram_parameters=parameters)
        expected, variance = peer.execute("points", *targets.T)
    mine, std = OrdinaryKriging(variogram, exact=True).fit(x, e).predict(targets, return_std=True)
    np.testing.assert_allclose(mine, np.asarray(expected), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(std**2, np.asarray(variance), rtol=1e-9, atol=1e-9)
