from __future__ import annotations

import warnings

import gstools as gs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.errors import KrigingError
from truepose.similarity import VariogramModel
from truepose.similarity.gstools_models import as_variogram

FAMILIES = {
    gs.Spherical: {},
    gs.Exponential: {},
    gs.Gaussian: {},
    gs.Matern: {"nu": 1.7},
    gs.Stable: {"alpha": 1.2},
    gs.Rational: {"alpha": 0.8},
    gs.Cubic: {},
    gs.JBessel: {"nu": 0.5},
}


@pytest.mark.filterwarnings("ignore:JBessel")  # near its lowest order
@settings(max_examples=examples(60))
@given(seed=st.integers(0, 2**32 - 1), family=st.sampled_from(list(FAMILIES)), d=st.sampled_from([1, 2, 3]))
def test_same_semivariance(seed, family, d):
    rng = np.random.default_rng(seed)
    peer = family(
        dim=d,
        var=rng.uniform(0.1, 3),
        len_scale=rng.uniform(0.5, 3, d) if d > 1 else rng.uniform(0.5, 3),
        nugget=rng.uniform(0, 1),
        angles=rng.uniform(-1, 1, {1: 1, 2: 1, 3: 3}[d]),
        **FAMILIES[family],
    )
    model, directions = as_variogram(peer), rng.standard_normal((5, d))
    for axis in directions:
        unit = axis / np.linalg.norm(axis)
        h = rng.uniform(0.01, 5, 8)
        expected = peer.vario_spatial(unit[:, None] * h)
        axis_or_none = None if model.isotropic else axis
        np.testing.assert_allclose(model.semivariance(h, axis_or_none), expected, rtol=1e-9, atol=1e-12)


def test_smooth_matern_and_sums():
    h = np.linspace(0.1, 9, 30)
    for peer in (
        gs.Matern(dim=3, nu=25.0, len_scale=2.0),
        gs.Exponential(dim=3, var=1.0, len_scale=2.0, nugget=0.1) + gs.Spherical(dim=3, var=0.5, len_scale=5.0),
        gs.Nugget(dim=3, nugget=0.4),
    ):
        np.testing.assert_allclose(as_variogram(peer).semivariance(h), peer.variogram(h), rtol=1e-9)


def test_own_model_passes():
    own = VariogramModel("exponential", sill=1.0, range=1.0)
    assert as_variogram(own) is own


def test_refusals():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for peer in (gs.Circular(dim=2), gs.Linear(dim=1), gs.JBessel(dim=3, nu=2.0), gs.TPLGaussian(dim=3)):
            with pytest.raises(KrigingError, match="has no counterpart here; there are Spherical"):
                as_variogram(peer)
        with pytest.raises(KrigingError, match="on the sphere or in time"):
            as_variogram(gs.Exponential(latlon=True))
        with pytest.raises(KrigingError, match="rotation in 4 dimensions"):
            as_variogram(gs.Gaussian(dim=4, len_scale=[4, 3, 2, 1], angles=[0.3]))
    with pytest.raises(KrigingError, match="expected a VariogramModel or a GSTools CovModel, got str"):
        as_variogram("exponential")
