"""Which controllers a backup holds, which one a map corrects, and the frames that they store."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.programs.backups import small, small_other
from tests.programs.conftest import FakeMap

from truepose.errors import DataError, RefusedError
from truepose.geometry import make_transform
from truepose.programs import FrameTable, ReadOptions, read_programs
from truepose.programs.agreement import controllers_for
from truepose.programs.batch import correct_programs
from truepose.robots import Robot, load_robot

pytestmark = pytest.mark.usefixtures("small_format")


@pytest.fixture
def robot() -> Robot:
    return load_robot("kuka-kr6-r900-sixx")


def below(name: str, files: dict[str, bytes]) -> dict[str, bytes]:
    return {f"{name}/{key}": data for key, data in files.items()}


def backup_of(path: Path, *controllers: dict[str, bytes]) -> Any:
    small.lay(path, {name: data for files in controllers for name, data in files.items()})
    found = read_programs([path])
    return found.backups[0], found


def test_every_controller_is_listed_and_read_with_its_own_frames(tmp_path: Path) -> None:
    other = "tool 1 0 0 150 probe\nbase 1 -50 0 0 table\n"
    backup, found = backup_of(tmp_path, below("R1", small.files_of()), below("R2", small.files_of(frames=other)))
    assert [one.name for one in backup.controllers] == ["R1", "R2"]
    assert [one.positions_base()[0, 0] for one in found.programs] == [910.0, -40.0]
    assert [one.controller for one in found.programs] == [tmp_path / "R1", tmp_path / "R2"]
    assert backup.controllers[0].left == {"log": 1}


def test_a_controller_inside_of_another_does_not_lend_it_programs(tmp_path: Path) -> None:
    backup, found = backup_of(tmp_path, small.files_of(), below("copy of 2024", small.files_of(first=70.0)))
    assert [one.name for one in backup.controllers] == [".", "copy of 2024"]
    assert [len(one.targets) for one in found.programs] == [2, 2]


def test_one_broken_controller_does_not_stop_the_other(tmp_path: Path) -> None:
    broken = small.files_of() | {"programs/p0.src": b"DEF a()\nLIN {X 1.2.3"}
    _, found = backup_of(tmp_path, below("R1", broken), below("R2", small.files_of()))
    assert "R1/programs/p0.src" in str(found.unreadable[0])
    assert [one.controller for one in found.programs if one.counts()["correct"] == 2] == [tmp_path / "R2"]


OUTSIDE = {
    "old/a.src": b"DEF a()\nBAS(#TOOL,0)\nBAS(#BASE,0)\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n",
    "cam/b.ls": b"/PROG B\n/MN\n/POS\n/END\n",
    "cam/c.nc": b"G1 X1 Y2\n",
}


@pytest.mark.promise("Programs of a folder that belong to no controller in it are read as other programs, or named.")
def test_programs_outside_of_controllers_are_read(tmp_path: Path) -> None:
    backup, found = backup_of(tmp_path, below("R1", small.files_of()), below("R2", small.files_of()), OUTSIDE)
    assert backup.outside == tuple(tmp_path / name for name in ("cam/b.ls", "cam/c.nc", "old/a.src"))
    assert {one.language: one.controller for one in found.programs if one.controller is None} == {
        "krl": None, "tp": None, "gcode": None,
    }  # fmt: skip
    assert [one.counts()["correct"] for one in found.programs if one.language == "krl"] == [2, 2, 1]
    found = read_programs([tmp_path], controllers=["R1"])
    assert len(found.programs) == 1
    assert found.left_out == [f"{file}: belongs to no controller and is left out" for file in backup.outside]


def test_programs_outside_of_controllers_in_a_zip_are_named(tmp_path: Path) -> None:
    path = tmp_path / "backup.zip"
    path.write_bytes(small.packed(below("R1", small.files_of()) | OUTSIDE))
    (backup,) = read_programs([path]).backups
    assert backup.warnings == (f"{path}: belongs to no controller and is not read: cam/b.ls, cam/c.nc, old/a.src",)


def test_a_name_chooses_a_controller_without_regard_to_case(tmp_path: Path) -> None:
    backup_of(tmp_path, below("KRC/R1", small.files_of()), below("KRC/R2", small.files_of()))
    found = read_programs([tmp_path], controllers=["krc\\r2\\"])
    assert [one.controller for one in found.programs] == [tmp_path / "KRC/R2"]
    with pytest.raises(DataError, match="has no controller R3; name one of: KRC/R1, KRC/R2"):
        read_programs([tmp_path], controllers=["R3"])


def test_a_correction_asks_which_of_two_controllers(tmp_path: Path, robot: Robot) -> None:
    backup, _ = backup_of(tmp_path, below("R1", small.files_of("KR 6 R900")), below("R2", small.files_of("KR 6 R900")))
    with pytest.raises(RefusedError, match=r"holds 2 controllers, name one \(--controller NAME\): R1 .*; R2 "):
        controllers_for(backup, robot)
    with pytest.warns(UserWarning, match=r"left as they are: R1 \(KUKA\)"):
        assert [one.name for one in controllers_for(backup, robot, ["R2"])] == ["R2"]


def test_only_the_controller_of_the_maps_maker_is_corrected(tmp_path: Path, robot: Robot) -> None:
    backup, _ = backup_of(tmp_path, below("R1", small.files_of("KR 6 R900")), below("F", small_other.FILES))
    assert backup.makers == ("FANUC", "KUKA")
    with pytest.warns(UserWarning, match=r"left as they are: F \(FANUC\)"):
        assert [one.name for one in controllers_for(backup, robot)] == ["R1"]
    with pytest.raises(RefusedError, match=r"is a backup of FANUC and KUKA, but the map is of .* ABB"):
        controllers_for(backup, replace(robot, maker="ABB"))


def test_a_map_of_the_other_robot_of_a_backup_is_refused(tmp_path: Path, robot: Robot) -> None:
    large, small_one = small.files_of("#KR210R2700 EXTRA"), small.files_of("#KR6R900 C4")
    backup, _ = backup_of(tmp_path, below("R1", large), below("R2", small_one))
    refused = pytest.raises(RefusedError, match=r"KR210R2700 EXTRA, the map is of .*, which is that of R2")
    with refused, pytest.warns(UserWarning, match="left"):
        controllers_for(backup, robot, ["R1"])


@pytest.mark.promise("A backup that names another model than the map's is refused, unless a reason is given.")
@pytest.mark.parametrize("named", ["#KR210R2700", "#KR125_2 ZH", "KR 6 R700 sixx"])
def test_a_backup_of_another_model_is_refused(tmp_path: Path, robot: Robot, named: str) -> None:
    backup, _ = backup_of(tmp_path, small.files_of(named))
    message = rf"the backup names the robot {named}, the map is of .*--other-robot REASON"
    with pytest.raises(RefusedError, match=message):
        controllers_for(backup, robot)
    with pytest.warns(UserWarning, match="accepted, with the reason: the name plate is wrong"):
        assert len(controllers_for(backup, robot, (), "the name plate is wrong")) == 1


def test_a_name_of_another_kind_is_warned_of(tmp_path: Path, robot: Robot) -> None:
    backup, _ = backup_of(tmp_path, small.files_of("1-06VX12-A00"))
    with pytest.warns(UserWarning, match="the backup names the robot 1-06VX12-A00.*make sure that they are the same"):
        assert len(controllers_for(backup, robot)) == 1


def test_two_controllers_of_one_name_in_different_case_are_refused(tmp_path: Path) -> None:
    files = small.files_of() | {"PROGRAMS/P0.SRC": b"DEF p0()\nEND\n"}
    small.lay(tmp_path, files)
    if len(list(tmp_path.iterdir())) < 5:
        pytest.skip("this file system does not distinguish case")
    found = read_programs([tmp_path])
    assert "PROGRAMS/P0.SRC and programs/p0.src differ only in case" in str(found.unreadable[0])


def stored(frames: str, tmp_path: Path, given: FrameTable | None = None) -> dict[str, str]:
    """Return the reasons of the targets of a backup with some stored frames."""
    program = small.PROGRAM.format(name="p0", base=2, x=1)
    small.lay(tmp_path, small.files_of(frames=frames, n=0) | {"p0.src": program.encode()})
    found = read_programs([tmp_path], given)
    assert not found.unreadable, found.unreadable
    return {target.name: target.reason for target in found.programs[0].targets}


def test_zeros_without_a_name_are_asked_for(tmp_path: Path) -> None:
    (reason,) = stored("tool 1 0 0 150 probe\nbase 2 0 0 0 -\n", tmp_path).values()
    assert reason == (
        "base BASE_DATA[2] is stored as zeros and without a name (Frames.TXT, line 2), as controllers store what is "
        "not set; if it is meant, give it in [frames.bases.2] of the cell file (two lines: [frames.bases.2] and "
        "x_mm = 0.0)"
    )
    assert stored("tool 1 0 0 150 probe\nbase 2 0 0 0 -\n", tmp_path, FrameTable(bases={2: np.eye(4)})) == {"LIN:4": ""}
    assert stored("tool 1 0 0 150 probe\nbase 2 0 0 0 world\n", tmp_path) == {"LIN:4": ""}


def test_a_frame_with_a_problem_of_its_own_is_refused_whatever_the_user_states(tmp_path: Path) -> None:
    frames = "tool 1 0 0 150 probe\nbase 2 5 0 0 turntable it moves with E1\n"
    for given in (None, FrameTable(bases={2: np.eye(4)})):
        (reason,) = stored(frames, tmp_path, given).values()
        assert reason == "base BASE_DATA[2] cannot be used (Frames.TXT, line 2): it moves with E1"


@pytest.mark.parametrize(("x", "fits"), [(5.0, True), (5.0009, True), (5.0011, False), (-5.0, False)])
def test_a_frame_that_contradicts_the_cell_file_is_refused_with_both(tmp_path: Path, x: float, fits: bool) -> None:
    given = FrameTable(bases={2: make_transform(None, [x, 0.0, 0.0])})
    (reason,) = stored("tool 1 0 0 150 probe\nbase 2 5 0 0 table\n", tmp_path, given).values()
    assert (reason == "") is fits
    if not fits:
        assert "contradicts the backup: [frames.bases.2] of the cell file is at" in reason
        assert "the controller's (Frames.TXT, line 2) at (5, 0, 0) mm" in reason


def test_a_backup_without_programs_is_refused_with_its_own_warnings(tmp_path: Path) -> None:
    small.lay(tmp_path, small.files_of(n=0) | {"a.tp": b"\0"})
    with pytest.raises(RefusedError, match=r"has no program that can be read; a\.tp: is compiled"):
        correct_programs([tmp_path], FakeMap())


def test_options_reach_the_programs_of_a_backup(tmp_path: Path) -> None:
    small.lay(tmp_path, small.files_of())
    (program,) = read_programs([tmp_path], None, ReadOptions(whole_task=True)).programs
    assert program.options is not None
    assert program.options.whole_task


def test_backups_are_told_as_json(tmp_path: Path) -> None:
    backup, _ = backup_of(tmp_path, small.files_of("KR 6 R900"))
    told = backup.to_dict()["controllers"][0]
    assert SimpleNamespace(**told).robot == "KR 6 R900"
    assert (told["name"], told["maker"], told["files"], told["left"]) == (".", "KUKA", 2, {"log": 1})
