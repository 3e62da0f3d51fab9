"""`truepose import`: columns told, several reflectors, plans in a controller's words, what was understood."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.samples import Poses, read_samples, write_samples
from truepose.simulation import VirtualCell


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("import")
    virtual = VirtualCell("hard", seed=6)
    (folder / "cell.toml").write_text(virtual.cell.to_toml())
    samples = virtual.measure(virtual.design(30), seed=1)
    write_samples(folder / "plan.csv", Poses(q=samples.q, p_cmd=samples.p_cmd, rotation_cmd=samples.rotation_cmd))
    rows = (f"movej([{', '.join(map(repr, q.tolist()))}])" for q in samples.q)
    (folder / "plan.script").write_text("\n".join(rows))
    np.savetxt(folder / "wide.txt", np.column_stack([np.arange(30), samples.q, samples.p_meas / 1000]), delimiter=";")
    turns = virtual.read_reflectors(samples.q, 3, seed=1).reshape(-1, 3)
    np.savetxt(folder / "turns.txt", turns, fmt="%.4f")
    np.savetxt(folder / "tool.txt", virtual.reflector_positions(3))
    return folder, samples


def test_columns_are_told_once_and_saved(run, folder):
    folder, measured = folder
    args = ["import", folder / "cell.toml", folder / "wide.txt", "--plan", folder / "plan.csv", "--out"]
    unknown = run(*args, folder / "a.csv")
    assert unknown.code == 1
    assert "unknown layout: 10 columns between semicolons" in unknown.err
    saved = folder / "columns.toml"
    done = run(*args, folder / "a.csv", "--columns", "x=8, y=9, z=10, unit=m", "--save-columns", saved)
    assert done.code == 0, done.err
    assert "wide.txt: stated columns, lengths in m." in done.out
    again = run(*args, folder / "b.csv", "--columns", saved, "--json")
    assert again.json["n"] == 30
    summary = again.json["summary"]
    assert (summary["readings"], summary["missing"], summary["outliers"], summary["unit"]) == (30, [], [], "m")
    np.testing.assert_allclose(read_samples(folder / "b.csv").p_meas, measured.p_meas, atol=1e-8)


def test_reflectors_and_a_plan_in_the_controllers_words(run, folder):
    folder, measured = folder
    args = ["import", folder / "cell.toml", folder / "turns.txt", "--plan", folder / "plan.script", "--out"]
    done = run(*args, folder / "c.csv", "--reflectors", folder / "tool.txt")
    assert done.code == 0, done.err
    assert "Each pose is combined from 3 reflectors." in done.out
    poses = read_samples(folder / "c.csv")
    assert poses.rotation_meas is not None
    assert np.linalg.norm(poses.p_meas - measured.p_meas, axis=1).max() < 0.3
    done = run(*args, folder / "d.csv", "--reflectors", "3", "--keep", "2", "--json")
    assert done.code == 0, done.err
    assert read_samples(folder / "d.csv").rotation_meas is None


@pytest.mark.exhaustive
def test_all_reflectors_are_kept_fitted_and_used(run, folder):
    """Import, fit, validate, predict and correct with three reflectors, of which one is missing at a pose."""
    folder, measured = folder
    virtual = VirtualCell("hard", seed=6)
    cell = folder / "several.toml"
    cell.write_text(virtual.cell_with(3).to_toml())
    readings = np.loadtxt(folder / "turns.txt")
    readings[7] = 0.0
    np.savetxt(folder / "lacking.txt", readings, fmt="%.4f")
    (folder / "mask.csv").write_text("point,reason\nP20,beam was cut\nP21/A,beam was cut\n")
    args = ["import", cell, folder / "lacking.txt", "--plan", folder / "plan.csv", "--reflectors", "each"]
    done = run(*args, "--out", folder / "rows.csv", "--mask", folder / "mask.csv")
    assert done.code == 0, done.err
    assert "Each pose has a row for each of 3 reflectors; some are missing at 1." in done.out
    rows = read_samples(folder / "rows.csv")
    assert (len(rows), len(rows.excluded), rows.reflector[6:9].tolist()) == (85, 4, ["A", "C", "A"])
    np.testing.assert_allclose(rows.p_cmd[0], measured.p_cmd[0])
    out = folder / "several.truepose"
    assert run("fit", cell, folder / "rows.csv", "--out", out, "--predictor", "kinematic-kriging").code == 0
    held = virtual.measure_each(virtual.design(12, seed=9), seed=2)
    write_samples(folder / "held.csv", held)
    assert run("validate", out, folder / "held.csv", "--json").json["after"]["mean_mm"] < 0.1
    write_samples(folder / "poses.csv", Poses(q=held.q[::3]))
    assert run("predict", out, folder / "poses.csv", "--out", folder / "predicted.csv").code == 0
    program = folder / "program.src"
    p, turn = measured.p_cmd[3] + 1.0, np.rad2deg(measured.rotation_cmd[3].as_euler("ZYX"))
    pose = ", ".join(f"{key} {value:.4f}" for key, value in zip("XYZABC", [*p, *turn], strict=True))
    home = ", ".join(f"A{k} {value:.4f}" for k, value in enumerate(np.rad2deg(measured.q[3]), start=1))
    tool = "X 110.0, Y 0.0, Z 360.0, A 0.0, B 0.0, C 0.0"
    base = "X 0.0, Y 0.0, Z 0.0, A 0.0, B 0.0, C 0.0"
    program.write_text(f"DEF program()\n$TOOL = {{{tool}}}\n$BASE = {{{base}}}\nPTP {{{home}}}\nLIN {{{pose}}}\nEND\n")
    done = run("correct", out, program, "--out", folder / "corrected")
    assert done.code == 0, done.err
    assert (folder / "corrected" / "program.src").read_text() != program.read_text()
    none = run(*args[:2], folder / "lacking.txt", *args[3:], "--out", folder / "no.csv", "--keep", "1")
    assert none.code != 0
    assert "leave out --keep" in none.err
    plain = run("import", folder / "cell.toml", *args[2:], "--out", folder / "no.csv")
    assert "states no reflectors; add [reflectors.A]" in plain.err


def test_what_was_understood_comes_before_what_is_computed(run, folder):
    folder, _ = folder
    args = ["import", folder / "cell.toml", folder / "wide.txt", "--plan", folder / "plan.csv"]
    done = run(*args, "--columns", "x=8, y=9, z=10, unit=m", "--out", folder / "e.csv")
    lines = done.out.splitlines()
    assert lines.index("30 readings for 30 points of the plan gave 30 samples.") < next(
        i for i, text in enumerate(lines) if text.startswith("Error after registration")
    )
