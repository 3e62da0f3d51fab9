"""Fixtures that every test may use."""

from __future__ import annotations

import io
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")  # before numpy is imported: each test worker, and its children, have one

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a background job of a shell
    signal.signal(signal.SIGINT, signal.default_int_handler)

import numpy as np
import pytest
from hypothesis import settings
from tests.kept import kept
from tests.tiers import EXHAUSTIVE, examples, second_tier

import truepose
from truepose.numerics.threads import cores

# an example may take as long as a busy machine needs
settings.register_profile("this tier", deadline=None, max_examples=examples(100))
settings.load_profile("this tier")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the second tier out, unless it is asked for (see tests/tiers.py)."""
    if second := [] if EXHAUSTIVE else second_tier(items):
        left_out = set(second)
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=second)


def pytest_xdist_auto_num_workers() -> int:
    """Return how many test workers ``-n auto`` starts: as the variable of xdist says, or one more than processors.

    Tests wait for processes and pages for a part of the time.
    """
    return int(os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS") or cores() + 1)


@pytest.fixture(autouse=True, scope="session")
def _state_of_session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep fixtures of wider scope, too, from what the user's own folder remembers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRUEPOSE_STATE", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder where corrected programs are remembered: another for each test, and never the user's own."""
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("TRUEPOSE_STATE", str(folder))
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20160622)


@pytest.fixture(scope="session")
def ur10() -> Path:
    """The folder of a UR10's measurements: samples.csv, and README.md with its source."""
    return Path(truepose.__file__).parent / "samples" / "data" / "ur10"


@pytest.fixture(scope="session")
def virtual_cell() -> Path:
    """The folder of ``truepose demo``, made once for all test workers and runs; copy it, and change the copy only."""
    from truepose.studies.demo import run_demo

    return kept("virtual-cell", lambda folder: run_demo(folder, progress=lambda _: None))


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of a report's text: pictures take most of the time."""
    from truepose.report.plots import figures

    picture = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"></svg>'
    for name in ("error_arrows", "histogram", "maps", "variogram"):
        monkeypatch.setattr(figures, name, lambda *_: picture)


@pytest.fixture
def quick_hashes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Argon2id with small parameters, for tests that are about everything else."""
    from argon2 import PasswordHasher

    from truepose.store import passwords

    cheap = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
    monkeypatch.setattr(passwords, "_hasher", lambda: cheap)


@dataclass(frozen=True)
class Run:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    def failed(self) -> str:
        """Return the one line on stderr of a command that refused or failed."""
        assert self.code == 1, self
        assert self.err.count("\n") == 1, self.err
        assert "Traceback" not in self.err
        assert self.err.startswith("truepose: ")
        return self.err


def _run(*arguments: object) -> Run:
    from truepose.cli import main

    out, err, code = io.StringIO(), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["truepose", *map(str, arguments)])
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return Run(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session")
def run() -> Callable[..., Run]:
    """Run ``truepose`` with arguments, as the installed command does, and return what it printed."""
    return _run
