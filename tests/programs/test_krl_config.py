"""$config.dat and the frames that a program may use."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from truepose.cell.sections import FramesSection
from truepose.errors import DataError, FileError
from truepose.programs import FrameTable

CONFIG = """&ACCESS RVP
&REL 81
DEFDAT  $CONFIG PUBLIC
DECL FRAME BASE_DATA[3]
BASE_DATA[1]={X 812.5,Y -40.25,Z 10,A 90.0,B 0.0,C 0.0} ; table
base_data[2] = {x 0.0, y 0.0, z 0.0, a 0.0, b 0.0, c 0.0}
BASE_DATA[3]={X 1.0}
;BASE_DATA[4]={X 1,Y 2,Z 3,A 0,B 0,C 0}
DECL CHAR BASE_NAME[32,24]
BASE_NAME[1,]="BASE_DATA[9]={X 1"
TOOL_DATA[1]={X 0.0,Y 0.0,Z 150.0,A 0.0,B 0.0,C 180.0}
LOAD_DATA[1]={M 26.2,CM {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0,E1 0.0}
TOOL_TYPE[1]=#BASE_TCP
ENDDAT
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "$config.dat"
    path.write_text(text)
    return path


def test_numbered_frames_are_read_and_the_rest_is_passed_over(tmp_path: Path) -> None:
    table = FrameTable.from_config_dat(write(tmp_path, CONFIG))
    assert (sorted(table.tools), sorted(table.bases)) == ([0, 1], [0, 1, 2])
    expected = np.array([[0, -1, 0, 812.5], [1, 0, 0, -40.25], [0, 0, 1, 10], [0, 0, 0, 1]])
    np.testing.assert_allclose(table.bases[1], expected, atol=1e-12)
    np.testing.assert_allclose(table.tools[1] @ [0, 0, 1, 1], [0, 0, 149, 1], atol=1e-12)
    np.testing.assert_array_equal(table.tools[0], np.eye(4))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("DEFDAT X\nENDDAT\n", r"config\.dat: has no TOOL_DATA\[n\]"),
        ("TOOL_DATA[1]={X 1.2.3}", r"config\.dat:1: X 1\.2\.3 is not a number"),
        ("\nTOOL_DATA[1]={X 1", r"config\.dat:2: the brace of"),
        ("TOOL_DATA[1]={X 1}\nTOOL_DATA[1]={X 2}", r"config\.dat:2: TOOL_DATA\[1\] was given in line 1 already"),
        ("TOOL_DATA[1]={X 1}}", r"config\.dat:1: TOOL_DATA\[1\] is followed by more"),
    ],
)
def test_broken_config(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        FrameTable.from_config_dat(write(tmp_path, text))


def test_the_cell_files_own_frames_win_over_config_dat(tmp_path: Path) -> None:
    own = np.eye(4)
    own[0, 3] = 7.0
    cell = SimpleNamespace(config_dat=write(tmp_path, CONFIG), tools={1: own, 5: own}, bases={}, frames=FramesSection())
    table = FrameTable.from_cell(cell)  # type: ignore[arg-type]
    assert (sorted(table.tools), sorted(table.bases)) == ([0, 1, 5], [0, 1, 2])
    np.testing.assert_array_equal(table.tools[1], own)
    assert FrameTable.from_cell(
        SimpleNamespace(config_dat=None, tools={}, bases={}, frames=FramesSection())
    ).tools.keys() == {0}  # type: ignore[arg-type]


def test_a_frame_that_is_not_rigid_is_an_error() -> None:
    with pytest.raises(DataError, match="tools 4"):
        FrameTable(tools={4: np.diag([2.0, 1.0, 1.0, 1.0])})
