"""Several reflectors per pose, orientations against the plan, and plans as controllers write them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import DataError, FileError
from truepose.samples import Poses
from truepose.simulation import VirtualCell
from truepose.trackers import Columns, import_readings, read_plan


@pytest.fixture(scope="module")
def cell() -> VirtualCell:
    return VirtualCell("hard", seed=1)


def in_turn(path: Path, p: np.ndarray, left_out: tuple[int, ...] = ()) -> Path:
    """Write layout 2 with ids that repeat 1, 2, 3 for each pose."""
    rows = [f"{k % p.shape[1] + 1},  {x:.4f},  {y:.4f},  {z:.4f}" for k, (x, y, z) in enumerate(p.reshape(-1, 3))]
    path.write_text("\n".join(row for k, row in enumerate(rows) if k not in left_out) + "\n")
    return path


@pytest.fixture
def plan(cell: VirtualCell) -> Poses:
    samples = cell.measure(cell.design(30), seed=0)
    return Poses(q=samples.q, p_cmd=samples.p_cmd, rotation_cmd=samples.rotation_cmd, source="plan.csv")


def test_poses_from_three_reflectors(tmp_path: Path, cell: VirtualCell, plan: Poses) -> None:
    path = in_turn(tmp_path / "readings.txt", cell.read_reflectors(plan.q, 3, seed=5), left_out=(31,))
    samples, summary = import_readings(path, plan, reflectors=cell.reflector_positions(3), missing=True)
    assert summary.missing == (10,)
    assert "Each pose is combined from 3 reflectors; 1 poses lack one." in summary.sentences()
    direct = cell.measure(plan.q, seed=5, reflectors=3)[np.arange(30) != 10]
    np.testing.assert_allclose(samples.p_meas, direct.p_meas, atol=2e-4)
    assert samples.rotation_meas is not None
    assert (samples.rotation_meas * direct.rotation_meas.inv()).magnitude().max() < 2e-6


def test_one_of_three_reflectors_kept(tmp_path: Path, cell: VirtualCell, plan: Poses) -> None:
    p = cell.read_reflectors(plan.q, 3, seed=5)
    samples, _ = import_readings(in_turn(tmp_path / "r.txt", p), plan, reflectors=3, keep=2)
    np.testing.assert_allclose(samples.p_meas, p[:, 1], atol=1e-4)


def test_reflectors_not_told(tmp_path: Path, cell: VirtualCell, plan: Poses) -> None:
    path = in_turn(tmp_path / "r.txt", cell.read_reflectors(plan.q, 3, seed=5))
    with pytest.raises(DataError, match="3 for each point, and no repeats; several reflectors per pose\\? State their"):
        import_readings(path, plan)
    with pytest.raises(DataError, match=r"3 reflectors; state which to keep \(1 to 3\), or their positions"):
        import_readings(path, plan, reflectors=3)
    with pytest.raises(DataError, match="90 readings are not a multiple of 4 reflectors"):
        import_readings(path, plan, reflectors=4, keep=1)
    with pytest.raises(DataError, match=r"reflectors have shape \(3, 3\); expected .* not on a line"):
        import_readings(path, plan, reflectors=np.outer(np.arange(3), [50.0, 0, 0]))


def test_reflectors_in_another_order_or_gross(tmp_path: Path, cell: VirtualCell, plan: Poses) -> None:
    p = cell.read_reflectors(plan.q, 3, seed=5)
    other = cell.reflector_positions(3) * [1.0, 1.2, 1.0]
    with pytest.raises(
        DataError, match=r"measured distances between reflectors are .* mm, expected .* mm; another order"
    ):
        import_readings(in_turn(tmp_path / "r.txt", p), plan, reflectors=other)
    p[4, 1] += 3.0
    with pytest.raises(
        DataError, match=r"distances between reflectors are wrong by up to .* mm in the poses that start at line 13"
    ):
        import_readings(in_turn(tmp_path / "r.txt", p), plan, reflectors=cell.reflector_positions(3))


def test_angles_of_another_order_are_told(tmp_path: Path, cell: VirtualCell, plan: Poses) -> None:
    samples = cell.measure(plan.q, seed=3, reflectors=3)
    angles = samples.rotation_meas.as_euler("ZYX", degrees=True)
    rows = [" ".join(f"{v:.4f}" for v in (*p, *a)) for p, a in zip(samples.p_meas, angles, strict=True)]
    path = tmp_path / "readings.txt"
    path.write_text("\n".join(rows))
    columns = Columns(x=1, y=2, z=3, rotation=(4, 5, 6))
    with pytest.raises(DataError, match=r"differ by .* deg \(median turn\): they agree as ZYX; state"):
        import_readings(path, plan, columns=columns)
    found, _ = import_readings(path, plan, columns=replace(columns, angles="ZYX"))
    assert found.rotation_meas is not None
    assert (found.rotation_meas * samples.rotation_meas.inv()).magnitude().max() < 1e-5
    with pytest.raises(DataError, match="is it this plan, and are the angles in the order of the layout"):
        import_readings(path, plan, columns=replace(columns, angles="ZYX", angle_unit="rad"))


JOINTS = np.array([[0.0, -20.5, 30.0, 0.0, 50.0, 10.0], [5.0, -60.0, 95.0, -1.5, 20.0, 180.0]])


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(
            f"  CONST jointtarget jp{i}:=[[{','.join(map(str, q))}],[9E9,9E9,9E9,9E9,9E9,9E9]];"
            for i, q in enumerate(JOINTS)
        ),
        "\n".join(
            f"DECL E6AXIS XP{i}={{{','.join(f'A{k + 1} {v}' for k, v in enumerate(q))},E1 0.0}}"
            for i, q in enumerate(JOINTS)
        ),
        "\n".join(f"PTP {{E6AXIS: {', '.join(f'A{k + 1} {v}' for k, v in enumerate(q))}}}" for q in JOINTS),
        "\n".join(f"movej([{', '.join(repr(float(v)) for v in np.deg2rad(q))}], a=1.4)" for q in JOINTS),
        "j1;j2;j3;j4;j5;j6\n" + "\n".join(";".join(str(v).replace(".", ",") for v in q) for q in JOINTS),
        "j1_rad,j2_rad,j3_rad,j4_rad,j5_rad,j6_rad\n"
        + "\n".join(",".join(repr(float(v)) for v in np.deg2rad(q)) for q in JOINTS),
        "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + "\n".join(",".join(map(str, q)) for q in JOINTS),
    ],
    ids=["rapid", "krl-dat", "krl", "ur", "spreadsheet", "radians", "tidy"],
)
def test_plans_as_controllers_write_them(tmp_path: Path, text: str) -> None:
    path = tmp_path / "plan.txt"
    path.write_text(text)
    np.testing.assert_allclose(read_plan(path).q, np.deg2rad(JOINTS), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("j1;j2\n0,5;0,25", "plan.txt:1: has no unit of the joints; write j1_deg … or j1_rad"),
        ("j1;j3\n0,5;0,25", "plan.txt:1: is not a plan; expected plan.csv (q1_deg"),
        ("hello\nworld", "plan.txt:1: is not a plan; expected"),
        ("j1_deg;j2_deg\n5;x", "plan.txt:2: j2_deg is 'x', which is not a number"),
    ],
)
def test_what_is_no_plan(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "plan.txt"
    path.write_text(text)
    with pytest.raises(FileError, match=re.escape(message)):
        read_plan(path)
