"""`truepose warm-up` compiles all that the package uses, and commands that must compile say so; in fresh processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from truepose.cli import output

LIST_KERNELS = """
import importlib, json, pkgutil, truepose.numerics
from truepose.numerics.first_use import KERNELS
for module in pkgutil.iter_modules(truepose.numerics.__path__):
    importlib.import_module(f"truepose.numerics.{module.name}")
print(json.dumps(sorted(f"{kernel.__module__}.{kernel.__name__}" for kernel in KERNELS)))
"""

TYPICAL_USES = """
import json, sys, warnings
import numpy as np
import truepose as tp
from truepose.numerics.first_use import KERNELS, compiled_now
from truepose.predictors import make_predictor
from truepose.similarity import experimental_variogram, fit_likelihood, fit_variogram, permutation_envelope

warnings.simplefilter("ignore")
rng = np.random.default_rng(0)
x = rng.uniform(0, 1000, (60, 3))
e = 0.1 * rng.normal(size=x.shape) + 0.3 * np.sin(x / 200)
for options in ({}, {"direction": (0, 0, 1)}, {"estimator": "cressie"}, {"estimator": "genton"}):
    fit_variogram(experimental_variogram(x, e, **options))
permutation_envelope(x, e)
fit_likelihood(x, e)
for name in ("ordinary", "universal", "vector", "local", "vecchia"):
    make_predictor(f"{name}-kriging").fit(x, e).predict(x[:9], return_std=True)
tp.SimpleKriging().fit(x, e).predict(x[:9])
cell = tp.VirtualCell("paper", seed=1)
samples, q = cell.measure(cell.design(60, seed=1), seed=1), cell.design(20, seed=2)
for name in ("kinematic-kriging", "ordinary-kriging", "ordinary-kriging-joint", "calibration"):
    error_map = tp.fit_cell(cell.cell, samples, name)
    error_map.predict(q)
    error_map.correct(cell.robot.forward(q, tool=error_map.tf_flange_tool), on_guard="skip")
    if name in ("kinematic-kriging", "calibration"):
        frozen = error_map.freeze(std=name == "kinematic-kriging")
        frozen.save(sys.argv[1])
        type(frozen).load(sys.argv[1]).predict(q, return_std=name == "kinematic-kriging")
print(json.dumps({"compiled": compiled_now(), "used": sum(bool(kernel.signatures) for kernel in KERNELS)}))
"""


class Fresh:
    """Processes whose cache of compiled kernels is in a folder of their own."""

    def __init__(self, cache: Path) -> None:
        self.cache = cache

    def __call__(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"NUMBA_CACHE_DIR": str(self.cache)}
        return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True, env=environment)


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Fresh, list[str]]:
    """Processes that share a cache, and what `truepose warm-up` compiled into it."""
    fresh = Fresh(tmp_path_factory.mktemp("cache"))
    done = fresh("-m", "truepose", "warm-up", "--json")
    assert done.stderr == ""
    return fresh, json.loads(done.stdout)["compiled"]


def test_warm_up_compiles_every_kernel(warm: tuple[Fresh, list[str]]) -> None:
    fresh, compiled = warm
    assert compiled == json.loads(fresh("-c", LIST_KERNELS).stdout)


def test_nothing_is_left_to_compile(warm: tuple[Fresh, list[str]], tmp_path: Path) -> None:
    fresh, _ = warm
    again = fresh("-m", "truepose", "warm-up")
    assert (again.stdout, again.stderr) == ("All kernels have been compiled before; there is nothing to do.\n", "")
    found = json.loads(fresh("-c", TYPICAL_USES, str(tmp_path / "map.frozen")).stdout)
    assert found["compiled"] == []
    assert found["used"] > 10


def test_compiling_is_announced_once_and_loading_never(tmp_path: Path) -> None:
    code = (
        "from truepose.cli.output import working\n"
        "import numpy as np\n"
        "for quiet in {!r}:\n"
        "    with working(quiet=quiet):\n"
        "        from truepose.numerics.pairs import smallest_gap\n"
        "        print(smallest_gap(np.arange(4.0), 1), smallest_gap(np.arange(4), 1))\n"
    )
    fresh = Fresh(tmp_path)
    first, again = (fresh("-c", code.format(quiets)) for quiets in ((False, False), (False,)))
    assert first.stdout == "1.0 1.0\n" * 2
    assert first.stderr == output.COMPILING + "\n"
    assert again.stderr == ""
    quiet = Fresh(tmp_path / "other")("-c", code.format((True,)))
    assert (quiet.stdout, quiet.stderr) == ("1.0 1.0\n", "")
