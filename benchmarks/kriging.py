"""Kriging of three components: all samples, the nearest ones, leave-one-out; the same covariance on every side.

A peer that takes one component at a time does one, and its time is three times that. A slow peer predicts fewer
targets, and its time for all of them follows on a straight line. scikit-learn's process has a known mean (simple
Kriging), which is less work than ordinary Kriging.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from scipy.spatial import KDTree

from benchmarks import plain
from benchmarks.harness import REPEATS, Call, Job, Memory, Slow
from truepose.predictors import LocalKriging, OrdinaryKriging, Predictor, VecchiaKriging
from truepose.predictors.kriging.system import System
from truepose.similarity import VariogramModel

TITLE = "Benchmarks: Kriging"
PACKAGES = ("truepose", "numpy", "scipy", "numba", "scikit-learn", "PyKrige", "gpboost")
MODEL = VariogramModel("matern32", nugget=0.05, sill=1.0, range=0.4)
COMPONENTS = 3
OFTEN = 100
"""Repeats of a job that takes less than a millisecond."""
FIRST_CALL = (
    "import numpy as np; from truepose import LocalKriging, OrdinaryKriging, VariogramModel as V;"
    "x = np.random.default_rng(0).random((50, 3)); v = V('matern32', nugget=.1, sill=1, range=.5);"
    "[m.fit(x, x).predict(x, return_std=True) for m in (OrdinaryKriging(v), LocalKriging(8, v))]"
)


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    m, n, many = (2_000, 300, 2_000) if quick else (100_000, 2_000, 20_000)
    few, part, left_out = m // 50, m // 10, 10
    x, e, targets = _problem(n, m)
    wide, wide_e, _ = _problem(many, 1)
    loop = {"backend": "loop", "n_closest_points": 32}

    def global_kriging(return_std: bool) -> Call:
        return lambda: _predict(OrdinaryKriging(MODEL).fit(x, e), targets, return_std)

    yield Job(
        f"ordinary Kriging, n = {n:,}, {m:,} targets, mean, fit included",
        {"truepose": global_kriging(False), "scikit-learn GPR": _scikit_learn(x, e, targets, False)},
        items=m,
        memory=_memory(OrdinaryKriging(MODEL), n, m, False),
        target=">= 8",
    )
    yield Job(
        f"the same with variance, float64 (pykrige: from {few:,} and {part:,} targets; with the statistics that its "
        "constructor takes: once)",
        {
            "truepose": global_kriging(True),
            "truepose, variance in single precision": lambda: _predict(
                OrdinaryKriging(MODEL, single_variance=True).fit(x, e), targets, True
            ),
            "scikit-learn GPR": _scikit_learn(x, e, targets, True),
            "pykrige without its statistics": _peer(_pykrige, (x, e, targets, {}), few, part),
            "pykrige": _peer(_pykrige, (x, e, targets, {}, True), m),
        },
        items=m,
        memory=_memory(OrdinaryKriging(MODEL), n, m, True),
        target=">= 1.3; >= 18",
    )
    yield Job(
        f"local Kriging k = 32, n = {many:,}, {m:,} targets, mean and variance, fit included "
        f"(gpboost: from {few:,} and {part:,} targets; pykrige: once, without its statistics)",
        {
            "truepose": lambda: LocalKriging(32, MODEL).fit(wide, wide_e).predict(targets, return_std=True),
            "truepose, one drift (Vecchia)": lambda: (
                VecchiaKriging(32, MODEL).fit(wide, wide_e).predict(targets, return_std=True)
            ),
            "gpboost, Vecchia 32": _peer(_gpboost, (wide, wide_e, targets), few, part),
            "pykrige": _peer(_pykrige, (wide, wide_e, targets, loop), m),
        },
        items=m,
        memory=_memory(LocalKriging(32, MODEL), many, m, True),
        target=">= 40; >= 200",
    )
    yield from _small_jobs()
    yield from _kernel_jobs(quick)
    yield Job(
        f"leave-one-out, n = {n:,}, fit included (refitting: {left_out} of them)",
        {
            "truepose": lambda: OrdinaryKriging(MODEL).fit(x, e).leave_one_out(),
            "refitting": Slow(lambda count: _refit(x, e, count), (left_out,)),
        },
        items=n,
        target=">= 300",
    )
    yield Job(
        "start of Python, global and local Kriging of 50 samples",
        {
            "kernels from the cache": lambda: _fresh(None),
            "first call ever: kernels compiled": Slow(lambda count: _compiled(), (1,), repeats=1),
        },
    )


def _small_jobs() -> Iterator[Job]:
    """Yield jobs of 100 samples and 500 targets, which truepose must not do slower than a few lines of numpy."""
    x, e, targets = _problem(100, 500)
    ours, numpys = OrdinaryKriging(MODEL).fit(x, e), plain.Kriging(MODEL.nugget, 0.4).fit(x, e)
    yield Job(
        "100 samples, 500 targets: mean and variance by a fitted model",
        {
            "truepose": _often(lambda: ours.predict(targets, return_std=True)),
            "numpy in 15 lines": _often(lambda: numpys.predict(targets)),
        },
        items=500 * OFTEN,
        target=">= 1",
    )
    yield Job(
        "fit alone, with a given variogram",
        {
            "truepose": _often(lambda: OrdinaryKriging(MODEL).fit(x, e)),
            "numpy in 15 lines": _often(lambda: plain.Kriging(MODEL.nugget, 0.4).fit(x, e)),
        },
        items=100 * OFTEN,
        target=">= 1",
    )
    yield Job(
        "fit with a given variogram, and prediction",
        {
            "truepose": _often(lambda: OrdinaryKriging(MODEL).fit(x, e).predict(targets, return_std=True)),
            "numpy in 15 lines": _often(lambda: plain.Kriging(MODEL.nugget, 0.4).fit(x, e).predict(targets)),
        },
        items=500 * OFTEN,
        target=">= 1",
    )


def _kernel_jobs(quick: bool) -> Iterator[Job]:
    """Yield jobs of single kernels beside their plain versions."""
    from truepose.numerics.kernels import MATERN32, cross_correlation, pack
    from truepose.numerics.small_systems import eliminate, pair_distances
    from truepose.similarity.structure import correlation

    n, m = (500, 500) if quick else (2_000, 2_000)
    x, e, targets = _problem(n, m)
    out, packed = np.empty((m, n)), pack(x)
    yield Job(
        f"kernel: {m:,} x {n:,} correlations (Matérn 3/2)",
        {
            "truepose": lambda: cross_correlation(MATERN32, 0.0, targets, packed, out),
            "numba with the C library's exponential, one thread": lambda: plain.matern32_by_loops(targets, x),
            "numpy": lambda: plain.matern32(targets, x),
        },
        items=m * n,
        target=">= 1.5",
    )
    near = np.asarray(KDTree(x).query(targets, k=32)[1], dtype=np.int64)
    rho = correlation(MATERN32, pair_distances(x, targets, near))
    small = (rho, near, 0.95, np.full(n, 1.0), np.zeros(m), np.hstack([np.ones((n, 1)), e]))
    yield Job(
        f"kernel: {m:,} systems of 32 equations, eight at a time",
        {"truepose": lambda: eliminate(*small), "numpy, stacked matrices": lambda: plain.eliminate(*small)},
        items=m,
        target=">= 1.5",
    )
    half = n // 8
    K = plain.matern32(x[:half], x[:half]) + 0.05 * np.eye(half)
    factor, cross = np.linalg.cholesky(K), plain.matern32(targets, x[:half])
    system = System.factorise(K.copy(), np.ones((half, 1)), x[:half])
    yield Job(
        f"kernel: {m:,} targets times the inverse factor of {half} samples",
        {
            "truepose": lambda: system.reduce(cross.copy(), np.ones((m, 1))),
            "scipy, solve_triangular": lambda: plain.reduce(factor, cross),
        },
        items=m,
        target=">= 1.5",
    )


def _often(call: Callable[[], object]) -> Call:
    return lambda: [call() for _ in range(OFTEN)]


def _peer(make: Callable[..., Callable[[int], object]], arguments: tuple[Any, ...], *sizes: int) -> Slow | str:
    """Return a peer of one component that takes parts of the targets often, or all of them once."""
    try:
        call = make(*arguments)
    except ImportError:
        return "not installed"
    return Slow(call, sizes, COMPONENTS, repeats=1 if len(sizes) == 1 else REPEATS)


def _memory(model: Predictor, n: int, m: int, return_std: bool) -> Memory:
    return Memory(
        partial(_fit_and_predict, model, 50, 50, return_std), partial(_fit_and_predict, model, n, m, return_std)
    )


def _fit_and_predict(model: Predictor, n: int, m: int, return_std: bool) -> None:
    x, e, targets = _problem(n, m)
    _predict(model.fit(x, e), targets, return_std)


def _predict(model: Predictor, targets: Any, return_std: bool) -> object:
    return model.predict(targets, return_std=True) if return_std else model.predict(targets)


def _problem(n: int, m: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(0)
    x = rng.random((n, 3))
    return x, np.sin(4 * x) + rng.normal(scale=0.2, size=x.shape), rng.random((m, 3))


def _refit(x: Any, e: Any, count: int) -> None:
    for i in range(count):
        rest = np.arange(len(x)) != i
        OrdinaryKriging(MODEL).fit(x[rest], e[rest]).predict(x[i : i + 1], return_std=True)


def _scikit_learn(x: Any, e: Any, targets: Any, std: bool) -> Callable[[], object]:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import Matern

    kernel = Matern(MODEL.range, nu=1.5)
    return lambda: (
        GaussianProcessRegressor(kernel, alpha=MODEL.nugget, optimizer=None).fit(x, e).predict(targets, return_std=std)
    )


def _pykrige(
    x: Any, e: Any, targets: Any, options: dict[str, Any], statistics: bool = False
) -> Callable[[int], object]:
    import pykrige  # type: ignore[import-untyped]

    parameters = {"psill": 1.0, "range": 3 * 0.4, "nugget": MODEL.nugget}

    def call(count: int) -> object:  # no Matérn there: exponential, which costs the same
        ones = (np.ones(2),) * 3  # its statistics cost n⁴
        skipped = mock.patch("pykrige.ok3d._find_statistics", return_value=ones)
        with warnings.catch_warnings(), contextlib.nullcontext() if statistics else skipped:
            warnings.simplefilter("ignore")
            kriging = pykrige.OrdinaryKriging3D(
                *x.T, e[:, 0], variogram_model="exponential", variogram_parameters=parameters
            )
            return kriging.execute("points", *targets[:count].T, **options)

    return call


def _gpboost(x: Any, e: Any, targets: Any) -> Callable[[int], object]:
    import gpboost  # type: ignore[import-untyped]

    def call(count: int) -> object:
        with contextlib.redirect_stdout(None):
            model = gpboost.GPModel(
                gp_coords=x,
                cov_function="matern",
                cov_fct_shape=1.5,
                gp_approx="vecchia",
                num_neighbors=32,
                likelihood="gaussian",
                num_parallel_threads=int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)),
            )
            model.set_prediction_data(num_neighbors_pred=32, vecchia_pred_type="order_obs_first_cond_obs_only")
            return model.predict(
                y=e[:, 0],
                gp_coords_pred=targets[:count],
                cov_pars=np.array([MODEL.nugget, MODEL.sill, MODEL.range]),
                predict_var=True,
                predict_response=False,
            )

    return call


def _fresh(cache: str | None) -> None:
    environment = os.environ | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    subprocess.run([sys.executable, "-c", FIRST_CALL], check=True, env=environment)


def _compiled() -> None:
    with tempfile.TemporaryDirectory() as cache:
        _fresh(cache)
