"""Each layout of the tracker files: our own examples of what is seen in the wild, and the way there and back."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import DataError, FileError
from truepose.samples import Poses, Samples
from truepose.simulation import VirtualCell
from truepose.trackers import LAYOUTS, Columns, match, read_readings, write_readings

ROUNDING_MM = {
    "spatial-analyzer": 5e-5,
    "bare": 5e-4,
    "leica": 5e-5,
    "semicolons": 5e-4,
    "portable-cmm": 5e-5,
    "motion": 5e-5,
    "spreadsheet": 5e-5,
    "columns": 0.0,
    "log": 5e-4,
    "epoch": 5e-4,
    "tidy": 1e-8,
}
ROUNDING_RAD = {"leica": 2e-9, "motion": 2e-6, "log": 2e-5, "tidy": 1e-10}


def write(tmp_path: Path, *lines: str, encoding: str = "utf-8", end: str = "\n") -> Path:
    path = tmp_path / "readings.txt"
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def test_layout_1_spatial_analyzer(tmp_path: Path) -> None:
    lines = ["// Points Relative to Coordinate Frame 'A::WORLD'", "// AXES = CARTESIAN: X,  Y,  Z (mm)"]
    readings = read_readings(
        write(tmp_path, *lines, "Station1, Main, 1, 1834.512,  -920.077,  318.640, 03/07/25 09:15:02")
    )
    assert readings.layout == "SpatialAnalyzer ASCII with // header"
    np.testing.assert_array_equal(readings.p, [[1834.512, -920.077, 318.640]])


def test_layout_2_no_header_and_ids_with_gaps(tmp_path: Path) -> None:
    readings = read_readings(write(tmp_path, "1,  1834.512,  -920.077,  318.640", "7,  1034.5,  -20.1,  18.0"))
    assert readings.layout.startswith("SpatialAnalyzer ASCII without header")
    assert readings.name is not None
    assert readings.name.tolist() == ["1", "7"]


def test_layout_3_leica(tmp_path: Path) -> None:
    header = "Name,X  [mm],Y  [mm],Z  [mm],U(95)  [mm],T  [°C],Q0 ,Q1 ,Q2 ,Q3 ,Time ,"
    half = np.sqrt(0.5)
    rows = [
        f"P1,1834.512,-920.077,318.640,0.0420,20.1,{half:.9f},0.0,0.0,{half:.9f},'2025-03-07 09:15:02.250,",
        "P2,,,,,20.1,,,,,'2025-03-07 09:15:20.000,",
    ]
    readings = read_readings(write(tmp_path, header, *rows, encoding="latin-1", end="\r\n"))
    assert readings.layout == "Leica CSV with U(95)"
    assert readings.missing.tolist() == [False, True]
    assert readings.p_std is not None
    np.testing.assert_allclose(readings.p_std[0], 0.021)
    assert readings.rotation is not None
    np.testing.assert_allclose(readings.rotation[0].as_rotvec(), [0, 0, np.pi / 2], atol=1e-8)
    assert readings.time is not None
    assert readings.time[0] == datetime(2025, 3, 7, 9, 15, 2, 250_000, tzinfo=UTC).timestamp()


def test_layout_3_in_metres(tmp_path: Path) -> None:
    readings = read_readings(write(tmp_path, "X  [m],Y  [m],Z  [m],U(95)  [m],", "1.5,0.25,-2,0.0001,"))
    np.testing.assert_allclose(readings.p, [[1500, 250, -2000]])
    assert readings.p_std is not None
    np.testing.assert_allclose(readings.p_std, 0.05)
    assert readings.unit == "m"


def test_layout_4_semicolons(tmp_path: Path) -> None:
    readings = read_readings(write(tmp_path, "P1;-512.250;2040.118;77.905;;;;", "P4;-12.25;2140.1;7;;;;", end="\r\n"))
    assert readings.layout.startswith("name;x;y;z")
    np.testing.assert_array_equal(readings.p, [[-512.25, 2040.118, 77.905], [-12.25, 2140.1, 7]])
    assert readings.name is not None
    assert readings.name.tolist() == ["P1", "P4"]


def test_layout_5_portable_cmm_probings_are_averaged(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    p = rng.uniform(-500, 500, (8, 3))
    rows = [f"Point{i},{k},0.0,{x + 0.01 * k:.3f},{y:.3f},{z:.3f}" for i, (x, y, z) in enumerate(p) for k in (1, 2, 3)]
    readings = read_readings(write(tmp_path, "Element Name,Number,Deviation,MX Coord.,MY Coord.,MZ Coord.", *rows))
    assert readings.layout.startswith("portable measuring arm")
    samples, summary = match(readings, Poses(p_cmd=p, source="plan.csv"))
    assert (summary.samples, summary.averaged) == (8, 16)
    np.testing.assert_allclose(samples.p_meas, p + np.array([0.02, 0, 0]), atol=1e-3)
    assert summary.scatter_mm == pytest.approx(0.01 / np.sqrt(3), rel=0.1)


def test_layout_6_nominal_and_actual(tmp_path: Path) -> None:
    lines = ["Motion1 100 200 300 0 0 90 100.1 200.2 300.3 0.01 0 90.02", "Motion2 1 2 3 0 0 0 0 0 0 0 0 0"]
    readings = read_readings(write(tmp_path, *lines))
    assert readings.layout.startswith("name, six nominal and six measured")
    np.testing.assert_array_equal(readings.p[0], [100.1, 200.2, 300.3])
    assert readings.missing.tolist() == [False, True]
    assert readings.rotation is not None
    np.testing.assert_allclose(readings.rotation[0].as_euler("xyz", degrees=True), [0.01, 0, 90.02])


def test_layout_7_spreadsheet_locale(tmp_path: Path) -> None:
    lines = ["Time;j1 [rad];j2 [rad];X [m];Y [m];Z [m]", "2,02E+13;1,5708;-0,7853;1,25;-0,5;0,75"]
    readings = read_readings(write(tmp_path, *lines, end="\r\n"))
    np.testing.assert_allclose(readings.p, [[1250, -500, 750]])
    assert readings.time is None
    assert readings.notes == ("The time stamps were rounded by a spreadsheet (such as 2,02E+13) and are left out.",)


def test_layout_8_bare_columns(tmp_path: Path) -> None:
    p = np.array([[1834.512, -920.077, 318.64], [0, 0, 0], [1000.25, 1, 2]])
    path = tmp_path / "readings.txt"
    np.savetxt(path, p)
    readings = read_readings(path)
    assert readings.layout == "three bare columns x, y, z"
    np.testing.assert_array_equal(readings.p, p)
    assert readings.missing.tolist() == [False, True, False]


def test_layout_9_log(tmp_path: Path) -> None:
    lines = [
        "Pos 1",
        "Cnt=1  X=-1250.330 Y=20.5 Z= 3.25 RotX= 0.420 RotY=-0.1 RotZ=90",
        "Cnt=2 X=-1250.328 Y=20.5 Z=3.25 RotX=0.42 RotY=-0.1 RotZ=90",
    ]
    readings = read_readings(write(tmp_path, *lines, "", "Pos 2", "Cnt=1 X=0.0 Y=0.0 Z=0.0 RotX=0 RotY=0 RotZ=0"))
    assert readings.layout.startswith("log in blocks")
    assert readings.name is not None
    assert readings.name.tolist() == ["1", "1", "2"]
    assert readings.missing.tolist() == [False, False, True]
    assert readings.rotation is not None
    np.testing.assert_allclose(readings.rotation[0].as_euler("xyz", degrees=True), [0.42, -0.1, 90])


def test_layout_10_metres_and_epoch_seconds(tmp_path: Path) -> None:
    lines = ["1700000000.25 0 0 -2.125001 3.870442 0.512300", "1700000015.50 1 0 -1.1 3.1 0.5"]
    readings = read_readings(write(tmp_path, *lines))
    np.testing.assert_allclose(readings.p[0], [-2125.001, 3870.442, 512.3])
    assert readings.unit == "m"
    assert readings.time is not None
    assert readings.time.tolist() == [1700000000.25, 1700000015.5]


@pytest.mark.parametrize(
    "header", ["x y z", "# x y z", "X [mm]  Y [mm]  Z [mm]", "% x_mm\ty_mm\tz_mm", "x,y,z,", '"X","Y","Z"']
)
def test_headers_of_scripts(tmp_path: Path, header: str) -> None:
    delimiter = "\t" if "\t" in header else "," if "," in header else "  "
    rows = [delimiter.join(row) for row in (("1500.5", "-20", "3e2"), ("0", "0", "0"))]
    readings = read_readings(write(tmp_path, header, *rows))
    np.testing.assert_array_equal(readings.p[0], [1500.5, -20.0, 300.0])
    assert readings.missing.tolist() == [False, True]


@pytest.mark.parametrize("row", ["1500.5 -20 3e2", "1500.5,-20,3e2", "1500,5;-20;300", "1500.5\t-20\t300"])
def test_comments_before_bare_columns(tmp_path: Path, row: str) -> None:
    readings = read_readings(write(tmp_path, "# from a script", "", row, row))
    assert readings.layout == "three bare columns x, y, z"
    np.testing.assert_array_equal(readings.p, [[1500.5, -20.0, 300.0]] * 2)
    with pytest.raises(FileError, match="unknown layout"):
        read_readings(write(tmp_path, "# nothing but a comment"))


def test_a_header_that_does_not_fit_its_rows(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="unknown layout: 5 columns between blanks"):
        read_readings(write(tmp_path, "x y z", "7 8 1500.5 -20 300"))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["X  [mm],Y  [mm],U(95)  [mm],", "1,2,3,"], ":1: has no column z; say which with --columns"),
        (["X  [mm],Y  [mm],Z  [m],U(95)  [mm],", "1,2,3,4,"], ":1: x, y and z have different units: m, mm"),
        (["X  [ell],Y  [ell],Z  [ell],U(95) [ell],", "1,2,3,4,"], ":1: the unit 'ell' is not known; known are mm"),
        (
            ["X [mm],Y [mm],Z [mm],U(95) [mm],Q0,Q1,Q2,Q3", "1,2,3,4,2,0,0,0"],
            ":2: the quaternion has length 2, expected",
        ),
        (["X [mm],Y [mm],Z [mm],U(95) [mm],Time", "1,2,3,4,soon"], ":2: the date 'soon' is not month/day/year"),
        (["X [mm],Y [mm],Z [mm],X [mm]", "1,2,3,4"], ":1: columns 1 and 4 are both x; say which with --columns"),
        (["X;Y;Z", "1,5;2,5;3.5", "1,2;2;3"], "has decimal points and decimal commas"),
        (["X;Y;Z", "1,5;0,2;0,1", "0,2;1,1;0,3"], "the readings spread over 1.59 mm; metres?"),
        (["X;Y;Z", "1500;oops;0"], ":2: Y is 'oops', which is not a number"),
        (["X;Y;Z", "1500;;0"], ":2: Y is empty, which is not a number"),
        (["P1;1834.512;2040.118;77.905;;;;", "P2;1;2;;;"], ":2: column 4 is empty, which is not a number"),
        (["1700000000 0 0 -2125.0 3870.4 512.3", "1700000009 1 0 0 1000 512.3"], "too much for metres; say which with"),
        (["Pos 1", "Cnt=1 X=1.5 Y=2.5"], ":2: has no Z="),
        (["Pos 1", "Cnt=1 X=1.5 Y=2.5 Z=two"], ":2: z is 'two', which is not a number"),
        (["Pos 1", "and then the tracker fell over"], ':2: expected "Pos 1" or "Cnt=1 X=… Y=… Z=…", got'),
        (
            ["Pos 1", "Cnt=1 X=1 Y=2 Z=3 RotX=1 RotY=2 RotZ=3", "Cnt=2 X=1 Y=2 Z=3"],
            ":3: has no RotX=, RotY=, RotZ=, unlike other",
        ),
        (["X [mm],Y [mm],Z [mm],U(95) [mm],Q0,Q1,Q2,Q3", "1,2,3,4,,,,"], ":2: has a position but no orientation"),
        (["Pos 1", "Pos 2"], "has blocks but no samples in them"),
        (["Element Name,Number,Deviation,MX Coord.,MY Coord.,MZ Coord."], "is empty; expected a header line"),
    ],
)
def test_what_a_layout_refuses(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(FileError, match=re.escape(message)) as caught:
        read_readings(write(tmp_path, *lines))
    assert "\n" not in str(caught.value)


def test_columns_told_and_saved(tmp_path: Path) -> None:
    columns = Columns.parse("x=4, y=5, z=6, unit=m, time=1, rotation=7:8:9, angles=ZYX, skip=1, delimiter=;")
    columns.save(tmp_path / "columns.toml")
    assert Columns.load(tmp_path / "columns.toml") == columns
    path = write(tmp_path, "t;n;m;a;b;c;A;B;C", "12,5;0;1;1,5;2,5;-3;90;0;0")
    readings = read_readings(path, columns)
    np.testing.assert_allclose(readings.p, [[1500, 2500, -3000]])
    assert readings.rotation is not None
    np.testing.assert_allclose(readings.rotation[0].as_rotvec(), [0, 0, np.pi / 2], atol=1e-12)
    by_name = read_readings(path, Columns.parse("x=a, y=b, z=C , unit=mm, skip=1"))
    np.testing.assert_allclose(by_name.p, [[1.5, 2.5, -3]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x=1, y=2", "z is not given; write x=4, y=5, z=6"),
        ("x=1, y=2, z=3, w=4", "'w' is not known; known are x, y, z, name"),
        ("x=1, y=2, z=3, rotation=4:5", "rotation names 2 columns; expected 3 angles or a quaternion's 4"),
        ("x=1, y=2, z=3, std=4:5", "std names 2 columns; expected 1 for all axes or 3"),
        ("x=1, y=2, z=3, angles=abc", "angles 'abc'; expected an order of axes"),
        ("x=1, y=2, z=3, angle_unit=gon", "the unit of angles 'gon' is not known; known are deg, rad"),
        ("x=1, y=2, z=3, delimiter=|", "delimiter '|'; expected a semicolon"),
    ],
)
def test_columns_that_cannot_be(text: str, message: str) -> None:
    with pytest.raises(DataError, match=re.escape(message)):
        Columns.parse(text)


def test_named_columns_find_their_header(tmp_path: Path) -> None:
    path = write(tmp_path, "Shift 2", "t;n;a;b;C", "1;P1;1,5;2,5;-3")
    readings = read_readings(path, Columns.parse("name=N, x=a, y=b, z=c, unit=m"))
    np.testing.assert_allclose(readings.p, [[1500, 2500, -3000]])
    assert readings.name is not None
    assert readings.name.tolist() == ["P1"]
    with pytest.raises(FileError, match=r"readings\.txt:1: has no column 'd'; there are a, b, c"):
        read_readings(write(tmp_path, "a,b,c", "1,2,3"), Columns.parse("x=a, y=b, z=d"))


def test_columns_that_are_not_there(tmp_path: Path) -> None:
    path = write(tmp_path, "1 2 3 4")
    with pytest.raises(FileError, match=r"readings\.txt:1: has no column 9; there are 4"):
        read_readings(path, Columns.parse("x=1, y=2, z=9"))
    with pytest.raises(FileError, match="has no column 'up'; there are column 1, column 2"):
        read_readings(path, Columns.parse("x=1, y=2, z=up"))
    saved = tmp_path / "columns.toml"
    saved.write_text("x = 1\ny = ")
    with pytest.raises(FileError, match=r"columns\.toml: is not TOML"):
        Columns.load(saved)


@pytest.fixture(scope="module")
def measured() -> Samples:
    cell = VirtualCell("hard", seed=3)
    return cell.measure(cell.design(200), reflectors=3)


def spoilt(samples: Samples, rng: np.random.Generator) -> tuple[Samples, dict[str, set[int]]]:
    """Return what a bad day makes of samples: 5 % missing, 2 % doubled, 2 % swapped, 1 % gross; and which rows."""
    n = len(samples)
    rows = rng.permutation(np.arange(1, n - 1))
    missing, doubled, swapped, gross = np.split(rows, np.cumsum([n // 20, n // 50, n // 50]))
    gross = gross[: n // 100]
    p = samples.p_meas.copy()
    p[gross] += 40.0 * rng.choice([-1.0, 1.0], (len(gross), 3))
    order = np.arange(n)
    order[swapped[0::2]], order[swapped[1::2]] = swapped[1::2], swapped[0::2]
    order = np.repeat(order, np.where(np.isin(order, doubled), 2, 1))
    p[missing[: len(missing) // 2]] = 0.0  # half of them as rows of zeros, the others left out
    order = order[~np.isin(order, missing[len(missing) // 2 :])]
    values = {name: getattr(samples, name) for name in samples.columns() if name != "p_meas"}
    names = ("missing", "doubled", "swapped", "gross")
    which = {name: set(rows.tolist()) for name, rows in zip(names, (missing, doubled, swapped, gross), strict=True)}
    return Samples(p, **values, source=samples.source)[order], which


@pytest.mark.sampled(3)
@pytest.mark.parametrize("layout", [layout.key for layout in LAYOUTS])
def test_there_and_back(tmp_path: Path, measured: Samples, layout: str, rng: np.random.Generator) -> None:
    """Virtual cell, file, import: the same samples within the layout's rounding; what is wrong is found and named."""
    bad, which = spoilt(measured, rng)
    path = tmp_path / "readings.txt"
    write_readings(path, bad, layout)
    readings = read_readings(path)
    assert readings.layout == next(known.name for known in LAYOUTS if known.key == layout)
    plan = Poses(p_cmd=measured.p_cmd, q=measured.q, row=measured.row, source="plan.csv")
    samples, summary = match(readings, plan, reorder=True, missing=True)
    assert set(summary.missing) == which["missing"]
    assert set(summary.reordered) == which["swapped"]
    assert set(summary.outliers) == which["gross"]
    assert summary.averaged == len(which["doubled"])
    good = ~np.isin(measured.row, [*which["missing"], *which["gross"]])
    back = samples[~np.isin(samples.row, list(which["gross"]))]
    np.testing.assert_allclose(back.p_meas, measured.p_meas[good], rtol=0, atol=1.01 * ROUNDING_MM[layout] + 1e-9)
    if layout in ROUNDING_RAD:
        assert back.rotation_meas is not None
        turn = (back.rotation_meas * measured.rotation_meas[good].inv()).magnitude()
        assert turn.max() < ROUNDING_RAD[layout]
    said = " ".join(summary.sentences())
    for what in (
        "read in another order, and reordered",
        "without a reading, left out",
        "far from the expected positions",
        "repeat another",
    ):
        assert what in said


def test_no_such_layout(tmp_path: Path, measured: Samples) -> None:
    with pytest.raises(DataError, match="expected a layout of spatial-analyzer, tidy, leica"):
        write_readings(tmp_path / "x", measured, "xls")
    with pytest.raises(DataError, match="has no commanded positions"):
        write_readings(tmp_path / "x", Samples(np.ones((2, 3)), q=np.zeros((2, 6))), "motion")


@pytest.mark.promise("No layout writes a name that a spreadsheet would take for a formula")
def test_no_layout_writes_a_formula(tmp_path: Path, record_property) -> None:
    virtual = VirtualCell("paper", seed=4)
    names = np.array(["=1+2", "+x", "-y", "@a"])
    samples = replace(virtual.measure(virtual.design(4, seed=1)), name=names)
    for layout in LAYOUTS:
        path = tmp_path / "a.txt"
        write_readings(path, samples, layout.key)
        for line in path.read_bytes().decode("latin-1").splitlines():
            cells = [cell.strip() for cell in re.split("[,;\t]", line)]
            assert not any(re.match("[=+@]|-[a-z]", cell) for cell in cells), (layout.key, line)
    record_property("cases", 4 * len(LAYOUTS))
