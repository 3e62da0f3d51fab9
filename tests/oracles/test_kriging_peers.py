"""Kriging agrees with gstools, pykrige, scikit-learn, gpboost and gstlearn on random problems in 1 to 6 coordinates."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from truepose.predictors import OrdinaryKriging, SimpleKriging, UniversalKriging, VecchiaKriging, VectorKriging
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


def test_gpboost_vecchia(capfd):
    """Its predictions from the nearest samples with a mean of 0, and its likelihood where all are neighbours."""
    gpboost = pytest.importorskip("gpboost")
    rng = np.random.default_rng(3)
    x, e, targets = rng.random((60, 2)), rng.standard_normal(60), rng.random((30, 2))
    variogram = VariogramModel("matern32", nugget=0.1, sill=1.0, range=0.3)
    peer = gpboost.GPModel(
        gp_coords=x, cov_function="matern", cov_fct_shape=1.5, gp_approx="vecchia", num_neighbors=59,
        likelihood="gaussian", num_parallel_threads=1,
    )  # fmt: skip
    parameters = np.array([0.1, 1.0, 0.3])
    peer.set_prediction_data(num_neighbors_pred=60, vecchia_pred_type="order_obs_first_cond_obs_only")
    found = peer.predict(
        y=e, gp_coords_pred=targets, cov_pars=parameters, predict_var=True, predict_response=False
    )  # fmt: skip
    model = VecchiaKriging(60, variogram).fit(x, e)
    simple = SimpleKriging(variogram).fit(x, e)
    mine, std = simple.predict(targets, return_std=True)
    np.testing.assert_allclose(mine, found["mu"], atol=1e-7)
    np.testing.assert_allclose(std**2, found["var"], atol=1e-7)
    likelihood = -peer.neg_log_likelihood(parameters, y=e - model.beta_[0, 0])
    assert model.log_likelihood_[0] == pytest.approx(likelihood, abs=1e-6)


@settings(max_examples=10, deadline=None)
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
