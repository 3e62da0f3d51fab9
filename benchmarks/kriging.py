"""Kriging of three components: all samples, the nearest ones, leave-one-out; the same covariance on every side.

A peer that takes one component at a time does one, and its time per item is three times that. scikit-learn's process
has a known mean (simple Kriging), which is less work than ordinary Kriging.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.harness import Job
from truepose.predictors import LocalKriging, OrdinaryKriging, VecchiaKriging
from truepose.similarity import VariogramModel

TITLE = "Benchmarks: Kriging"
PACKAGES = ("truepose", "numpy", "scipy", "numba", "scikit-learn", "PyKrige", "gpboost")
MODEL = VariogramModel("matern32", nugget=0.05, sill=1.0, range=0.4)
COMPONENTS = 3
FIRST_CALL = (
    "import numpy as np; from truepose import LocalKriging, OrdinaryKriging, VariogramModel as V;"
    "x = np.random.default_rng(0).random((50, 3)); v = V('matern32', nugget=.1, sill=1, range=.5);"
    "[m.fit(x, x).predict(x, return_std=True) for m in (OrdinaryKriging(v), LocalKriging(8, v))]"
)


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    m, n, many = (2_000, 300, 2_000) if quick else (100_000, 2_000, 20_000)
    few, part, hundred = m // 10, m // 5, 100
    x, e, targets = _problem(n, m)
    wide, wide_e, _ = _problem(many, 1)

    whole, local = _peak("OrdinaryKriging", n, m), _peak("LocalKriging", many, m)
    yield Job(
        f"ordinary Kriging, n = {n:,}, {m:,} targets, mean, fit included",
        {
            "truepose": lambda: OrdinaryKriging(MODEL).fit(x, e).predict(targets),
            "scikit-learn GPR": _scikit_learn(x, e, targets, False),
        },
        items=m,
        target=">= 8",
    )
    yield Job(
        f"the same with variance, float64 (ours takes {whole} MB at its peak; pykrige: {few:,} targets)",
        {
            "truepose": lambda: OrdinaryKriging(MODEL).fit(x, e).predict(targets, return_std=True),
            "scikit-learn GPR": _scikit_learn(x, e, targets, True),
            "pykrige": _pykrige(x, e, targets[:few], {}),
        },
        items=m,
        counts={"pykrige": few // COMPONENTS},
        target=">= 1.3; >= 18",
    )
    yield Job(
        f"local Kriging k = 32, n = {many:,}, {m:,} targets, mean and variance, fit included (ours takes {local} MB at "
        f"its peak; gpboost: {part:,} targets, pykrige: {hundred})",
        {
            "truepose": lambda: LocalKriging(32, MODEL).fit(wide, wide_e).predict(targets, return_std=True),
            "truepose, one drift (Vecchia)": lambda: (
                VecchiaKriging(32, MODEL).fit(wide, wide_e).predict(targets, return_std=True)
            ),
            "gpboost, Vecchia 32": _gpboost(wide, wide_e, targets[:part]),
            "pykrige": _pykrige(wide, wide_e, targets[:hundred], {"backend": "loop", "n_closest_points": 32}),
        },
        items=m,
        counts={"gpboost, Vecchia 32": part // COMPONENTS, "pykrige": hundred // COMPONENTS},
        target=">= 40; >= 200",
    )
    left_out = 10
    yield Job(
        f"leave-one-out, n = {n:,}, fit included (refitting: {left_out} of them)",
        {
            "truepose": lambda: OrdinaryKriging(MODEL).fit(x, e).leave_one_out(),
            "refitting": lambda: _refit(x, e, left_out),
        },
        items=n,
        counts={"refitting": left_out},
        target=">= 300",
    )
    yield Job(
        "start of Python, global and local Kriging of 50 samples",
        {"kernels from the cache": lambda: _fresh(None), "first call ever: kernels compiled": _compiled},
    )


def _peak(kriging: str, n: int, m: int) -> int:
    """Return by how much fit and prediction raise the resident memory of a fresh process [MB]; kernels are loaded."""
    code = (
        "import numpy as np, truepose as tp; from resource import RUSAGE_SELF, getrusage as use;"
        "v = tp.VariogramModel('matern32', nugget=.05, sill=1, range=.4); rng = np.random.default_rng(0);"
        f"k = tp.{kriging}(variogram=v); s = rng.random((50, 3)); k.fit(s, s).predict(s, return_std=True);"
        f"x, t = rng.random(({n}, 3)), rng.random(({m}, 3)); before = use(RUSAGE_SELF).ru_maxrss;"
        "k.fit(x, x).predict(t, return_std=True);"
        "print(round((use(RUSAGE_SELF).ru_maxrss - before) / 1024))"
    )
    return int(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)


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


def _pykrige(x: Any, e: Any, targets: Any, options: dict[str, Any]) -> Callable[[], object] | str:
    try:
        pykrige = importlib.import_module("pykrige")
    except ImportError:
        return "not installed"

    def call() -> object:  # no Matérn there: exponential, which costs the same
        ones = (np.ones(2),) * 3  # its leave-one-out statistics cost n⁴ and are no part of the job
        with warnings.catch_warnings(), mock.patch("pykrige.ok3d._find_statistics", return_value=ones):
            warnings.simplefilter("ignore")
            parameters = {"psill": 1.0, "range": 3 * 0.4, "nugget": MODEL.nugget}
            kriging = pykrige.OrdinaryKriging3D(
                *x.T, e[:, 0], variogram_model="exponential", variogram_parameters=parameters
            )
            return kriging.execute("points", *targets.T, **options)

    return call


def _gpboost(x: Any, e: Any, targets: Any) -> Callable[[], object] | str:
    try:
        gpboost = importlib.import_module("gpboost")
    except ImportError:
        return "not installed"

    def call() -> object:
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
                gp_coords_pred=targets,
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
