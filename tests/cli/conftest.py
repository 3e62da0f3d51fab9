"""A small virtual cell on disk, made once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from truepose.samples import write_samples
from truepose.simulation import VirtualCell


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
def demo(tmp_path_factory, run) -> tuple[Path, Any]:
    """The folder and the figures of a demonstration."""
    folder = tmp_path_factory.mktemp("demo")
    done = run("demo", folder, "--seed", "3", "--json")
    assert done.code == 0, done.err
    return folder, done.json


@pytest.fixture(scope="session")
def cell_files(tmp_path_factory, run) -> CellFiles:
    virtual = VirtualCell("paper", seed=4)
    files = CellFiles(tmp_path_factory.mktemp("cell"), virtual)
    files.cell.write_text(virtual.cell.to_toml())
    write_samples(files.samples, virtual.measure(virtual.design(80, seed=1)))
    write_samples(files.test, virtual.measure(virtual.design(40, seed=2)))
    done = run("fit", files.cell, files.samples, "--predictor", "ordinary-kriging", "--out", files.map)
    assert done.code == 0, done.err
    return files
