"""Headers below titles, joints under other names, and units that the user states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.errors import DataError, FileError
from truepose.samples import Poses
from truepose.trackers import Columns, match, read_plan


def write(folder: Path, *lines: str, name: str = "t.csv") -> Path:
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def test_titles_above_the_header(tmp_path: Path) -> None:
    rows = ["Report of 7 March;;;", "Point;X;Y;Z", "P1;1834,5;-920;318", "P2;1900,5;-20;118"]
    readings = tp.read_readings(write(tmp_path, *rows))
    np.testing.assert_array_equal(readings.p[0], [1834.5, -920, 318])
    assert readings.line.tolist() == [3, 4]
    tidy = write(tmp_path, "Campaign of March", "name,q1_deg,q2_deg", "P1,10,20", "P2,11,20")
    for poses in (tp.read_poses(tidy), read_plan(tidy)):
        assert poses.rows(np.array([0])) == "point P1 (line 3)"
        assert poses.q is not None
        np.testing.assert_allclose(np.degrees(poses.q[1]), [11, 20])
    samples = write(tmp_path, "Campaign", "q1_deg x_meas_mm y_meas_mm z_meas_mm", "1,5 2100 5,5 800", "2,5 2400 5 800")
    np.testing.assert_array_equal(tp.read_samples(samples).p_meas[0], [2100, 5.5, 800])
    np.testing.assert_array_equal(tp.read_readings(samples).p[0], [2100, 5.5, 800])


def test_a_unit_above_the_header(tmp_path: Path) -> None:
    rows = ["Point;Measured [in];;", ";X;Y;Z", "P1;72.2;-36.2;12.5", "P2;70;-30;10"]
    readings = tp.read_readings(write(tmp_path, *rows))
    np.testing.assert_allclose(readings.p[0], 25.4 * np.array([72.2, -36.2, 12.5]))
    assert readings.name is not None
    assert (readings.unit, readings.name[0]) == ("in", "P1")


@pytest.mark.parametrize(
    "header",
    [
        "Point;Achse1_deg;Achse2_deg",
        "Punkt;A1 [°];A2 [°]",
        "name;Joint 1 (deg);Joint 2 (deg)",
        "name;J1 [deg];J2 [deg]",
    ],
)
def test_joints_under_other_names(tmp_path: Path, header: str) -> None:
    poses = read_plan(write(tmp_path, header, "P1;10;20", "P2;-30;45"))
    assert poses.q is not None
    np.testing.assert_allclose(np.degrees(poses.q), [[10, 20], [-30, 45]])
    assert poses.rows(np.array([1])) == "point P2 (line 3)"
    xyz = header + ";x_meas_mm;y_meas_mm;z_meas_mm"
    samples = tp.read_samples(write(tmp_path, xyz, "P1;10;20;2000;10;800", "P2;-30;45;1500;900;700"))
    assert samples.q is not None
    np.testing.assert_allclose(np.degrees(samples.q[1]), [-30, 45])


def test_a_quaternion_beside_joints(tmp_path: Path) -> None:
    plan = write(tmp_path, "A1 [°];A2 [°];A3 [°];Q1;Q2;Q3;Q4", "10;20;30;1;0;0;0", "11;25;30;1;0;0;0")
    poses = read_plan(plan)
    assert poses.q is not None
    np.testing.assert_allclose(np.degrees(poses.q[0]), [10, 20, 30])
    tidy = write(tmp_path, "j1_deg;j2_deg;q0;q1;q2;q3", "10;20;1;0;0;0", "11;25;1;0;0;0")
    assert tp.read_poses(tidy).q is not None
    beside = write(tmp_path, "x_cmd [mm];y_cmd [mm];z_cmd [mm];q0;q1;q2;q3", "900;20;1;1;0;0;0", "11;850;1;1;0;0;0")
    assert tp.read_poses(beside).q is None


def test_two_sets_of_joints(tmp_path: Path) -> None:
    path = write(tmp_path, "A1 [°];A2 [°];J1 [°];J2 [°]", "10;20;10;20", "11;25;11;25")
    with pytest.raises(FileError, match=r"t\.csv:1: has several sets of joints \(A1 \[°\] … and J1 .*\); keep one"):
        read_plan(path)


def test_inches_without_a_header(tmp_path: Path, rng: np.random.Generator) -> None:
    p = rng.uniform(-500, 500, (30, 3))
    lines = [f"{k}, {x / 25.4:.6f}, {y / 25.4:.6f}, {z / 25.4:.6f}" for k, (x, y, z) in enumerate(p + 2000.0, start=1)]
    path = write(tmp_path, *lines, name="readings.txt")
    plan = Poses(p_cmd=p)
    with pytest.raises(DataError, match=r"inches\? If so, pass --unit in \(unit=\"in\" in Python\)"):
        match(tp.read_readings(path), plan)
    samples, summary = tp.import_readings(path, plan, unit="in")
    np.testing.assert_allclose(samples.p_meas, p + 2000.0, atol=1e-4)
    assert summary.unit == "in"
    with pytest.raises(DataError, match=r"x is not given; .*; for the unit alone, pass --unit"):
        Columns.parse("unit=in")


def test_a_unit_that_the_file_contradicts(tmp_path: Path) -> None:
    path = write(tmp_path, "Point;X [mm];Y [mm];Z [mm]", "P1;1834;-920;318")
    with pytest.raises(FileError, match="states its lengths in mm; leave out --unit m"):
        tp.read_readings(path, unit="m")
    assert tp.read_readings(path, unit="mm").unit == "mm"
    metres = write(tmp_path, "1.5 2.5 0.5", "1.9 2.5 0.7", "1.1 2.1 0.5")
    with pytest.raises(FileError, match=r"metres\? If so, pass --unit m"):
        tp.read_readings(metres)
    np.testing.assert_array_equal(tp.read_readings(metres, unit="m").p[0], [1500, 2500, 500])


def test_a_column_of_times_that_is_empty(tmp_path: Path) -> None:
    readings = tp.read_readings(write(tmp_path, "Point;X;Y;Z;Time", "P1;1834;-920;318;", "P2;1934;-900;318;"))
    assert readings.time is None


@pytest.mark.parametrize("units", ["[mm]", "(mm)", "mm"])
def test_units_below_the_header(tmp_path: Path, units: str) -> None:
    inches = [
        "Cell 4",
        "Point;X;Y;Z",
        f";{units};{units};{units}".replace("mm", "in"),
        "P1;72,2;-36,2;12,5",
        "P2;70;-3;1",
    ]
    readings = tp.read_readings(write(tmp_path, *inches))
    np.testing.assert_allclose(readings.p[0], 25.4 * np.array([72.2, -36.2, 12.5]))
    assert (readings.unit, readings.unit_stated, readings.line.tolist()) == ("in", True, [4, 5])
    angles = f";{units};{units}".replace("mm", "°")
    plan = read_plan(write(tmp_path, "Punkt;A1;A2", angles, "P1;10;-20", "P2;11;-20"))
    assert plan.q is not None
    np.testing.assert_allclose(np.degrees(plan.q[0]), [10, -20])
    assert plan.rows(np.array([1])) == "point P2 (line 4)"


def test_a_point_named_like_a_unit_is_a_point(tmp_path: Path) -> None:
    readings = tp.read_readings(write(tmp_path, "Point;X;Y;Z", "m;1834.5;-920;318", "s;1900.5;-20;118"))
    assert readings.name is not None
    assert readings.name.tolist() == ["m", "s"]


def test_readings_given_as_samples_name_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"t\.csv:\d: has .*; no line names columns as q1_deg .*import"):
        tp.read_samples(write(tmp_path, "Cell 4", "Operator: A; B", "Point;X;Y;Z", "P1;1;2;3"))
    with pytest.raises(FileError, match=r"t\.csv:3: has 3 fields, the header has 2"):
        tp.read_samples(write(tmp_path, "q1_deg;x_meas_mm", "1;2", "1;2;3"))
