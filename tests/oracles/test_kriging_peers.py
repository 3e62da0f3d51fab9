"""Kriging agrees with gstools, pykrige, scikit-learn, gpboost and gstlearn on random problems in 1 to 6 coordinates."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.predictors import OrdinaryKriging, SimpleKriging, UniversalKriging, VecchiaKriging, VectorKriging
from truepose.similarity import VariogramModel

SETTINGS = settings(max_examples=examples(25), suppress_health_check=[HealthCheck.too_slow])

# Each family in the peers' own parameters: (gstools class, its arguments, pykrige name, its range).
PEERS = {
    "spherical": ("Spherical", lambda a: {"len_scale": a}, "spherical", lambda a: a),
    "exponential": ("Exponential", lambda a: {"len_scale": a}, "exponential", lambda a: 3 * a),
    "gaussian": ("Gaussian", lambda a: {"len_scale": a, "rescale": 1.0}, "gaussian", lambda a: 7 / 4 * a),
    "matern32": ("Matern", lambda a: {"len_scale": a / 2**0.5, "nu": 1.5, "rescale": 1.0}, None, None),
    "matern52": ("Matern", lambda a: {"len_scale": a / 2**0.5, "nu": 2.5, "rescale": 1.0}, None, None),
}


@st.composite
def problems(draw, dimensions=(1, 2, 3, 6)):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = draw(st.sampled_from(dimensions))
    n = draw(st.integers(8, 40))
    family = draw(st.sampled_from([name for name in PEERS if name != "spherical" or d <= 3]))
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
@given(problems(dimensions=(2, 3)))
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


@SETTINGS
@given(problems(), st.booleans())
def test_gstools_simple(problem, exact):
    gstools = pytest.importorskip("gstools")
    variogram, x, e, targets = problem
    name, arguments, *_ = PEERS[variogram.family]
    model = getattr(gstools, name)(
        dim=x.shape[1], var=variogram.sill, nugget=variogram.nugget, **arguments(variogram.range)
    )
    expected, variance = gstools.krige.Simple(model, x.T, e, mean=0.3, exact=exact, pseudo_inv=False)(targets.T)
    kriging = SimpleKriging(variogram, exact=exact, mean=0.3).fit(x, e)
    mine, std = kriging.predict(targets, return_std=True, include_nugget=True)
    np.testing.assert_allclose(mine, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(std**2, variance, rtol=1e-9, atol=1e-9)


@SETTINGS
@given(problems(dimensions=(1, 2, 3)), st.sampled_from(["linear", "quadratic"]))
def test_gstools_universal(problem, drift):
    gstools = pytest.importorskip("gstools")
    variogram, x, e, targets = problem
    name, arguments, *_ = PEERS[variogram.family]
    model = getattr(gstools, name)(
        dim=x.shape[1], var=variogram.sill, nugget=variogram.nugget, **arguments(variogram.range)
    )
    if len(x) < 12:
        return  # as many columns as samples
    expected, variance = gstools.krige.Universal(model, x.T, e, drift, exact=True, pseudo_inv=False)(targets.T)
    mine, std = UniversalKriging(drift, variogram, exact=True).fit(x, e).predict(targets, return_std=True)
    np.testing.assert_allclose(mine, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())  # its system is bordered
    np.testing.assert_allclose(std**2, variance, rtol=1e-7, atol=1e-7 * np.abs(variance).max())


@SETTINGS
@given(problems())
def test_scikit_learn_simple(problem):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern

    variogram, x, e, targets = problem
    a = variogram.range
    kernels = {
        "exponential": Matern(a, nu=0.5),
        "gaussian": RBF(a / 2**0.5),
        "matern32": Matern(a, nu=1.5),
        "matern52": Matern(a, nu=2.5),
    }
    if variogram.family not in kernels:
        return
    kernel = ConstantKernel(variogram.sill, "fixed") * kernels[variogram.family]
    peer = GaussianProcessRegressor(kernel, alpha=variogram.nugget, optimizer=None).fit(x, e)
    expected, peer_std = peer.predict(targets, return_std=True)
    mine, std = SimpleKriging(variogram).fit(x, e).predict(targets, return_std=True)
    np.testing.assert_allclose(mine, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(std**2, peer_std**2, rtol=1e-9, atol=1e-9)


def test_gpboost_vecchia():
    """Its predictions from the nearest samples with a mean of 0, and its likelihood where all are neighbours.

    The numbers were computed once by gpboost 1.8.0: ``GPModel(gp_coords=x, cov_function="matern", cov_fct_shape=1.5,
    gp_approx="vecchia", num_neighbors=59, likelihood="gaussian")`` with the parameters 0.1, 1.0, 0.3, and 60 neighbours
    for predictions ("order_obs_first_cond_obs_only").
    """
    mean = [
        -0.175934542, 0.720998351, -0.603396486, 0.068764361, 0.675744996, -0.001073910, 0.643535738, 0.635099365,
        0.367334817, 0.030858890, 0.252709296, -0.325687362, 0.597852390, 0.658791307, -0.591920381, -0.037643914,
        -0.302904774, -0.422109172, 0.729169772, 0.349159703, 0.060321988, 0.162662368, -0.590014738, 0.312521709,
        0.036736775, -0.118389494, 0.193478510, -0.177680416, -0.386020990, -0.150476070,
    ]  # fmt: skip
    variance = [
        0.086243771, 0.049867222, 0.366970755, 0.066055618, 0.055542225, 0.051944002, 0.052514025, 0.054803650,
        0.056489365, 0.063418088, 0.141854669, 0.049583517, 0.075717036, 0.047472056, 0.047208154, 0.205781766,
        0.144091572, 0.137139782, 0.098470589, 0.071867321, 0.081567976, 0.080402595, 0.161995116, 0.067897989,
        0.080836181, 0.040420421, 0.035942555, 0.048361428, 0.045500565, 0.051275897,
    ]  # fmt: skip
    rng = np.random.default_rng(3)
    x, e, targets = rng.random((60, 2)), rng.standard_normal(60), rng.random((30, 2))
    variogram = VariogramModel("matern32", nugget=0.1, sill=1.0, range=0.3)
    mine, std = SimpleKriging(variogram).fit(x, e).predict(targets, return_std=True)
    np.testing.assert_allclose(mine, mean, atol=1e-7)
    np.testing.assert_allclose(std**2, variance, atol=1e-7)
    model = VecchiaKriging(60, variogram).fit(x, e)
    assert model.beta_[0, 0] == pytest.approx(0.1332987951569549, abs=1e-9)  # taken off before the likelihood
    assert model.log_likelihood_[0] == pytest.approx(-195.93753006461216, abs=1e-6)


@settings(max_examples=examples(10))
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3]))
def test_gstlearn_vector(seed, d):
    """Ordinary cokriging with a linear model of coregionalisation: nugget, exponential and spherical."""
    gstlearn = pytest.importorskip("gstlearn")
    gstlearn.defineDefaultSpace(gstlearn.ESpaceType.RN, d)
    rng = np.random.default_rng(seed)
    x, e, targets = rng.random((25, d)), rng.standard_normal((25, 2)), rng.random((8, d))
    roots = rng.standard_normal((3, 2, 2))
    sills = roots @ roots.transpose(0, 2, 1)
    names = [f"x{k}" for k in range(d)]
    samples, grid = gstlearn.Db.create(), gstlearn.Db.create()
    for data, points in ((samples, x), (grid, targets)):
        for k, name in enumerate(names):
            data[name] = points[:, k]
        data.setLocators(names, gstlearn.ELoc.X)
    for k in range(2):
        samples[f"z{k}"] = e[:, k]
    samples.setLocators(["z0", "z1"], gstlearn.ELoc.Z)
    model = gstlearn.Model(gstlearn.CovContext(2, d))
    kinds = (gstlearn.ECov.NUGGET, 1.0), (gstlearn.ECov.EXPONENTIAL, 0.5), (gstlearn.ECov.SPHERICAL, 0.8)
    for (kind, length), sill in zip(kinds, sills, strict=True):
        matrix = gstlearn.MatrixSymmetric.createFromVD(sill.ravel())
        model.addCovFromParam(kind, range=length, sills=matrix, flagRange=False)
    model.setDriftIRF(0)
    assert gstlearn.kriging(samples, grid, model, gstlearn.NeighUnique.create()) == 0
    structures = [
        VariogramModel("nugget", nugget=1.0),
        VariogramModel("exponential", sill=1.0, range=0.5),
        VariogramModel("spherical", sill=1.0, range=0.8),
    ]
    mean, std = VectorKriging(structures, sills, exact=True).fit(x, e).predict(targets, return_std=True)
    for k in range(2):
        np.testing.assert_allclose(mean[:, k], grid[f"Kriging.z{k}.estim"], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(std[:, k], grid[f"Kriging.z{k}.stdev"], rtol=1e-9, atol=1e-9)
