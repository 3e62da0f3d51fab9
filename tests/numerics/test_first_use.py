"""`truepose warm-up` compiles all that the package uses, and commands that must compile say so; in fresh processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from truepose.cli import output

TYPICAL_USES = """
import json, sys, warnings
import numpy as np
import truepose as tp
from truepose.numerics.first_use import KERNELS
from truepose.numerics.warm_up import GROUPS
from truepose.predictors import make_predictor
from truepose.similarity import experimental_variogram, fit_likelihood, fit_variogram, permutation_envelope

for warm in GROUPS.values():
    warm()
ready = {kernel: set(kernel.signatures) for kernel in KERNELS}
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
more = [kernel.__name__ for kernel in KERNELS if set(kernel.signatures) - ready.get(kernel, set())]
print(json.dumps({"more": more, "ready": sum(map(bool, ready.values()))}))
"""


def fresh(cache: Path | None, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a process of its own; `cache` is its folder of compiled kernels, by default the usual one."""
    environment = os.environ if cache is None else os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True, env=environment)


@pytest.mark.exhaustive
def test_typical_uses_need_no_other_types_than_warm_up_compiles(tmp_path: Path) -> None:
    found = json.loads(fresh(None, "-c", TYPICAL_USES, str(tmp_path / "map.frozen")).stdout)
    assert found["more"] == []
    assert found["ready"] > 10
    again = fresh(None, "-m", "truepose", "warm-up")
    assert (again.stdout, again.stderr) == ("All kernels have been compiled before; there is nothing to do.\n", "")


@pytest.mark.exhaustive
def test_compiling_is_announced_once_and_loading_never(tmp_path: Path) -> None:
    code = (
        "from truepose.cli.output import working\n"
        "import numpy as np\n"
        "for quiet in {!r}:\n"
        "    with working(quiet=quiet):\n"
        "        from truepose.numerics.pairs import smallest_gap\n"
        "        print(smallest_gap(np.arange(4.0), 1), smallest_gap(np.arange(4), 1))\n"
    )
    first, again = (fresh(tmp_path, "-c", code.format(quiets)) for quiets in ((False, False), (False,)))
    assert first.stdout == "1.0 1.0\n" * 2
    assert first.stderr == output.COMPILING + "\n"
    assert again.stderr == ""
    quiet = fresh(tmp_path / "other", "-c", code.format((True,)))
    assert (quiet.stdout, quiet.stderr) == ("1.0 1.0\n", "")


NOWHERE = """
import warnings
from numba.core import caching
caching.CacheImpl._locator_classes = []  # as where no folder can be written
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("default")
    from truepose.numerics.kernels import np, squared_distances
out = np.zeros(2)
squared_distances(np.array([3.0, 4.0, 0.0]), np.zeros((3, 2)), out)
print(len(said), out.tolist(), said[0].message)
"""


@pytest.mark.exhaustive
def test_without_a_folder_for_the_cache_kernels_compile_with_one_warning() -> None:
    done = subprocess.run([sys.executable, "-c", NOWHERE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1 [25.0, 25.0] compiled loops cannot be kept")
    assert "NUMBA_CACHE_DIR" in done.stdout
