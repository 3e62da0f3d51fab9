"""A backup of a Yaskawa controller: recognised, read with its frames, corrected; checked by a reader of its own."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.programs.backups import yaskawa as corpus
from tests.programs.backups.compare import (
    Own,
    digits_agree,
    listing,
    places_agree,
    transform,
    zero_changes_no_byte,
)
from tests.programs.backups.small import lay
from tests.programs.joint_arms import Sagging

from truepose.programs import Program, ReadOptions, Target, correct_program, read_programs
from truepose.programs.backups import yaskawa
from truepose.robots import Robot, load_robot


def read(folder: Path, **options: Any) -> dict[str, Program]:
    """Read a backup; the programs by the names of their jobs."""
    found = read_programs([folder], None, ReadOptions(**options))
    assert not found.unreadable
    return {program.path.stem: program for program in found.programs}


def reasons(programs: dict[str, Program]) -> dict[str, str]:
    return {f"{name} {t.name}": t.reason for name, one in programs.items() for t in one.targets if t.reason}


# a reader of its own: regular expressions, no code of the library


class Taught(NamedTuple):
    """A position in a job: its frame, its six numbers and their bytes."""

    frame: int
    numbers: tuple[float, ...]
    spans: tuple[tuple[int, int], ...]


LINE = re.compile(
    rb"(?m)^(?:///(\w+) ([^\r\n]*)|(C\d+)=([-\d.]+),([-\d.]+),([-\d.]+),([-\d.]+),([-\d.]+),([-\d.]+))\r$"
)


def taught(data: bytes) -> Iterator[tuple[str, Taught]]:
    """Yield every rectangular C position of a job."""
    modal = {b"POSTYPE": b""}
    for m in LINE.finditer(data, 0, data.index(b"//INST")):
        if m[1]:
            modal[m[1]] = m[2]
        elif modal[b"POSTYPE"] != b"PULSE":
            frame = int(modal[b"USER"]) if modal[b"POSTYPE"] == b"USER" else 0
            groups = range(4, 10)
            yield m[3].decode(), Taught(frame, tuple(float(m[k]) for k in groups), tuple(m.span(k) for k in groups))


def matrix(values: tuple[float, ...]) -> np.ndarray:
    return transform((*values[:3], *reversed(values[3:])), "zyx")


def base_of(frame: int) -> np.ndarray:
    return matrix(corpus.FRAMES[frame][1]) if frame else np.eye(4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay(tmp_path_factory.mktemp("yaskawa") / "cell", corpus.backup())


@pytest.fixture(scope="module")
def programs(folder: Path) -> dict[str, Program]:
    return read(folder, derived=True)


def test_the_controller_is_recognised_and_its_files_are_sorted(folder: Path, tmp_path: Path) -> None:
    files = listing(folder)
    assert yaskawa.roots(files) == [folder]
    found = yaskawa.contents(folder, files)
    jobs = {name for name in corpus.backup() if name.endswith(".JBI")}
    assert {path.name for (path,) in found.programs} == jobs
    assert len(jobs) >= 30
    assert {path.name: word for path, word in found.others.items()} == {
        "TOOL.CND": "data",
        "UFRAME.CND": "data",
        "VAR.DAT": "data",
        "ALL.PRM": "machine data",
        "SYSTEM.SYS": "system data",
        "CMOS.BIN": "image",
    }
    assert (found.robot, found.version, found.warnings) == ("1-06VXH25-A0*(GP25)", "YAS4.81.00A(DE/EN)-00", [])
    lay(tmp_path, {name: data for name, data in corpus.backup().items() if name in jobs})
    assert yaskawa.roots(listing(tmp_path)) == []  # jobs alone are no backup


def test_frames_are_read_with_names_and_lines(folder: Path) -> None:
    stored = yaskawa.stored_frames(folder, listing(folder))
    for table, given, name in ((stored.tools, corpus.TOOLS, "TOOL"), (stored.bases, corpus.FRAMES, "UFRAME")):
        assert set(table) == set(given)
        lines = corpus.backup()[f"{name}.CND"].decode().split("\r\n")
        for number, (title, values) in given.items():
            np.testing.assert_allclose(table[number].tf, matrix(values), atol=1e-9)
            line = int(table[number].place.removeprefix(f"{name}.CND, line "))
            assert corpus.pose(values) in lines[line - 1]
            assert table[number].name == title


def test_names_in_lower_case_give_the_same_targets(tmp_path: Path, programs: dict[str, Program]) -> None:
    lower = read(lay(tmp_path, {name.lower(): data for name, data in corpus.backup().items()}), derived=True)
    counts = {name.lower(): one.counts() for name, one in programs.items()}
    assert {name: one.counts() for name, one in lower.items()} == counts


def own(program: Program) -> Callable[[Target], Own]:
    """Return what finds the targets of a job in its text."""
    known = dict(taught(program.path.read_bytes()))

    def find(target: Target) -> Own:
        one = known[target.name]
        return Own(base_of(one.frame), matrix(one.numbers), one.spans)

    return find


def test_every_target_that_is_corrected_stands_in_the_base_of_an_independent_reader(
    programs: dict[str, Program],
) -> None:
    assert sum(places_agree(program, own(program)) for program in programs.values()) > 1000


def test_a_zero_correction_changes_no_byte(programs: dict[str, Program]) -> None:
    assert zero_changes_no_byte(programs.values()) >= 25


def test_corrected_digits_agree_with_a_computation_of_their_own(programs: dict[str, Program]) -> None:
    """Every target that may be corrected, to the digit; nothing else in the file changes."""
    assert sum(digits_agree(program, own(program)) for program in programs.values()) > 1000


def test_most_targets_are_corrected_and_the_others_have_a_reason(programs: dict[str, Program]) -> None:
    moved = [t for one in programs.values() for t in one.targets if t.motions or t.derived]
    cartesian = [t for t in moved if t.joint_form is None]
    assert sum(t.verdict == "correct" for t in cartesian) >= 0.85 * len(cartesian)
    kinds = Counter(re.sub(r"\d+", "#", t.reason) for t in cartesian if t.reason)
    assert kinds == {
        "a coordinated motion: its path moves with another group, which has no model": 4,
        "SFTON (line # of SEARCH.JBI) shifts it at run time": 3,
        "P# is a variable of all jobs, whose value is in VAR.DAT (line #); that file has a checksum and is only read: "
        "teach a C position instead": 2,
        "SYSTART CV#(#) STP=#.# (line #) may shift it at run time; corrections do not know by how much": 1,
    }


def test_constant_shifts_of_other_jobs_belong_to_the_target(programs: dict[str, Program]) -> None:
    layer = programs["LAYER-1"].targets[0]
    steps = {shift for one in layer.derived for shift in one.shifts}
    assert steps == {(0.0, 0.0, 80.0), (220.0, 0.0, 0.0), (440.0, 0.0, 0.0)}  # along the axes of USER 3, its frame
    assert layer.motions
    dip = programs["DIP"].targets[0]
    assert [(one.shifts, one.axes) for one in dip.derived] == [(((0.0, 0.0, -120.0),), "tool")]
    clean = programs["CLEAN"].targets
    assert [one.shifts for one in clean[3].derived] == [((0.0, 0.0, 45.0),)]
    assert not clean[3].motions  # only the shifted position is moved to
    assert clean[0].motions


@pytest.mark.parametrize("turned", [None, (220.0, 0.0, 0.0, 0.0, 0.0, 5.0)])
def test_shifts_that_are_not_constant_are_left_with_their_place(tmp_path: Path, turned: Any) -> None:
    files = corpus.backup()
    if turned is None:
        files["SPOILS.JBI"] = corpus.Job("SPOILS").data().replace(b"NOP\r\n", b"NOP\r\nADD P012 P030\r\n")
    else:
        files["VAR.DAT"] = files["VAR.DAT"].replace(
            corpus.pose(corpus.VARIABLES[12][1]).encode(), corpus.pose(turned).encode()
        )
    found = read(lay(tmp_path, files), derived=True)
    wanted = "shifts it at run time" if turned is None else "turns it: P012 holds angles"
    for target in found["LAYER-2"].targets:
        assert target.verdict == "skip"
        assert re.search(rf"SFTON \(line \d+ of MAIN-STACK.JBI\) {wanted}", target.reason)


def test_a_shift_that_a_called_job_leaves_active_reaches_the_caller(tmp_path: Path) -> None:
    files = corpus.backup()
    files["ON.JBI"] = corpus.Job("ON").data().replace(b"NOP\r\n", b"NOP\r\nSFTON P099\r\n")
    files["OVER.JBI"] = corpus.Job("OVER").data().replace(b"NOP\r\n", b"NOP\r\nCALL JOB:ON\r\n")
    files["BELT.JBI"] = files["BELT.JBI"].replace(b"NOP\r\n", b"NOP\r\nCALL JOB:OVER\r\n")
    found = read(lay(tmp_path, files))
    assert found["BELT"].targets[0].reason == "SFTON (line 10 of ON.JBI) shifts it at run time"
    files["BELT.JBI"] = files["BELT.JBI"].replace(b"CALL JOB:OVER\r\n", b"CALL I000\r\n")  # any job
    found = read(lay(tmp_path, files))
    assert found["BELT"].targets[0].reason == "SFTON (line 10 of ON.JBI) shifts it at run time"


def test_a_relative_job_that_is_called_in_another_frame_is_left(tmp_path: Path) -> None:
    files = corpus.backup()
    files["MAIN.JBI"] = files["MAIN.JBI"].replace(b"CALL JOB:WELD-01", b"CALL JOB:WELD-01 UF#(7)")
    found = read(lay(tmp_path, files))
    wanted = "a relative job: CALL JOB:WELD-01 UF#(7) (line 15 of MAIN.JBI) gives it another user frame"
    moved = [t for t in found["WELD-01"].targets if t.motions and t.joint_form is None]
    assert {t.reason for t in moved} == {wanted}


def test_copies_of_variables_are_corrected_only_where_the_job_alone_has_them(tmp_path: Path) -> None:
    files = corpus.backup()
    files["VAR.DAT"] = files["VAR.DAT"].replace(b'"RECTAN"0,0,2,' + b"0" * 24 + b",0,16,870.250", b'"UNUSED"')
    found = read(lay(tmp_path, files))
    assert {t.name: t.verdict for t in found["SERVICE"].targets}["P00007"] == "correct"
    files["OTHER.JBI"] = corpus.Job("OTHER").data().replace(b"NOP\r\n", b"NOP\r\nMOVL P007 V=5.0\r\n")
    found = read(lay(tmp_path, files))
    reason = {t.name: t.reason for t in found["SERVICE"].targets}["P00007"]
    assert reason == "P007 is a variable of all jobs: OTHER.JBI, line 10, uses it, too"
    files["OTHER.JBI"] = b"/JOB\r\nbroken"
    found_all = read_programs([lay(tmp_path, files)])
    assert [error.path.name for error in found_all.unreadable] == ["OTHER.JBI"]
    service = next(one for one in found_all.programs if one.path.name == "SERVICE.JBI")
    reason = {t.name: t.reason for t in service.targets}["P00007"]
    assert reason == "P007 is a variable of all jobs, and OTHER.JBI cannot be read"


def test_jobs_of_a_second_robot_are_left(tmp_path: Path) -> None:
    files = corpus.backup()
    files["SYSTEM.SYS"] = files["SYSTEM.SYS"].replace(b"S1 : TURN-1", b"R2 : 1-06VXH12-A0*(GP12)")
    files["DIP.JBI"] = files["DIP.JBI"].replace(b"///GROUP1 RB1", b"///GROUP1 RB2")
    files["BELT.JBI"] = files["BELT.JBI"].replace(b"///GROUP1 RB1", b"///GROUP1 RB1\r\n///GROUP2 RB2")
    files["BELT.JBI"] = files["BELT.JBI"].replace(b"MOVJ C00000 VJ=50.00", b"MOVJ C00000 VJ=50.00  +MOVJ C00001")
    folder = lay(tmp_path, files)
    assert (
        "2 robots (R1 1-06VXH25-A0*(GP25), R2 1-06VXH12-A0*(GP12))"
        in yaskawa.contents(folder, listing(folder)).warnings[0]
    )
    found = read(folder)
    assert {t.reason for t in found["DIP"].targets} == {"moves RB2, which is not the robot of the map"}
    belt = {t.name: t.reason for t in found["BELT"].targets}
    assert (belt["C00000"], belt["C00001"]) == ("", "moves RB2, which is not the robot of the map")


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("TOOL.CND", b"12.500,-0.750", b"12.5.0,-0.750", r"TOOL\.CND:12: 12\.5\.0 is not a number"),
        ("TOOL.CND", b"352.250,0.0000,-35.0000,0.0000", b"352.250", r"TOOL\.CND:12: has 3 numbers, expected 6"),
        ("UFRAME.CND", b"////BUSER 900.000,-420.500", b"////BUSER 900.000", r"UFRAME\.CND:10: has 5 numbers"),
        ("UFRAME.CND", b"//UFRAME 2\r\n", b"//UFRAME 1\r\n//UFRAME 1\r\n", "user frame 1 is given twice"),
        ("VAR.DAT", b",0,16,0.000,0.000,80.000", b",0,16,0.000,x,80.000", r"VAR\.DAT:\d+: x is not a number"),
    ],
)
def test_broken_data_are_named(tmp_path: Path, name: str, old: bytes, new: bytes, message: str) -> None:
    files = corpus.backup()
    assert old in files[name]
    files[name] = files[name].replace(old, new)
    found = read_programs([lay(tmp_path, files)])
    assert not found.programs
    assert re.search(message, str(found.unreadable[0]))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"///GROUP 1,0,0", b"///GROUP 1,0,1", "belongs to another group than R1"),
        (b"///GROUP 1,0,0", b"///GROUP 0,1,0", "belongs to another group than R1"),
        (b"////BUSER", b"////BASICFRM 0,19,4\r\n////BUSER", "is not given in the base"),
    ],
)
def test_user_frames_that_the_base_does_not_carry_are_refused(
    tmp_path: Path, old: bytes, new: bytes, problem: str
) -> None:
    files = corpus.backup()
    files["UFRAME.CND"] = files["UFRAME.CND"].replace(old, new)
    moved = [t for t in read(lay(tmp_path, files))["WELD-01"].targets if t.motions and t.joint_form is None]
    assert moved
    assert all(t.verdict == "refuse" and problem in t.reason for t in moved)


def test_without_user_frames_their_targets_ask_for_them(tmp_path: Path) -> None:
    files = {name: data for name, data in corpus.backup().items() if name != "UFRAME.CND"}
    folder = lay(tmp_path, files)
    assert "has no UFRAME.CND, so no user frame is known" in yaskawa.contents(folder, listing(folder)).warnings[0]
    moved = list(read(folder)["TRIM-01"].targets)
    assert {t.reason for t in moved} == {"base USER 5 is not known; give it in [frames.bases.5] of the cell file"}


# pulses


def pulses(tmp_path: Path, **more: bytes) -> Any:
    folder = lay(tmp_path, {**corpus.backup(), **{name.replace("_", "."): data for name, data in more.items()}})
    return yaskawa.for_reader(folder, listing(folder))["controller"]


def test_pulses_of_a_degree_follow_from_the_limits(tmp_path: Path) -> None:
    np.testing.assert_allclose(pulses(tmp_path).pulses, corpus.PER_DEGREE, rtol=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"268435", b"258435", "the limits in ALL.PRM agree with no limits of the data sheet: one was changed"),
        (b"760000", b"614000", "the controller's arm is no Motoman GP25: upper arm 614 mm instead of 760 mm"),
        (b"///RC1G", b"///RC9G", "the controller's arm is no Motoman GP25: its lengths (RC1G) are not stored"),
    ],
)
def test_without_agreement_pulses_are_left(tmp_path: Path, old: bytes, new: bytes, reason: str) -> None:
    data = corpus.all_prm()
    assert old in data
    found = pulses(tmp_path, ALL_PRM=data.replace(old, new, 1))
    assert (found.pulses, found.no_pulses) == ((), reason)
    home = read(tmp_path, joint_targets=True)["PICK-01"].targets[0]
    assert (home.verdict, home.reason) == ("skip", f"joint target (pulses): {reason}")


def test_robots_of_another_kind_have_no_constants(tmp_path: Path) -> None:
    found = pulses(tmp_path, SYSTEM_SYS=corpus.system_sys().replace(b"(GP25)", b"(MH24)"))
    assert found.no_pulses == "the limits of 1-06VXH25-A0*(MH24) in degrees are not known"


@pytest.mark.promise("Yaskawa pulses mean poses of the lengths that the controller stores, if that is stated.")
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("old", "new"), [(b"150000", b"151937"), (b"760000", b"758063"), (b"795000", b"796204")])
def test_measured_lengths_of_the_controller_are_the_arm(tmp_path: Path, old: bytes, new: bytes) -> None:
    found = pulses(tmp_path, ALL_PRM=corpus.all_prm().replace(old, new, 1))
    np.testing.assert_allclose(found.pulses, corpus.PER_DEGREE, rtol=1e-5)
    home = read(tmp_path, joint_targets=True)["PICK-01"].targets[0]
    assert (home.verdict, home.joints) == ("skip", None)
    assert f"{float(new) / 1000:g} mm instead of {float(old) / 1000:g} mm; state that the map was" in home.reason
    program = read(tmp_path, joint_targets=True, controller_kinematics=True)["PICK-01"]
    robot = load_robot("yaskawa-gp25")
    lengths = {b"150000": ("a", 1), b"760000": ("a", 2), b"795000": ("d", 3)}
    table, k = lengths[old]
    values = getattr(robot, table).copy()
    values[k] = np.copysign(float(new) / 1000, values[k])
    check_home(program, replace(robot, **{table: values}), Sagging(robot))


def taught_frames(arm: Robot, numbers: int = 2) -> bytes:
    """Return user frames whose points were taught with tool 4 of an arm, as a controller computes them."""
    lines = []
    rng = np.random.default_rng(7)
    tool = matrix(corpus.TOOLS[4][1])
    for number in range(1, numbers + 1):
        degrees = np.array([20.0, 15.0, -20.0, 10.0, -60.0, 25.0]) + rng.uniform(-30.0, 30.0, (3, 6))
        pulses = np.round(degrees * corpus.PER_DEGREE)
        p = (arm.forward(np.deg2rad(pulses / corpus.PER_DEGREE)) @ tool)[:, :3, 3]
        x = (p[1] - p[0]) / np.linalg.norm(p[1] - p[0])
        z = np.cross(x, p[2] - p[0])
        z /= np.linalg.norm(z)
        angles = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z])).as_euler("xyz", degrees=True)
        lines += [
            f"//UFRAME {number}",
            "///CRC 1",
            f"///NAME F{number}",
            "///TOOL 4",
            "///GROUP 1,0,0,0,0,0,0,0",
            "///PULSE",
        ]
        for k, (key, row) in enumerate(zip(("RORG", "RXX", "RXY"), pulses, strict=True)):
            lines.append(f"////{key} C{k:03}=" + ",".join(f"{v:.0f}" for v in row))
        lines.append(f"////BUSER {corpus.pose([*p[0], *angles])}")
    return corpus.crlf(lines)


@pytest.mark.promise("Where limits differ from the data sheet, the points of user frames give a Yaskawa's pulses.")
@pytest.mark.sampled(1)
@pytest.mark.parametrize("axes", [1, 2])
def test_pulses_of_a_degree_from_the_points_of_user_frames(tmp_path: Path, axes: int) -> None:
    data = changed_limits(corpus.all_prm(), axes)
    assert data != corpus.all_prm()
    robot = load_robot("yaskawa-gp25")
    found = pulses(tmp_path, ALL_PRM=data, UFRAME_CND=taught_frames(robot))
    np.testing.assert_allclose(found.pulses, corpus.PER_DEGREE, rtol=1e-4)
    longer = data.replace(b"760000", b"758063", 1)
    a = robot.a.copy()
    a[2] = np.copysign(758.063, a[2])
    found = pulses(tmp_path, ALL_PRM=longer, UFRAME_CND=taught_frames(replace(robot, a=a)))
    np.testing.assert_allclose(found.pulses, corpus.PER_DEGREE, rtol=1e-4)
    assert "758.063" in found.own_lengths
    for frames in (corpus.uframe_cnd(), taught_frames(robot, 1).replace(b"////BUSER ", b"////BUSER 1")):
        assert pulses(tmp_path, ALL_PRM=data, UFRAME_CND=frames).pulses == ()


def changed_limits(data: bytes, count: int) -> bytes:
    """Return the parameters with upper limits of axes 3 and 5 that are not those of the data sheet."""
    upper = [round(d * c) for d, c in zip(corpus.LIMITS_DEG[0], corpus.PER_DEGREE, strict=True)]
    for axis in (2, 4)[:count]:
        data = data.replace(b"%d," % upper[axis], b"%d," % round(1.2 * upper[axis]), 1)
    return data


def check_home(program: Program, robot: Robot, arm: Sagging) -> None:
    """Check the first position of a job, by an arm of the controller."""
    (data,) = correct_program(program, arm, on_guard="skip").files.values()
    home = re.compile(rb"(?m)^C00000=(-?\d+),(-?\d+),(-?\d+),(-?\d+),(-?\d+),(-?\d+)\r$")
    tools = []
    for text in (program.path.read_bytes(), data):
        m = home.search(text)
        assert m is not None
        q = np.deg2rad([int(m[k]) / c for k, c in enumerate(corpus.PER_DEGREE, 1)])
        tools.append((robot.forward(q[None])[0] @ matrix(corpus.TOOLS[2][1]))[:3, 3])
    told, commanded = tools
    assert np.linalg.norm(commanded - told) > 0.05
    assert np.linalg.norm(commanded + arm.error(commanded) - told) < 0.03  # a pulse is up to 0.03 mm


def test_corrected_pulses_bring_the_tool_where_it_was_told(folder: Path) -> None:
    robot = load_robot("yaskawa-gp25")
    check_home(read(folder, joint_targets=True)["PICK-01"], robot, Sagging(robot))
