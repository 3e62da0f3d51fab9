"""Everything that ``correct`` writes is verified as it lies there, or refused with what helps; and corrected once."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.robots import status_turn

N = 12


@dataclass
class Plant:
    """A map, a KUKA backup as a folder and as a .zip, a folder of plain programs, and readings of a corrected run."""

    folder: Path
    map: Path
    readings: Path

    def given(self, form: str) -> Path:
        return (
            self.folder
            / {"backup folder": "back", "backup zip": "back.zip", "folder": "plain", "file": "plain/a.csv"}[form]
        )


def _frame(tf: np.ndarray) -> str:
    abc = tp.euler("kuka", Rotation.from_matrix(tf[None, :3, :3]))[0]
    return ",".join(f"{key} {v:.4f}" for key, v in zip("XYZABC", [*tf[:3, 3], *abc], strict=True))


@pytest.fixture(scope="module")
def plant(tmp_path_factory) -> Plant:
    folder = tmp_path_factory.mktemp("plant")
    virtual = tp.VirtualCell("paper", seed=4)
    (folder / "cell.toml").write_text(virtual.cell.to_toml().replace("[tracker]", "[tracker]\nstd_mm = 0.01"))
    cell = tp.load_cell(folder / "cell.toml")
    error_map = tp.fit_cell(cell, virtual.measure(virtual.design(60, seed=60), seed=60), "kinematic-kriging")
    error_map.save(folder / "map.truepose")
    q = virtual.design(N, seed=3)
    poses = error_map.robot.forward(q, tool=error_map.tf_flange_tool)
    root = folder / "back" / "KRC" / "R1"
    for name in ("System", "Program", "Mada"):
        (root / name).mkdir(parents=True)
    tool = _frame(error_map.tf_flange_tool)
    frames = f'TOOL_DATA[1]={{{tool}}}\nBASE_DATA[1]={{{_frame(np.eye(4))}}}\nBASE_NAME[1,]="cell"\n'
    (root / "System" / "$config.dat").write_text(f"DEFDAT $CONFIG PUBLIC\n{frames}ENDDAT\n")
    (root / "Mada" / "$machine.dat").write_text(f"DEFDAT $MACHINE PUBLIC\n$ROBROOT={{{_frame(np.eye(4))}}}\nENDDAT\n")
    status, turn = status_turn(error_map.robot, q)
    for name, rows in (("alpha", range(6)), ("beta", range(6, N))):
        steps = "".join(f"PTP XP{k}\n" for k in rows)
        points = "".join(f"DECL E6POS XP{k}={{{_frame(poses[k])},S {status[k]},T {turn[k]}}}\n" for k in rows)
        (root / "Program" / f"{name}.src").write_text(f"DEF {name}( )\nBAS(#TOOL,1)\nBAS(#BASE,1)\n{steps}END\n")
        (root / "Program" / f"{name}.dat").write_text(f"DEFDAT {name.upper()}\n{points}ENDDAT\n")
    shutil.make_archive(str(folder / "back"), "zip", folder / "back")
    (folder / "plain").mkdir()
    abc = tp.euler("kuka", Rotation.from_matrix(poses[:, :3, :3]))
    rows = [",".join([f"P{k}", *(f"{v:.4f}" for v in [*poses[k, :3, 3], *abc[k]])]) for k in range(N)]
    (folder / "plain" / "a.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg", *rows]) + "\n")
    tf = error_map.registration.tf_tracker_base
    p = (poses[:, :3, 3] + np.random.default_rng(0).normal(0.0, 0.02, (N, 3))) @ tf[:3, :3].T + tf[:3, 3]
    lines = [f"P{k},{','.join(f'{v:.4f}' for v in row)}" for k, row in enumerate(p)]
    (folder / "all.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *lines]) + "\n")
    return Plant(folder, folder / "map.truepose", folder / "all.csv")


CASES = {
    # what is corrected, how it is written, what is verified, and what comes of it
    ("backup folder", "changed", "out"): "copy them with the records over it, or correct with --whole",
    ("backup zip", "changed", "out"): "copy them with the records over it, or correct with --whole",
    ("backup folder", "whole", "out"): "PASS",
    ("backup folder", "whole", "out/back"): "PASS",
    ("backup zip", "whole", "out"): "PASS",
    ("backup zip", "whole", "out/back.zip"): "PASS",
    ("backup folder", "merged", "merged"): "PASS",
    ("backup folder", "merged", "merged/KRC/R1/Program/alpha.src"): "or name the folder of its backup",
    ("folder", "changed", "out"): "PASS",
    ("file", "changed", "out/a.csv"): "PASS",
    ("folder", "in place", "here"): "PASS",
    ("file", "in place", "here"): "PASS",
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("form", "how", "where"), CASES)
def test_what_correct_writes_is_verified_where_it_lies(run, plant, tmp_path, form, how, where):
    given, wanted = plant.given(form), CASES[form, how, where]
    options = ["--tolerance", "0.4", "--cell", plant.folder / "cell.toml"]
    if how == "in place":
        work = tmp_path / given.name
        (shutil.copytree if given.is_dir() else shutil.copy)(given, work)
        assert run("correct", plant.map, work, "--in-place", "--on-guard", "skip").code == 0
        place = work
    else:
        more = ["--whole"] if how == "whole" else []
        done = run("correct", plant.map, given, "--out", tmp_path / "out", "--on-guard", "skip", *more)
        assert done.code == 0, done.err
        if how == "merged":
            shutil.copytree(plant.folder / "back", tmp_path / "merged")
            shutil.copytree(tmp_path / "out" / "KRC", tmp_path / "merged" / "KRC", dirs_exist_ok=True)
        place = tmp_path / where
    found = run("verify", plant.map, place, plant.readings, *options)
    assert wanted in " ".join((found.out + found.err).split())
    if wanted == "PASS":
        again = run("correct", plant.map, place, "--out", tmp_path / "again", "--on-guard", "skip")
        assert (again.code, "corrected already" in again.err) == (1, True)
        record = run("report", plant.map, "--program", tmp_path, "--out", tmp_path / "r.html", "--json")
        assert record.code == 0


@pytest.mark.parametrize("form", ["backup folder", "backup zip", "folder"])
def test_an_original_does_not_pass_with_readings_of_a_corrected_run(run, plant, form):
    found = run("verify", plant.map, plant.given(form), plant.readings, "--tolerance", "0.4")
    assert (found.code, "NOT ASSESSED" in found.out) == (1, True)
    assert "The readings are those of a corrected run" in " ".join(found.out.split())
