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


def test_what_was_understood_comes_before_what_is_computed(run, folder):
    folder, _ = folder
    args = ["import", folder / "cell.toml", folder / "wide.txt", "--plan", folder / "plan.csv"]
    done = run(*args, "--columns", "x=8, y=9, z=10, unit=m", "--out", folder / "e.csv")
    lines = done.out.splitlines()
    assert lines.index("30 readings for 30 points of the plan gave 30 samples.") < next(
        i for i, text in enumerate(lines) if text.startswith("Error after registration")
    )
