"""The tidy table: reading, writing, and every trap with the message that it gives."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from truepose.errors import DataError, FileError
from truepose.robots import load_robot
from truepose.samples import (
    Poses,
    Samples,
    append_columns,
    check,
    check_against,
    check_not_compensated,
    load_example,
    read_poses,
    read_samples,
    write_samples,
)
from truepose.simulation import VirtualCell

HEADER = "row,q1_deg,q2_deg,x_cmd_mm,y_cmd_mm,z_cmd_mm,x_meas_mm,y_meas_mm,z_meas_mm"
ROWS = ["7,10,20,100,0,0,2100,1,2", "8,-30,90,400,50,10,2400,51,12", "9,45,15,100,300,10,2100,301,12.5"]


def table(tmp_path: Path, *lines: str, name: str = "samples.csv") -> Path:
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def random_samples(rng: np.random.Generator, n: int = 40) -> Samples:
    p_cmd = rng.uniform(-800, 800, (n, 3))
    return Samples(
        p_meas=Rotation.random(rng=rng).apply(p_cmd) + np.array([3000.0, -200.0, 400.0]),
        q=rng.uniform(-3, 3, (n, 6)),
        p_cmd=p_cmd,
        rotation_cmd=Rotation.random(n, rng=rng),
        rotation_meas=Rotation.random(n, rng=rng),
        p_std=rng.uniform(0.001, 0.05, (n, 3)),
        rotation_std=rng.uniform(1e-6, 1e-5, (n, 3)),
        approach=rng.choice([-1.0, 0.0, 1.0], (n, 6)),
        time=np.arange(n) * 7.5,
        temperature=rng.uniform(18, 24, n),
        load=np.full(n, 12.5),
        name=np.array([f"P{i}" for i in range(n)]),
        row=np.arange(n) * 2 + 5,
    )


def test_units_and_row_names(tmp_path: Path) -> None:
    samples = read_samples(table(tmp_path, HEADER, *ROWS))
    assert samples.q is not None
    np.testing.assert_allclose(samples.q[0], np.radians([10, 20]))
    np.testing.assert_array_equal(samples.p_meas[:, 0], [2100, 2400, 2100])
    assert samples.rows(np.array([0, 2])) == "lines 2, 4"


def test_other_units_other_order_other_delimiter(tmp_path: Path) -> None:
    lines = ["x_meas_m;z_meas_in;y_meas_cm;Q1_rad;note", "2,1;10;5;0,5;first, of all", "1,1;20;6;-0,5;"]
    samples = read_samples(table(tmp_path, *lines))
    np.testing.assert_allclose(samples.p_meas, [[2100, 50, 254], [1100, 60, 508]])
    assert samples.q is not None
    np.testing.assert_array_equal(samples.q[:, 0], [0.5, -0.5])


def test_comment_lines_and_byte_order_mark(tmp_path: Path) -> None:
    path = table(tmp_path, "\ufeff# measured in June", HEADER, "# first series", *ROWS, "")
    assert len(read_samples(path)) == 3


def test_orientation_conventions(tmp_path: Path) -> None:
    header = "q1_deg,roll_cmd_deg,pitch_cmd_deg,yaw_cmd_deg,x_meas_mm,y_meas_mm,z_meas_mm"
    header += ",rx_meas_deg,ry_meas_deg,rz_meas_deg"
    samples = read_samples(table(tmp_path, header, "1,10,20,30,2000,0,0,40,50,60", "2,0,0,0,2500,0,0,0,0,0"))

    def turn(axis: str, degrees: float) -> Rotation:
        return Rotation.from_euler(axis, degrees, degrees=True)

    assert samples.rotation_cmd is not None
    assert samples.rotation_meas is not None
    commanded, measured = turn("z", 30) * turn("y", 20) * turn("x", 10), turn("x", 40) * turn("y", 50) * turn("z", 60)
    np.testing.assert_allclose(samples.rotation_cmd[0].as_matrix(), commanded.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(samples.rotation_meas[0].as_matrix(), measured.as_matrix(), atol=1e-15)


def test_comes_back(tmp_path: Path, rng: np.random.Generator) -> None:
    samples = random_samples(rng)
    write_samples(tmp_path / "out.csv", samples)
    again = read_samples(tmp_path / "out.csv")
    assert set(again.columns()) == {*samples.columns(), "line"}
    assert again.rows(np.array([1])) == "point P1 (line 3)"
    for name in samples.columns():
        before, after = getattr(samples, name), getattr(again, name)
        if isinstance(before, Rotation):
            np.testing.assert_allclose((before * after.inv()).magnitude(), 0, atol=1e-10)
        elif name == "name":
            np.testing.assert_array_equal(after, before)
        else:
            np.testing.assert_allclose(after, before, rtol=1e-11)


def test_gimbal_lock_comes_back_without_a_warning(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    rotation = Rotation.from_euler("ZYX", [[30, 90, 10], [0, -90, 5]], degrees=True)
    write_samples(tmp_path / "plan.csv", Poses(q=np.zeros((2, 6)), rotation_cmd=rotation))
    again = read_poses(tmp_path / "plan.csv").rotation_cmd
    assert again is not None
    np.testing.assert_allclose((rotation * again.inv()).magnitude(), 0, atol=1e-7)
    assert not recwarn.list


@given(q=arrays(float, (3, 6), elements=st.floats(-6.2, 6.2)))
def test_joints_come_back(tmp_path_factory: pytest.TempPathFactory, q: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("joints") / "poses.csv"
    write_samples(path, Poses(q=q))
    again = read_poses(path).q
    assert again is not None
    np.testing.assert_allclose(again, q, rtol=1e-11, atol=1e-15)


def test_poses_do_not_look_into_measurements(tmp_path: Path) -> None:
    path = table(tmp_path, "name,q1_deg,x_meas_mm,x_pred_mm,std_mm", "P1,10,nan,1,2", "P2,20,none,1,2")
    poses = read_poses(path)
    assert poses.name is not None
    assert poses.name.tolist() == ["P1", "P2"]
    assert type(poses) is Poses


def test_columns_are_appended_and_replaced(tmp_path: Path) -> None:
    path = table(tmp_path, "q1_deg;note;x_pred_mm", '10,5;"a;b";1', "20,5;;2")
    append_columns(path, tmp_path / "out.csv", {"x_pred_mm": np.array([0.5, 2]), "std_mm": np.array([0.1, 1 / 3])})
    expected = 'q1_deg;note;x_pred_mm;std_mm\n10,5;"a;b";0.5;0.1\n20,5;;2;0.333333333333\n'
    assert (tmp_path / "out.csv").read_text() == expected
    with pytest.raises(DataError, match="has 2 rows, but the column std_mm has 3"):
        append_columns(path, tmp_path / "out.csv", {"std_mm": np.zeros(3)})


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "is empty; expected a header line"),
        (["# only a comment"], "is empty"),
        ([HEADER], "samples.csv:1: has a header but no rows"),
        ([HEADER, *ROWS, "10,1,2,3"], "samples.csv:5: has 4 fields, the header has 9"),
        (["q1_deg,x_meas_mm,y_meas_mm,z_meas_mm", "1,5,2100,1,2,3,3,1"], "decimal commas?"),
        ([HEADER, ROWS[0], ROWS[1].replace("51", "x51")], "samples.csv:3: y_meas_mm is 'x51', which is not a number"),
        ([HEADER, ROWS[0].replace("2100", "")], "samples.csv:2: x_meas_mm is empty, which is not a number"),
        ([HEADER, ROWS[0], ROWS[1].replace("2400", "NaN")], "samples.csv:3: x_meas_mm is NaN; measure again or remove"),
        ([HEADER, ROWS[0].replace("7,", "7.5,")], "samples.csv:2: row is 7.5, which is not a whole number"),
        (["q1_deg;x_meas_mm;y_meas_mm;z_meas_mm", "1,5;2.5;3;4"], "has decimal points and decimal commas (1,5)"),
        ([HEADER.replace("y_meas", "y_maes"), *ROWS], "unknown column y_maes_mm; did you mean y_meas_mm?"),
        ([HEADER.replace("y_meas_mm", "note"), *ROWS], "has x_meas_mm, z_meas_mm but not y_meas_mm"),
        ([HEADER.replace("x_meas_mm", "x_meas"), *ROWS], "column x_meas has no unit; name it x_meas_mm or x_meas_m"),
        ([HEADER.replace("x_meas_mm", "x_meas_ft"), *ROWS], "column x_meas_ft has the unknown unit 'ft'"),
        ([HEADER.replace("q2_deg", "q1_rad"), *ROWS], "columns q1_deg and q1_rad are the same quantity; keep only one"),
        ([HEADER.replace("q1_deg", "q3_deg"), *ROWS], "has q3_deg, q2_deg but not q1_deg"),
        (
            ["rx_cmd_deg," + HEADER, *("0," + row for row in ROWS)],
            "unknown column rx_cmd_deg; commanded orientations are",
        ),
        (["q1_deg,q2_cmd_m,y_mm", "1,2,3"], "unknown column q2_cmd_m; known are"),
        (["q1_deg,y_mm", "1,2"], "needs columns x_meas_mm …; it has q1_deg, y_mm"),
        (["x_meas_mm,y_meas_mm,z_meas_mm", "1,2,3"], "needs columns q1_deg … or x_cmd_mm …"),
    ],
)
def test_files_that_are_no_tidy_table(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(FileError, match=re.escape(message)):
        read_samples(table(tmp_path, *lines))


def test_samples_are_shown_in_a_few_lines() -> None:
    samples = VirtualCell("hard", seed=3).measure(VirtualCell("hard", seed=3).design(30), reflectors=3)
    lines = repr(samples).splitlines()
    assert lines[0] == "Samples: 30 rows from virtual cell, seed 3"
    assert len(lines) < 15
    assert max(map(len, lines)) < 100
    for words in ("6 joints, -", "mm (base frame)", "mm (tracker frame)", "mm per axis (RMS)", "s from first to last"):
        assert words in repr(samples)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_of_spreadsheets(tmp_path: Path, encoding: str) -> None:
    lines = ["name;q1_deg;x_meas_mm;y_meas_mm;z_meas_mm", "Prüfling;10,5;2100;1,5;0"]
    (tmp_path / "samples.csv").write_bytes("\r\n".join(lines).encode(encoding))
    samples = read_samples(tmp_path / "samples.csv")
    assert samples.name is not None
    assert samples.name.tolist() == ["Prüfling"]
    np.testing.assert_array_equal(samples.p_meas, [[2100.0, 1.5, 0.0]])


def test_not_text(tmp_path: Path) -> None:
    (tmp_path / "samples.csv").write_bytes(b"PK\x03\x04\x14\x00")
    with pytest.raises(FileError, match="is not a workbook, or is damaged"):
        read_samples(tmp_path / "samples.csv")


def test_a_name_that_would_break_the_table(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="contains a delimiter"):
        write_samples(tmp_path / "plan.csv", Poses(q=np.zeros((1, 6)), name=np.array(["a,b"])))
    assert not (tmp_path / "plan.csv").exists()


def test_all_zero_reading_by_row(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"samples\.csv: line 3: all-zero reading"):
        read_samples(table(tmp_path, HEADER, ROWS[0], "8,-30,90,400,50,10,0,0,0", ROWS[2]))


def test_shapes_and_not_finite() -> None:
    with pytest.raises(DataError, match=r"p_meas has shape \(2, 2\); expected \(2, 3\)"):
        Samples(np.zeros((2, 2)), q=np.zeros((2, 6)))
    with pytest.raises(DataError, match="p_meas has 3 rows, q has 2"):
        Samples(np.ones((3, 3)), q=np.zeros((2, 6)))
    with pytest.raises(DataError, match="row 12: p_meas is not finite"):
        Samples(np.array([[1, 2, 3], [1, np.nan, 3]]), q=np.zeros((2, 6)), row=np.array([11, 12]))
    with pytest.raises(DataError, match="neither joints"):
        Samples(np.ones((3, 3)))
    with pytest.raises(DataError, match="has no rows"):
        check(Poses(q=np.zeros((0, 6))))


@pytest.mark.parametrize("which", ["measured", "commanded"])
@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1 / 25.4, "inches"), (0.1, "centimetres")])
def test_other_units_under_mm(rng: np.random.Generator, which: str, factor: float, unit: str) -> None:
    samples = random_samples(rng)
    check(samples)
    name = {"measured": "p_meas", "commanded": "p_cmd"}[which]
    with pytest.raises(DataError, match=rf"the {which} positions spread .*{unit}"):
        check(replace(samples, **{name: getattr(samples, name) * factor}))


def test_both_in_metres(rng: np.random.Generator) -> None:
    samples = random_samples(rng)
    assert samples.p_cmd is not None
    with pytest.raises(DataError, match=r"the commanded positions spread over .* mm; are they metres\? Name"):
        check(replace(samples, p_meas=samples.p_meas / 1e3, p_cmd=samples.p_cmd / 1e3))


def test_repeats_of_one_pose_are_not_metres(rng: np.random.Generator) -> None:
    check(Samples(rng.normal(scale=0.1, size=(30, 3)), q=np.ones((30, 6))))


def test_degrees_under_rad(rng: np.random.Generator) -> None:
    samples = random_samples(rng)
    assert samples.q is not None
    with pytest.raises(DataError, match=r"joints up to 17\d\.\d rad; are they degrees"):
        check(replace(samples, q=np.degrees(samples.q)))


def test_readings_that_do_not_move(rng: np.random.Generator) -> None:
    with pytest.raises(DataError, match="all measured positions are equal"):
        check(replace(random_samples(rng), p_meas=np.full((40, 3), 2000.0)))


def test_signs_and_standard_deviations(rng: np.random.Generator) -> None:
    samples = random_samples(rng)
    assert samples.approach is not None
    assert samples.p_std is not None
    with pytest.raises(DataError, match="point P0: approach must be -1, 0 or"):
        check(replace(samples, approach=np.vstack([np.full((1, 6), 0.5), samples.approach[1:]])))
    with pytest.raises(DataError, match="point P2: negative standard deviation in p_std"):
        check(replace(samples, p_std=np.where(np.arange(40)[:, None] == 2, -0.1, samples.p_std)))


def test_contradicting_repeats(rng: np.random.Generator) -> None:
    samples = random_samples(rng)
    twice = samples[np.r_[0:40, 3]]
    check(replace(twice, p_meas=twice.p_meas + rng.normal(scale=0.05, size=(41, 3))))
    p_meas = twice.p_meas.copy()
    p_meas[40, 0] += 30.0
    moved = replace(twice, p_meas=p_meas, row=np.arange(41))
    with pytest.raises(
        DataError, match=r"points P3 \(row 3\), P3 \(row 40\): readings of one configuration are 30 mm apart"
    ):
        check(moved)
    load = np.r_[np.zeros(40), 150.0]
    check(replace(moved, load=load))  # another payload is another configuration


@pytest.mark.exhaustive
def test_many_rows_are_read_again(tmp_path: Path, rng: np.random.Generator) -> None:
    samples = random_samples(rng, 12_000)
    write_samples(tmp_path / "many.csv", samples)
    again = read_samples(tmp_path / "many.csv")
    assert len(again) == 12_000


class TestAgainstRobot:
    robot = load_robot("kuka-kr210-r2700-extra")

    def poses(self, rng: np.random.Generator, n: int = 30) -> Poses:
        q = np.radians(np.array([0, -80, 90, 0, 30, 0]) + rng.uniform(-30, 30, (n, 6)))
        tool = np.eye(4)
        tool[:3, 3] = [120.0, 0.0, 350.0]
        return Poses(q=q, p_cmd=self.robot.forward(q, tool=tool)[:, :3, 3] + rng.normal(scale=0.01, size=(n, 3)))

    def test_unknown_tool_and_frame_do_not_matter(self, rng: np.random.Generator) -> None:
        poses = self.poses(rng)
        assert poses.p_cmd is not None
        turned = replace(poses, p_cmd=Rotation.random(rng=rng).apply(poses.p_cmd) + np.array([500, 0, -30]))
        assert check_against(turned, self.robot).max() < 0.1

    def test_row_is_named(self, rng: np.random.Generator) -> None:
        poses = self.poses(rng)
        assert poses.p_cmd is not None
        p_cmd = poses.p_cmd.copy()
        p_cmd[[4, 9]] = p_cmd[[9, 4]]
        with pytest.raises(DataError, match=r"rows 4, 9: joints and commanded positions disagree by up to .* swapped"):
            check_against(replace(poses, p_cmd=p_cmd), self.robot)

    @pytest.mark.sampled(1)
    @pytest.mark.parametrize(
        ("q", "p", "unit"),
        [
            (np.pi / 180, 1.0, "the joints are radians; name the columns q1_rad"),
            (1.0, 1e-3, "the commanded positions are metres"),
            (np.pi / 180, 1e-3, "the joints are radians and the positions metres"),
        ],
    )
    def test_unit_that_explains_it(self, rng: np.random.Generator, q: float, p: float, unit: str) -> None:
        poses = self.poses(rng)
        assert poses.q is not None
        assert poses.p_cmd is not None
        with pytest.raises(DataError, match=unit):
            check_against(replace(poses, q=poses.q * q, p_cmd=poses.p_cmd * p), self.robot)

    def test_another_robot(self, rng: np.random.Generator) -> None:
        with pytest.raises(DataError, match="is it this robot"):
            check_against(self.poses(rng), load_robot("abb-irb120"))

    def test_one_orientation(self, rng: np.random.Generator) -> None:
        p_cmd = rng.uniform(-400, 400, (20, 3)) + np.array([1700, 0, 1200])
        targets = np.tile(np.eye(4), (20, 1, 1))
        targets[:, :3, :3] = Rotation.from_euler("ZYX", [0, 90, 0], degrees=True).as_matrix()
        targets[:, :3, 3] = p_cmd
        q = self.robot.inverse(targets)[:, 0]
        found = np.isfinite(q).all(axis=1)
        assert check_against(Poses(q=q[found], p_cmd=p_cmd[found]), self.robot).max() < 1e-3

    def test_controller_that_compensates(self, rng: np.random.Generator) -> None:
        """A display of the calibrated model beside nominal joints: told before anything is fitted."""
        poses = self.poses(rng)
        size = {"a": 0.5, "d": 0.5, "offset": 1e-3, "alpha": 1e-3}
        change = {key: getattr(self.robot, key) + rng.normal(scale=s, size=6) for key, s in size.items()}
        accurate = replace(self.robot, **change)
        shown = replace(poses, p_cmd=accurate.forward(poses.q, tool=[120.0, 0.0, 350.0])[:, :3, 3])
        check_not_compensated(poses, self.robot)
        with pytest.raises(DataError, match=r"disagree by 0\.\d+ mm \(median\).*seems to compensate already"):
            check_not_compensated(shown, self.robot)

    def test_nothing_to_compare(self, rng: np.random.Generator) -> None:
        assert len(check_against(Poses(q=np.zeros((20, 6))), self.robot)) == 0


def test_measured_robot(ur10: Path) -> None:
    samples = read_samples(ur10 / "samples.csv")
    assert len(samples) == 632
    assert {"q", "p_cmd", "rotation_cmd", "rotation_meas", "p_std", "rotation_std", "temperature"} <= set(
        samples.columns()
    )
    check_not_compensated(samples, load_robot("universal-robots-ur10"))
    left = check_against(samples, load_robot("universal-robots-ur10"))
    assert np.median(left) < 3.0


def test_example(ur10: Path) -> None:
    example = load_example("ur10")
    assert "MIT" in example.description
    assert "MIT License" in (ur10 / "LICENSE").read_text("utf-8")
    assert example.samples.source == "ur10/samples.csv"
    np.testing.assert_array_equal(example.samples.p_meas, read_samples(ur10 / "samples.csv").p_meas)
    with pytest.raises(DataError, match="no example 'ur5'; expected one of ur10"):
        load_example("ur5")
