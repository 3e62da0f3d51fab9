"""Semivariograms and fits by maximum likelihood.

Peers: GSTools with its Rust core, whose estimator gives one variogram a call (several fields are averaged), so that
three components take three calls; the averaged call is in the table too. scikit-learn's Gaussian process at the same
likelihood: common scale, no mean, one start; ours looks from two starts and gives standard errors.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks import plain
from benchmarks.harness import Call, Job, Slow
from truepose.similarity import VariogramModel, experimental_variogram, fit_likelihood

TITLE = "Benchmarks: similarity"
PACKAGES = ("truepose", "numpy", "scipy", "numba", "gstools", "gstools-core", "scikit-gstat", "scikit-learn")


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n = 1_000 if quick else 10_000
    yield _variogram(n, 1000 * np.sqrt(3), "all pairs", ">= 80")
    yield _variogram(n, 500 * np.sqrt(3), "lags up to half the extent", ">= 100")
    yield _plain_variogram(1_000 if quick else 2_000)
    yield _likelihood(150 if quick else 1_000)


def _variogram(n: int, largest: float, pairs: str, target: str) -> Job:
    rng = np.random.default_rng(0)
    x, e = rng.random((n, 3)) * 1000, rng.standard_normal((n, 3))
    edges = np.linspace(0.0, largest, 21)
    sides: dict[str, Call | Slow | str] = {"truepose": lambda: experimental_variogram(x, e, bins=edges)}
    try:
        gstools: Any = importlib.import_module("gstools")
        importlib.import_module("gstools_core")
    except ImportError:
        sides["GSTools with its Rust core"] = "not installed"
    else:
        gstools.config.NUM_THREADS = int(os.environ.get("OMP_NUM_THREADS", "1"))
        positions, fields = np.ascontiguousarray(x.T), np.ascontiguousarray(e.T)
        sides["GSTools with its Rust core"] = lambda: [
            gstools.vario_estimate(positions, field, edges, return_counts=True) for field in fields
        ]
        sides["GSTools, the components' mean alone"] = lambda: gstools.vario_estimate(
            positions, fields, edges, return_counts=True
        )
        gamma = np.mean([gstools.vario_estimate(positions[:, :500], f[:500], edges)[1] for f in fields], axis=0)
        ours = experimental_variogram(x[:500], e[:500], bins=edges)
        filled = ours.pairs > 0
        np.testing.assert_allclose(ours.semivariance.mean(axis=1)[filled], gamma[filled], rtol=1e-9)
    return Job(f"variogram, {n:,} points, {pairs}, 20 bins, 3 components", sides, target=target)


def _plain_variogram(n: int) -> Job:
    rng = np.random.default_rng(0)
    x, e = rng.random((n, 3)) * 1000, rng.standard_normal((n, 3))
    edges = np.linspace(0.0, 1000 * np.sqrt(3), 21)
    sides: dict[str, Call | Slow | str] = {
        "truepose": lambda: experimental_variogram(x, e, bins=edges),
        "numpy and scipy": lambda: plain.semivariance(x, e, edges),
    }
    return Job(f"kernel: variogram, {n:,} points, all pairs, 20 bins, 3 components", sides, target=">= 1.5")


def _likelihood(n: int) -> Job:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    rng = np.random.default_rng(1)
    x = rng.random((n, 3)) * 1000
    true = VariogramModel("matern32", nugget=0.05, sill=1.0, range=(250.0, 400.0, 700.0))
    covariance = true.covariance_between(x, x) + true.nugget * np.eye(n)
    e = np.linalg.cholesky(covariance) @ rng.standard_normal((n, 3))
    kernel = ConstantKernel(1.0) * Matern([300.0] * 3, (1.0, 1e5), nu=1.5) + WhiteKernel(0.1, (1e-8, 1e3))

    def ours() -> VariogramModel:
        return fit_likelihood(
            x, e, "matern32", method="ml", ranges="each", drift="none", common_scale=True, largest=None
        )

    def theirs() -> Any:
        return GaussianProcessRegressor(kernel).fit(x, e)

    fit = ours().fit
    assert fit is not None
    np.testing.assert_allclose(fit.log_likelihood, theirs().log_marginal_likelihood_value_, atol=1e-3)  # type: ignore[union-attr]
    return Job(
        f"maximum likelihood, n = {n:,}, 3 ranges and noise, 3 components",
        {"truepose": ours, "scikit-learn": theirs},
        target=">= 4 at the same likelihood",
    )
