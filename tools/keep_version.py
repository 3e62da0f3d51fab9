"""Write the files that a version leaves with its users, so that later versions are tested to read them.

``python tools/keep_version.py 0.3.0`` writes tests/project/versions/0.3.0.zip with the truepose that is imported: a
cell file, maps with their predictions, a corrected program with its record, and the list of corrected programs. Run it
once for each release with a new minor version.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Final

import numpy as np

import truepose as tp
from truepose.robots import status_turn

GOAL: Final = Path(__file__).resolve().parents[1] / "tests" / "project" / "versions"
PREDICTORS: Final = ("kinematic-kriging", "calibration", "ordinary-kriging-joint", "universal-kriging", "idw")
TARGETS: Final = ((1700.0, 120.0, 900.0), (1660.0, 180.0, 920.0))
PRESET: Final = "paper"


def main(version: str) -> None:
    """Write the .zip of a version."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TRUEPOSE_STATE"] = str(folder / "state")
        kept = folder / "kept"
        kept.mkdir()
        virtual = tp.VirtualCell(PRESET)
        (kept / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
        tp.write_samples(kept / "samples.csv", virtual.measure(virtual.design(30)))
        with contextlib.chdir(kept):  # maps and records hold paths as they are given
            write_maps(virtual)
            write_program(virtual)
        GOAL.mkdir(exist_ok=True)
        with zipfile.ZipFile(GOAL / f"{version}.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(kept.rglob("*.*")):
                archive.write(path, path.relative_to(kept))


def write_maps(virtual: tp.VirtualCell) -> None:
    """Write maps of some predictors into the working directory, and what they predict."""
    cell, samples = tp.load_cell("cell.toml"), tp.read_samples("samples.csv")
    q, maps = virtual.design(3, seed=5), {}
    for name in PREDICTORS:
        path = f"{name}.truepose"
        tp.fit_cell(cell, samples, name).save(path)
        error_map = tp.load_map(path)
        p, std = error_map.predict_measured(q)
        maps[path] = {"sha256": error_map.hash, "p_mm": p.tolist(), "std_mm": std.tolist()}
    found = {"q_rad": q.tolist(), "maps": maps}
    Path("predictions.json").write_text(json.dumps(found, indent=1) + "\n", "utf-8")


def write_program(virtual: tp.VirtualCell) -> None:
    """Write a program, and its correction with the record into the folder ``corrected``."""
    folder = Path("program")
    folder.mkdir()
    a, b, c = virtual.cell.region.a_deg, virtual.cell.region.b_deg, virtual.cell.region.c_deg
    status, turn = status_turn(virtual.robot, virtual.reach(np.array(TARGETS)))
    points = "".join(
        f"DECL E6POS XP{i}={{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f},S {s},T {t},E1 0.0}}\n"
        f'DECL FDAT FP{i}={{TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}}\n'
        for i, ((x, y, z), s, t) in enumerate(zip(TARGETS, status, turn, strict=True), 1)
    )
    tool = virtual.cell.tool
    frame = f"X {tool.x_mm},Y {tool.y_mm},Z {tool.z_mm},A {tool.a_deg},B {tool.b_deg},C {tool.c_deg}"
    (folder / "panel.src").write_text("&ACCESS RVP\nDEF panel( )\nPTP XP1\nLIN XP2\nEND\n", "utf-8")
    (folder / "panel.dat").write_text(f"&ACCESS RVP\nDEFDAT PANEL\n{points}ENDDAT\n", "utf-8")
    (folder / "$config.dat").write_text(f"DEFDAT $CONFIG PUBLIC\nTOOL_DATA[3]={{{frame}}}\nENDDAT\n", "utf-8")
    frames = tp.FrameTable.from_config_dat(folder / "$config.dat")
    error_map = tp.load_map("kinematic-kriging.truepose")
    tp.correct_program(folder / "panel.src", error_map, frames=frames).write("corrected")


if __name__ == "__main__":
    main(*sys.argv[1:])
