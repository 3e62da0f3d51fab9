"""A fitted map of a virtual KUKA cell, and a program whose targets are places of its samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp

FRAMES = "\n[frames.tools.1]\n{tool}\n[frames.bases.1]\nx_mm = 500.0\na_deg = 30.0\n"


@pytest.fixture(scope="session")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=4)


@pytest.fixture(scope="session")
def cell_text(virtual) -> str:
    """The virtual cell's own file, with the frames of the programs."""
    tool = virtual.tf_flange_tool[:3, 3]
    lines = "\n".join(f"{axis}_mm = {value!r}" for axis, value in zip("xyz", tool.tolist(), strict=True))
    return virtual.cell.to_toml() + FRAMES.format(tool=lines)


@pytest.fixture(scope="session")
def samples(virtual) -> tp.Samples:
    """Samples with the positions that a controller shows, to 0.01 mm."""
    found = virtual.measure(virtual.design(80, seed=1))
    return replace(found, p_cmd=np.round(found.p_cmd, 2))


@pytest.fixture(scope="session")
def map_path(cell_text, samples, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.truepose"
    tp.fit_cell(tp.Cell.from_toml(cell_text), samples, "ordinary-kriging").save(path)
    return path


@pytest.fixture(scope="session")
def error_map(map_path) -> tp.ErrorMap:
    return tp.load_map(map_path)


@pytest.fixture
def krl(virtual, samples, tmp_path) -> Callable[..., Path]:
    """Write a program that moves to places of samples, turned by `turn` [deg]; `head` stands before them."""

    def write(
        head: str = "BAS(#TOOL,1)\n$BASE=$NULLFRAME\n", rows: slice = slice(2), name: str = "a.src", turn: float = 0.0
    ) -> Path:
        poses = virtual.robot.forward(samples.q[rows], tool=virtual.tf_flange_tool)
        abc = np.add(tp.euler("kuka", Rotation.from_matrix(poses[:, :3, :3])), [turn, 0.0, 0.0])
        lines = [
            "LIN {" + ",".join(f"{k} {v:.3f}" for k, v in zip("XYZABC", row, strict=True)) + "}\n"
            for row in np.column_stack([poses[:, :3, 3], abc])
        ]
        path = tmp_path / name
        path.write_text("DEF a()\n" + head + "".join(lines) + "END\n")
        return path

    return write
