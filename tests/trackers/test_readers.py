"""Each layout of measurement files, recognised and read; what is not known is described."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.trackers import read_readings

HEADER = ["// Points Relative to Coordinate Frame 'A::WORLD'", "// AXES = CARTESIAN: X,  Y,  Z (mm)"]
POINTS = [
    "Station1, Main, 1, 1834.512,  -920.077,  318.640, 03/07/25 09:15:02",
    "Station1, Main, 2, 1234.5,  -20.25,  -1.8e2, 12/31/25 23:59:59",
]


def write(tmp_path: Path, *lines: str, encoding: str = "utf-8", end: str = "\n") -> Path:
    path = tmp_path / "readings.txt"
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def test_spatial_analyzer_with_header(tmp_path: Path) -> None:
    readings = read_readings(write(tmp_path, *HEADER, "", *POINTS))
    np.testing.assert_array_equal(readings.p, [[1834.512, -920.077, 318.640], [1234.5, -20.25, -180.0]])
    assert readings.layout == "SpatialAnalyzer ASCII with // header"
    assert (readings.unit, readings.frame) == ("mm", "A::WORLD")
    assert readings.name is not None
    assert readings.name.tolist() == ["Station1::Main::1", "Station1::Main::2"]
    assert readings.line.tolist() == [4, 5]
    assert readings.time is not None
    assert readings.time[0] == datetime(2025, 3, 7, 9, 15, 2, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("unit", "millimetres"),
    [("mm", 1.0), ("Inches", 25.4), ("in", 25.4), ("m", 1000.0), ("Meters", 1000.0), ("cm", 10.0)],
)
def test_unit_of_the_header(tmp_path: Path, unit: str, millimetres: float) -> None:
    header = [HEADER[0], HEADER[1].replace("mm", unit)]
    readings = read_readings(write(tmp_path, *header, "M, 1, 150, -25.5, 3", "M, 2, 4.5, 250, 1"))
    np.testing.assert_allclose(readings.p[0], np.array([150, -25.5, 3]) * millimetres)
    assert readings.unit == unit
    assert readings.time is None


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_and_line_ends(tmp_path: Path, encoding: str) -> None:
    lines = [line.replace("Main", "Prüfling") for line in (*HEADER, *POINTS)]
    readings = read_readings(write(tmp_path, *lines, encoding=encoding, end="\r\n"))
    assert readings.name is not None
    assert readings.name[0] == "Station1::Prüfling::1"


def test_spatial_analyzer_without_header(tmp_path: Path) -> None:
    lines = ["1,  1834.512,  -920.077,  318.640", "2,  0.0, 0, 0", "2, 1200, -920, 318.", "7, nan, nan, nan"]
    readings = read_readings(write(tmp_path, *lines))
    assert readings.layout.startswith("SpatialAnalyzer ASCII without header")
    assert readings.name is not None
    assert readings.name.tolist() == ["1", "2", "2", "7"]
    assert readings.missing.tolist() == [False, True, False, True]


def test_tidy_table_with_and_without_joints(tmp_path: Path) -> None:
    lines = ["x_meas_mm,y_meas_mm,z_meas_mm,x_std_mm,y_std_mm,z_std_mm,rz_meas_deg,ry_meas_deg,rx_meas_deg,time_s"]
    lines += ["2000,1,2,0.1,0.2,0.3,90,0,0,5", "0,0,0,0,0,0,0,0,0,6"]
    readings = read_readings(write(tmp_path, *lines))
    assert readings.layout.startswith("tidy table")
    assert readings.missing.tolist() == [False, True]
    assert readings.rotation is not None
    np.testing.assert_allclose(readings.rotation[0].as_rotvec(), [0, 0, np.pi / 2])
    assert readings.p_std is not None
    np.testing.assert_array_equal(readings.p_std[0], [0.1, 0.2, 0.3])
    joints = read_readings(write(tmp_path, "q1_deg,x_meas_m,y_meas_m,z_meas_m", "broken,2,0.1,0.2"))
    np.testing.assert_allclose(joints.p, [[2000, 100, 200]])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["a;b;c", "P1;-512.250;2040.118;77.905;;;;"], "readings.txt:2: unknown layout: 8 columns between semicolons"),
        (["1 0 0 -2.125001 3.870442 0.512300"], "readings.txt:1: unknown layout: 6 columns between blanks"),
        (
            ["1 0 0 -2.125001 3.870442 0.512300"],
            "State the columns, such as --columns 'x=4, y=5, z=6, unit=mm'",
        ),
        (["Nr,MX,MY", "Plane,1,2.5,7"], "unit=mm'. Known are: SpatialAnalyzer"),
        (["Element Name,Number,MX Coord.", "Plane,1,2.5,7"], "readings.txt:1: has no column 'MY Coord.'; there are"),
        (["nothing of use"], "unknown layout: 3 columns between blanks, as in 'nothing of use'"),
        ([""], "is empty; expected a header line"),
        ([*HEADER], "has a header but no readings"),
        ([*HEADER, "Main, 5.0, 6.0"], "readings.txt:3: expected names, x, y, z and an optional date, got"),
        ([*HEADER, *POINTS, "S, 1, 5, 6, 7"], "readings.txt:5: has 2 names before x, y, z, the first reading has 3"),
        ([*HEADER, POINTS[0], POINTS[1].replace("1234.5", "12E")], "readings.txt:4: expected names"),
        (
            [*HEADER, POINTS[0], "S, Main, 1, 1.0, 2.0, 3.0, 31/12/25 9:15:02"],
            "readings.txt:4: the date '31/12/25 9:15:02'",
        ),
        ([HEADER[0], HEADER[1].replace("CARTESIAN", "SPHERICAL"), *POINTS], "readings.txt:2: the axes are SPHERICAL"),
        ([HEADER[0], HEADER[1].replace("mm", "furlong"), *POINTS], "readings.txt:2: the unit 'furlong' is not known"),
        (["1, 1.834512, -0.920077, 0.3", "2, 2.8, 0.1, 0.4"], "the readings spread over 1.41 mm; metres?"),
        (["1, 1834.5, -920.1, 318.6", "", "2, 1834.5, abc, 3"], "readings.txt:3: expected names"),
        (["x_meas_mm,y_meas_mm", "1,2"], "has x_meas_mm, y_meas_mm but not z_meas_mm"),
    ],
)
def test_what_cannot_be_read(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(FileError, match=re.escape(message)) as caught:
        read_readings(write(tmp_path, *lines))
    assert "\n" not in str(caught.value)


def test_a_damaged_workbook(tmp_path: Path) -> None:
    path = tmp_path / "readings.xlsx"
    path.write_bytes(b"PK\x03\x04\x14\x00")
    with pytest.raises(FileError, match=r"is not a workbook, or is damaged .* as CSV"):
        read_readings(path)
    with pytest.raises(FileError, match="no such file"):
        read_readings(tmp_path / "absent.txt")
