"""The tools and bases of programs: what is listed, in which order, and the lines for a cell file."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.programs.backups import small

from truepose import Cell
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, read_programs
from truepose.programs.used_frames import UsedFrame, by_controller, frames_of, missing_lines


def program(folder: Path, tool: str = "TOOL_DATA[3]", base: str = "BASE_DATA[2]") -> Path:
    path = folder / "a.src"
    move = "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\n"
    path.write_text(f"DEF a()\n$TOOL={tool}\n$BASE={base}\n{move}{move}END\n")
    return path


def listed(path: Path, given: FrameTable | None = None) -> list[UsedFrame]:
    return frames_of(read_programs([path], given).programs, given)


def test_unknown_frames_come_first_and_both_at_once(tmp_path: Path) -> None:
    path = program(tmp_path)
    rows = listed(path)
    assert [(one.which, one.key, one.state, one.targets) for one in rows] == [
        ("base", 2, "unknown", 2),
        ("tool", 3, "unknown", 2),
    ]
    (reason,) = {target.reason for target in read_programs([path]).programs[0].targets}
    assert "[frames.tools.3]" in reason
    assert "[frames.bases.2]" in reason
    given = FrameTable(tools={3: np.eye(4), 4: np.eye(4)})
    rows = listed(path, given)
    assert [(one.which, one.key, one.state, one.targets) for one in rows] == [
        ("base", 2, "unknown", 2),
        ("tool", 3, "known", 2),
        ("tool", 4, "known", 0),
    ]


def test_the_lines_are_no_cell_file_until_the_values_are_filled_in(tmp_path: Path) -> None:
    path = program(tmp_path)
    text = "\n".join(missing_lines(listed(path)))
    with pytest.raises(tomllib.TOMLDecodeError):
        tomllib.loads(text)
    cell = Cell.from_toml('[robot]\nmodel = "kuka-kr16-2"\n' + text.replace("?", "7.5"), folder=tmp_path)
    given = FrameTable.from_cell(cell)
    assert read_programs([path], given).programs[0].counts()["correct"] == 2
    assert not missing_lines(listed(path, given))
    assert "# BASE_DATA[2]: 2 targets in a.src" in text


@pytest.mark.parametrize(
    ("controller", "numbers"),
    [
        ("kuka", [10.0, 20.0, -30.0]),
        ("fanuc", [170.0, -20.0, 35.0]),
        ("ur", [0.5, -1.0, 2.0]),
        ("yaskawa", [10.0, 20.0, -30.0]),
        ("staubli", [10.0, 20.0, -30.0]),
        ("abb", [0.5, 0.5, -0.5, 0.5]),
    ],
)
def test_known_values_are_written_in_the_angles_of_the_maker(controller: str, numbers: list[float]) -> None:
    tf = make_transform(euler(controller, numbers), [1.0, -2.5, 300.0])
    one = UsedFrame("base", "my base", tf=tf, controller=controller)
    np.testing.assert_allclose(one.numbers, [1.0, -2.5, 300.0, *numbers], atol=1e-6)
    values = tomllib.loads("\n".join(one.lines()))["frames"]["bases"]["my base"]
    np.testing.assert_allclose(list(values.values()), one.numbers)


@pytest.mark.usefixtures("small_format")
def test_zeros_that_are_used_are_marked_and_their_lines_can_be_pasted(tmp_path: Path) -> None:
    frames = "tool 1 0 0 150 probe\nbase 1 0 0 0 -\nbase 2 0 0 0 -\nbase 3 1 0 0 table it moves\n"
    small.lay(tmp_path, small.files_of(frames=frames))
    found = read_programs([tmp_path])
    ((_, controller, rows),) = by_controller(found.programs, found.backups, FrameTable())
    assert controller is not None
    assert [(one.which, one.key, one.state, one.targets, one.name) for one in rows] == [
        ("base", 1, "zero", 2, ""),
        ("tool", 1, "known", 2, "probe"),
        ("base", 2, "zero", 0, ""),
        ("base", 3, "unusable", 0, "table"),
    ]
    assert rows[0].place == "Frames.TXT, line 2"
    lines = missing_lines(rows)
    assert lines == ["[frames.bases.1]  # BASE_DATA[1]: 2 targets in p0.src, p1.src", "x_mm = 0.0"]
    (reason,) = {target.reason for target in found.programs[0].targets}
    assert "(two lines: [frames.bases.1] and x_mm = 0.0)" in reason
    cell = Cell.from_toml('[robot]\nmodel = "kuka-kr16-2"\n' + "\n".join(lines), folder=tmp_path)
    assert not missing_lines(frames_of(read_programs([tmp_path], FrameTable.from_cell(cell)).programs))
    given = FrameTable(bases={1: np.eye(4)})
    again = read_programs([tmp_path], given)
    assert again.programs[0].counts()["correct"] == 2
    assert not missing_lines(by_controller(again.programs, again.backups, given)[0][2])


@pytest.mark.promise("The reason of a target is not stated as that of its tool or base.")
def test_the_reason_of_a_target_is_not_that_of_its_frame(tmp_path: Path) -> None:
    point = "LIN_REL {X 1}\nPTP {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}\n"
    path = tmp_path / "a.src"
    path.write_text(f"DEF a()\n$TOOL=TOOL_DATA[3]\n$BASE=BASE_DATA[2]\n{point}END\n")
    rows = listed(path)
    reasons = {target.reason for target in read_programs([path]).programs[0].targets}
    assert rows
    assert reasons
    assert not reasons & {one.reason for one in rows}
    code = f"$BASE=$NULLFRAME\nTOOL_DATA[3].X=5\n$TOOL=TOOL_DATA[3]\n{point}LIN {{X 1,Y 2,Z 3,A 0,B 0,C 0}}\n"
    path.write_text(f"DEF a()\n{code}END\n")
    given = FrameTable(tools={3: np.eye(4)})
    told = [one.reason for one in listed(path, given) if one.which == "tool"]
    assert all("TOOL_DATA[3] is changed by the program" in reason or not reason for reason in told)
