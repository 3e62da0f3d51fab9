"""A straight path that neighbouring corrections bend is told; files that are no files are not opened."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import correct_program, read_program
from truepose.programs.correct import CorrectedProgram

N = 6


def corrected(folder: Path, make_map: Any, shifts: np.ndarray, word: str = "LIN", y: float = 0.0) -> CorrectedProgram:
    path = folder / "a.src"
    lines = [f"{word} {{X {100 * i},Y {y * (i == 2)},Z 500,A 0,B 0,C 0}}" for i in range(N)]
    path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n" + "\n".join(lines) + "\nEND\n")
    return correct_program(path, make_map(shifts))


def test_a_bent_path_is_told(tmp_path: Path, make_map: Any) -> None:
    even = np.linspace(0, 2, N)[:, None] * [1.0, -1.0, 0.5]
    assert corrected(tmp_path, make_map, even).warnings == ()
    jump = np.zeros((N, 3))
    jump[2, 2] = 0.5
    found = corrected(tmp_path, make_map, jump)
    assert [w.split(": ", 1)[1] for w in found.warnings] == [
        "LIN:6 bends a straight path by 0.500 mm against its neighbours LIN:5 and LIN:7"
    ]
    assert found.sidecar()["warnings"] == list(found.warnings)
    assert corrected(tmp_path, make_map, jump, "PTP").warnings == ()
    assert corrected(tmp_path, make_map, jump, y=5.0).warnings == ()  # no straight path here
    assert corrected(tmp_path, make_map, 0.5 * jump).warnings == ()


def test_going_there_and_back_is_no_straight_path(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.src"
    poses = "\n".join(f"LIN {{X {x},Y 0,Z 500,A 0,B 0,C 0}}" for x in (0, 100, 0, 0, 100))
    path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{poses}\nEND\n")
    jump = np.zeros((5, 3))
    jump[1] = 1.0
    with np.errstate(all="raise"):
        assert correct_program(path, make_map(jump)).warnings == ()


def test_pipes_folders_and_links(tmp_path: Path, make_map: Any) -> None:
    os.mkfifo(tmp_path / "a.nc")
    with pytest.raises(FileError, match="is no file but a device or a pipe"):
        read_program(tmp_path / "a.nc")
    (tmp_path / "b.ls").mkdir()
    with pytest.raises(FileError, match="holds no robot program"):
        read_program(tmp_path / "b.ls")
    result = corrected(tmp_path, make_map, np.array([0.5, 0.0, 0.0]))
    (tmp_path / "link.src").symlink_to(tmp_path / "a.src")
    linked = correct_program(tmp_path / "link.src", make_map([0.5, 0, 0]))
    with pytest.raises(FileError, match="is a link; name the file itself"):
        linked.write_in_place()
    before = (tmp_path / "a.src").read_bytes()
    assert result.write_in_place()[0] == tmp_path / "a.src"
    assert (tmp_path / "a.src.original").read_bytes() == before
