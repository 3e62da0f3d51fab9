"""A small virtual cell on disk, made once."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.kept import kept

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
def demo(run) -> tuple[Path, Any]:
    """The folder and the figures of a demonstration."""

    def make(folder: Path) -> None:
        done = run("demo", folder / "demo", "--seed", "3", "--json")
        assert done.code == 0, done.err
        (folder / "out.json").write_text(done.out, "utf-8")

    folder = kept("demo-of-the-command", make)
    return folder / "demo", json.loads((folder / "out.json").read_text("utf-8"))


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


@pytest.fixture
def near_samples(cell_files, tmp_path):
    """A program whose targets the map may correct: two samples' own places."""
    from truepose.geometry import euler

    samples = cell_files.virtual.measure(cell_files.virtual.design(80, seed=1))
    poses = cell_files.virtual.robot.forward(samples.q, tool=cell_files.virtual.tf_flange_tool)[:2]
    from scipy.spatial.transform import Rotation

    abc = euler("kuka", Rotation.from_matrix(poses[:, :3, :3]))
    rows = np.column_stack([poses[:, :3, 3], abc])
    lines = ["LIN {" + ",".join(f"{k} {v:.3f}" for k, v in zip("XYZABC", row, strict=True)) + "}" for row in rows]
    (tmp_path / "config.dat").write_text(
        "TOOL_DATA[1]={"
        + ",".join(f"{k} {v:.4f}" for k, v in zip("XYZ", cell_files.virtual.tf_flange_tool[:3, 3], strict=True))
        + ",A 0,B 0,C 0}\n"
    )
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.src").write_text("DEF a()\n" + "\n".join(lines) + "\nEND\n")
    return [tmp_path / folder / "a.src" for folder in ("one", "two")]
