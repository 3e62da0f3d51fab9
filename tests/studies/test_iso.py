"""ISO 9283 on samples, for a cell, and by the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.cell import Cell
from truepose.errors import DataError, RobotError
from truepose.samples import read_poses, write_samples
from truepose.studies.performance import EDGES_MM


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("hard", seed=0)


@pytest.fixture(scope="module")
def measured(virtual):
    poses = tp.iso9283_poses(virtual.cell)
    return replace(virtual.measure(poses.q, reflectors=3), name=poses.name)


def test_the_standards_poses(virtual):
    poses = tp.iso9283_poses(virtual.cell)
    assert len(poses) == 150
    assert poses.name[:6].tolist() == ["P1", "P2", "P3", "P4", "P5", "P1"]
    p1, p2, p3, p4, p5 = poses.p_cmd[:5]
    np.testing.assert_allclose((p2 + p4) / 2, p1, atol=1e-9)
    np.testing.assert_allclose((p3 + p5) / 2, p1, atol=1e-9)
    edge = np.linalg.norm(p2 - p3) / 0.8
    assert round(edge) in EDGES_MM
    np.testing.assert_allclose(np.linalg.norm(p2 - p4), 0.8 * np.sqrt(3) * edge)
    np.testing.assert_allclose(np.linalg.norm(p2 - p5), 0.8 * np.sqrt(2) * edge)
    tf = virtual.robot.forward(poses.q, tool=virtual.tf_flange_tool)
    np.testing.assert_allclose(tf[:, :3, 3], poses.p_cmd, atol=1e-6)
    assert virtual.robot.within_limits(poses.q).all()
    assert poses.name is not None


def test_a_cube_that_cannot_be_reached(virtual):
    with pytest.raises(RobotError, match="no cube with edge 5000 mm is within reach and limits on one branch"):
        tp.iso9283_poses(virtual.cell, edge_mm=5000.0)
    with pytest.raises(RobotError, match="no cube with the least edge of the standard, 250 mm"):
        tp.iso9283_poses(virtual.cell, centre_mm=(9000.0, 0.0, 0.0))


@pytest.mark.parametrize("robot", ["universal-robots-ur10", "abb-irb6700-200-260", "fanuc-m20ia"])
def test_cubes_of_other_robots(robot):
    cell = tp.Cell.model_validate({"robot": {"model": robot}})
    poses = tp.iso9283_poses(cell, cycles=1)
    assert len(poses) == 5
    assert np.ptp(poses.p_cmd[:, 0]) > 250 * 0.7


def test_figures_of_a_virtual_cell(virtual, measured):
    """RP of isotropic repeatability σ and reading noise is about 3.6 times their standard deviation per axis."""
    found = tp.iso9283(measured, cell=virtual.cell)
    assert [pose.n for pose in found.poses] == [30] * 5
    std = np.sqrt(virtual.preset.repeatability_std**2 + (measured.p_std**2).mean(axis=1))
    for pose in found.poses:
        assert pose.RP_mm == pytest.approx(3.61 * std[measured.name == pose.name].mean(), rel=0.35)
    assert 0.1 < found.AP_mm < 6.0
    assert found.RD_mm < 0.3
    said = " ".join(found.missing)
    assert "vAP: each pose was approached from one direction; the standard asks for 3 perpendicular ones" in said
    assert "drift: over" in said


def test_poses_are_found_without_names(virtual, measured):
    by_name, by_pose = tp.iso9283(measured), tp.iso9283(replace(measured, name=None))
    assert [pose.name for pose in by_pose.poses] == [f"row {k}" for k in range(5)]
    np.testing.assert_allclose([p.RP_mm for p in by_name.poses], [p.RP_mm for p in by_pose.poses])


def test_directions_of_approach_are_told_apart(virtual):
    q = np.tile(virtual.design(3), (30, 1))
    way = np.where(np.arange(90)[:, None] < 45, 1.0, -1.0)
    found = tp.iso9283(virtual.measure(q, approach=way, seed=1))
    centre = [virtual.true_position(q[:3], approach=s) for s in (1.0, -1.0)]
    largest = np.linalg.norm(centre[0] - centre[1], axis=1).max()
    assert found.vAP_mm == pytest.approx(largest, abs=0.02)
    assert any(text.startswith("vAP: 3 poses, up to 2 directions, from 15 cycles on") for text in found.missing)


def test_registered_readings_are_left_where_they_are(virtual, measured):
    shifted = replace(measured, p_meas=measured.p_cmd + np.array([0.0, 0.0, 0.25]))
    assert tp.iso9283(shifted, registered=True).AP_mm == pytest.approx(0.25)
    assert tp.iso9283(shifted).AP_mm == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(DataError, match="has no commanded positions"):
        tp.iso9283(replace(measured, p_cmd=None, rotation_cmd=None))


def test_measured_ur10(ur10: Path):
    """The measured UR10: some of its cube poses were measured two to five times."""
    samples = tp.read_samples(ur10 / "samples.csv")
    cell = tp.Cell.model_validate({"robot": {"model": "universal-robots-ur10"}, "tool": {"fit": "position"}})
    found = tp.iso9283(samples, cell=cell)
    counts = [pose.n for pose in found.poses]
    assert len(counts) >= 20
    assert set(counts) <= {2, 3, 4, 5}
    rp = np.array([pose.RP_mm for pose in found.poses])
    ap = np.array([pose.AP_mm for pose in found.poses])
    assert 0.02 < np.median(rp) < 0.2  # the maker states 0.1 mm
    assert 0.4 < np.median(ap) < 1.2  # 0.72 mm in the mean with fitted tool and station, by its README
    assert max(abs(angle) for pose in found.poses for angle in pose.AP_abc_deg) < 0.5
    alone = tp.iso9283(samples)  # commanded poses are in another base frame than the robot's own: RP does not mind
    np.testing.assert_allclose([pose.RP_mm for pose in alone.poses], rp, rtol=1e-6)
    assert found.missing[0].startswith(f"AP, RP: {len(counts)} of {len(counts)} poses have fewer than 30 cycles")


def test_by_command(tmp_path: Path, virtual):
    from typer.testing import CliRunner

    from truepose.cli import app

    cell = tmp_path / "cell.toml"
    cell.write_text(virtual.cell.to_toml())
    run = CliRunner()
    made = run.invoke(app, ["iso9283", str(cell), "--poses", str(tmp_path / "plan.csv")])
    assert made.exit_code == 0, made.output
    assert "ISO 9283 test poses, cube of" in made.output
    plan = read_poses(tmp_path / "plan.csv")
    write_samples(tmp_path / "samples.csv", replace(virtual.measure(plan.q[:50]), name=plan.name[:50]))
    shown = run.invoke(app, ["iso9283", str(tmp_path / "samples.csv"), "--cell", str(cell)])
    assert shown.exit_code == 0, shown.output
    for text in ("RP, pose repeatability", "registered with the cell", "(pose P1: 10); the standard asks for 30"):
        assert text in shown.output
    as_json = run.invoke(app, ["iso9283", str(tmp_path / "samples.csv"), "--json"])
    import json

    data = json.loads(as_json.output)
    assert data["stated"]["load_kg"] == [120.0]
    assert len(data["poses"]) == 5
    assert data["AT_mm"] is None


def test_points_of_a_path(virtual):
    """Ten cycles along a line; RT is about that of poses, AT what the arm's errors leave after registration."""
    line = np.asarray(virtual.preset.centre_mm) + np.outer(np.linspace(-1, 1, 12), [200.0, 300.0, 100.0])
    q = np.tile(virtual.reach(line), (10, 1))
    names = np.array([f"path{k}" for k in range(1, 13)] * 10)
    found = tp.iso9283(replace(virtual.measure(q), name=names))
    assert found.poses == ()
    assert found.AP_mm is None
    assert 0.03 < found.RT_mm < 0.15
    assert 0.0 < found.AT_mm < 2.0
    assert not any("AT, RT" in text for text in found.missing)
    few = tp.iso9283(replace(virtual.measure(q[:36]), name=names[:36]))
    assert "AT, RT: 3 cycles; the standard asks for 10" in few.missing


def test_orientations_of_another_frame(virtual, measured):
    turned = replace(
        measured, rotation_cmd=measured.rotation_cmd * tp.euler("kuka", [[180.0, 0, 0]] * 5 + [[0.0] * 3] * 145)
    )
    said = r"points P1, P2, P3, P4, P5: measured orientations are up to 1\d\d deg from commanded ones; pass the cell"
    with pytest.raises(DataError, match=said):
        tp.iso9283(turned)
    assert tp.iso9283(turned, cell=virtual.cell).poses[0].AP_abc_deg is not None


def test_a_program_goes_to_the_standards_poses(virtual, tmp_path):
    """Cycle after cycle, each pose from below, named as the table names it."""
    from truepose.planning import write_measurement

    poses = tp.iso9283_poses(virtual.cell, cycles=3)
    table, program = write_measurement(tmp_path / "iso.csv", virtual.cell, poses)
    text = program.read_text()
    assert [line[2:] for line in text.splitlines() if line.startswith("; P")] == ["P1", "P2", "P3", "P4", "P5"] * 3
    assert text.count("WAIT SEC") == 15
    assert read_poses(table).name[:2].tolist() == ["P1", "P2"]


def test_no_program_goes_through_a_box(virtual, tmp_path):
    """Poses that no plan has chosen are kept clear of the boxes as well; nothing is written."""
    from truepose.planning import write_measurement

    poses = tp.iso9283_poses(virtual.cell, cycles=1)
    low, high = poses.p_cmd[1] - 40.0, poses.p_cmd[1] + 40.0
    box = "\n[obstacles.fixture]\n" + "".join(
        f"{axis}_mm = [{a}, {b}]\n" for axis, a, b in zip("xyz", low, high, strict=True)
    )
    cell = Cell.from_toml(virtual.cell.to_toml() + box)
    with pytest.raises(DataError, match=r"a pose is in the box fixture; leave it out"):
        write_measurement(tmp_path / "iso.csv", cell, poses)
    assert not list(tmp_path.iterdir())
