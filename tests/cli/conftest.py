"""A small virtual cell on disk, made once, and a way to run the command line."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from truepose.samples import write_samples
from truepose.simulation import VirtualCell


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


@dataclass(frozen=True)
class CellFiles:
    folder: Path
    virtual: VirtualCell

    def __getattr__(self, name: str) -> Path:
        return (
            self.folder
            / {"cell": "cell.toml", "samples": "samples.csv", "test": "test.csv", "map": "map.truepose"}[name]
        )


@pytest.fixture(scope="session")
def demo(tmp_path_factory) -> tuple[Path, Any]:
    """The folder and the figures of a demonstration."""
    folder = tmp_path_factory.mktemp("demo")
    done = _run("demo", folder, "--seed", "3", "--json")
    assert done.code == 0, done.err
    return folder, done.json


@pytest.fixture(scope="session")
def cell_files(tmp_path_factory) -> CellFiles:
    virtual = VirtualCell("paper", seed=4)
    files = CellFiles(tmp_path_factory.mktemp("cell"), virtual)
    files.cell.write_text(virtual.cell.to_toml())
    write_samples(files.samples, virtual.measure(virtual.design(80, seed=1)))
    write_samples(files.test, virtual.measure(virtual.design(40, seed=2)))
    done = _run("fit", files.cell, files.samples, "--predictor", "ordinary-kriging", "--out", files.map)
    assert done.code == 0, done.err
    return files
