"""The files of a small plant: cell, samples, map, updated map and program, as the command line writes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map import update_map
from truepose.geometry import apply_transform
from truepose.samples import Samples, write_samples
from truepose.trackers import write_readings

N = 6
"""The number of targets of the program."""


@dataclass(frozen=True)
class Plant:
    """A folder with files; copy it before a change."""

    folder: Path

    def __getattr__(self, name: str) -> Path:
        names = {"cell": "cell.toml", "samples": "samples.csv", "later": "later.csv", "map": "map.truepose"}
        more = {"updated": "updated.truepose", "program": "part.csv", "readings": "readings.txt"}
        return self.folder / {**names, **more}[name]


@cache
def _kept() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="truepose-plant-")


@cache
def plant() -> Plant:
    """Return the plant; the first call makes it."""
    made = Plant(Path(_kept().name) / "plant")
    made.folder.mkdir()
    virtual = tp.VirtualCell("paper", seed=5)
    samples, later = (virtual.measure(virtual.design(n, seed=n)) for n in (60, 12))
    made.cell.write_text(virtual.cell.to_toml())
    write_samples(made.samples, samples)
    write_samples(made.later, later)
    tp.fit_cell(tp.load_cell(made.cell), tp.read_samples(made.samples), "ordinary-kriging").save(made.map)
    error_map = tp.load_map(made.map)
    update_map(error_map, tp.read_samples(made.later)).save(made.updated)
    poses = error_map.robot.forward(virtual.design(N, seed=3), tool=error_map.tf_flange_tool)
    p = np.round(poses[:, :3, 3], 3)
    angles = tp.euler("kuka", Rotation.from_matrix(poses[:, :3, :3]))
    rows = [f"p{k}," + ",".join(f"{v:.3f}" for v in row) for k, row in enumerate(np.hstack([p, angles]))]
    made.program.write_text("name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n" + "\n".join(rows) + "\n")
    seen = apply_transform(error_map.registration.tf_tracker_base, p + np.array([0.05, 0.0, 0.0]))
    names = np.array([f"p{k}" for k in range(N)])
    write_readings(made.readings, Samples(p_cmd=p, p_meas=seen, name=names), "spatial-analyzer")
    return made
