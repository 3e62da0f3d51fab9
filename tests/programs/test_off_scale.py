"""Positions off the scale of the others: refused by name, line and likely unit; points near the origin are not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.programs.backups import small
from tests.programs.backups.test_makers import CORPORA
from tests.programs.corpus import CORPUS
from tests.programs.test_corpus import lay
from tests.programs.test_virtual_cell import APT, LANGUAGES, N, with_x_near

from truepose.errors import RefusedError
from truepose.geometry import euler, invert_transform, make_transform
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program, read_programs

MIDDLE = np.array([1400.0, 100.0, 1100.0])
PLACES = {
    "base": np.eye(4),
    "beside": make_transform(euler("kuka", [30.0, -10.0, 5.0]), MIDDLE - np.array([400.0, 0.0, 500.0])),
    "middle": make_transform(euler("kuka", [30.0, -10.0, 5.0]), MIDDLE + np.array([20.0, -30.0, 10.0])),
}
"""Frames: that of the robot, one beside the targets, and one in their middle."""


def program(
    folder: Path, name: str, place: str, factor: float, rows: Any, *, correct: Any = None, seed: int = 3
) -> Any:
    """Read (or correct) a program of 24 targets, of which some rows are divided by a factor."""
    language = LANGUAGES.get(name, APT)
    rng = np.random.default_rng(seed)
    poses = make_transform(Rotation.random(N, random_state=4), MIDDLE + rng.uniform(-350, 350, (N, 3)))
    base = np.eye(4) if name == "urscript" else PLACES[place]
    inside = invert_transform(base) @ poses
    if name == "apt":
        inside = with_x_near(inside)
        angles = inside[:, :3, 2]
    else:
        angles = euler(language.controller, Rotation.from_matrix(inside[:, :3, :3]))
    p = inside[:, :3, 3] / language.unit
    p[rows] /= factor
    path = folder / f"a{language.ending}"
    path.write_text(language.write(list(np.column_stack([p, angles])), [1] * N))
    tools, bases = {1: np.eye(4), "tA": np.eye(4)}, {1: base, "w1": base, "G54": base}
    table = FrameTable(tools, bases, tool="map", base=1 if name == "apt" else None)
    if correct is not None:
        return correct_program(path, correct, frames=table, options=language.options)
    return read_program(path, table, language.options)


def flagged(read: Program) -> list[int]:
    """Return the places of targets that are off the scale."""
    return [i for i, target in enumerate(read.targets) if "correct its unit" in target.reason]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", [*LANGUAGES, "apt"])
def test_positions_in_another_unit_are_refused(tmp_path: Path, make_map: Any, name: str, place: str) -> None:
    factor, unit = (1e-3, "mm") if name == "urscript" else (1e3, "m")
    rows = range(2, N, 6)
    read = program(tmp_path, name, place, factor, rows)
    assert flagged(read) == list(rows)
    for i in rows:
        assert read.targets[i].verdict == "refuse"
        assert f"; in {unit} it would lie among them, at (" in read.targets[i].reason
    first = read.targets[2]
    message = rf"{first.path.name}:{first.line}: {re.escape(first.name)}: .* in {unit} it would lie .* \(3 more alike\)"
    with pytest.raises(RefusedError, match=message):
        program(tmp_path, name, place, factor, rows, correct=make_map([0.5, 0.0, 0.0]))
    assert flagged(program(tmp_path, name, place, 1.0, rows)) == []


@pytest.mark.parametrize("rows", [[5], [0], [23], [3, 4, 5, 6, 7]])
@pytest.mark.parametrize(
    ("name", "place", "factor", "unit"),
    [
        ("krl", "base", 1e3, "m"), ("krl", "base", 25.4, "inch"),
        ("krl", "beside", 1e3, "m"), ("urscript", "base", 1e-3, "mm"), ("urscript", "base", 0.0254, "inch"),
    ],
)  # fmt: skip
def test_the_likely_unit_is_named(
    tmp_path: Path, name: str, place: str, factor: float, unit: str, rows: list[int]
) -> None:
    read = program(tmp_path, name, place, factor, rows)
    assert flagged(read) == rows
    assert all(f"; in {unit} it would" in read.targets[i].reason for i in rows)


@pytest.mark.parametrize("seed", range(8))
def test_many_programs_in_one_unit_have_nothing_off_the_scale(tmp_path: Path, seed: int) -> None:
    for name in ("krl", "urscript"):
        for place in PLACES:
            assert flagged(program(tmp_path, name, place, 1.0, [], seed=seed)) == []


def test_a_position_beyond_every_robot_is_refused_without_a_unit(tmp_path: Path) -> None:
    read = program(tmp_path, "krl", "beside", 1 / 17.0, [4])
    assert read.targets[4].verdict == "refuse"
    assert "m from the base of the robot, far off the other positions; correct its numbers" in read.targets[4].reason


def cloud(folder: Path, p: Any, base: Any = PLACES["beside"]) -> Program:
    """Read a KRL program of positions in a frame."""
    lines = "".join(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A 0,B 90,C 0}}\n" for x, y, z in np.asarray(p, float))
    (folder / "a.src").write_text(f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n{lines}END\n")
    return read_program(folder / "a.src", FrameTable({1: np.eye(4)}, {1: base}))


GRID = np.stack(np.meshgrid(range(0, 500, 100), range(0, 400, 100), (20, 40)), -1).reshape(-1, 3)
CIRCLE = np.array([[200 * np.cos(a), 200 * np.sin(a), 3.0] for a in np.linspace(0, 6, 40)])
FAR = np.random.default_rng(1).uniform((300, -400, 100), (900, 400, 700), (20, 3))


@pytest.mark.parametrize(
    "p",
    [
        [*GRID, [0, 0, 0], [0, 0, 0.4], [0, 0, 100]],
        [*GRID, [0.3, 0.2, 0.1], [0, 0, 100]],
        [*GRID, [1200, 300, 1500], [-800, 900, 1400]],
        [*CIRCLE, [0, 0, 0], [0, 0, 50]],
        [*FAR, [0, 0, 0], [0, 0, 0], [0, 0, 10]],
        [*FAR, [30, 20, 0], [30, 20, 100]],
        [*(CIRCLE * s for s in (1e-3, 1e-2, 0.1, 1.0))],
        [*FAR[:3], [0.4, 0.3, 0.2]],
        np.outer(np.linspace(-1, 1, 501), [300.0, 40.0, 10.0]),
        np.geomspace(0.05, 900, 30)[:, None] * [1.0, 0.4, 0.3],
    ],
)  # fmt: skip
def test_points_near_the_origin_of_a_frame_and_safe_points_are_no_slips(tmp_path: Path, p: Any) -> None:
    assert flagged(cloud(tmp_path, np.concatenate([np.atleast_2d(row) for row in p]))) == []


def test_a_circle_through_such_a_point_is_left_out_whole(tmp_path: Path) -> None:
    lines = [f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A 0,B 90,C 0}}\n" for x, y, z in FAR]
    arc = "CIRC {X 500,Y 20,Z 300,A 0,B 90,C 0},{X 0.55,Y 0.04,Z 0.31,A 0,B 90,C 0}\n"
    (tmp_path / "a.src").write_text(
        f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n{''.join(lines)}{arc}{''.join(lines)}END\n"
    )
    read = read_program(tmp_path / "a.src", FrameTable({1: np.eye(4)}, {1: PLACES["beside"]}))
    auxiliary, end = read.targets[20], read.targets[21]
    assert (auxiliary.verdict, end.verdict) == ("refuse", "refuse")
    assert auxiliary.reason.startswith("its circle's other point ")
    assert auxiliary.reason.endswith(end.reason)
    assert read.counts()["correct"] == 40


@pytest.mark.parametrize("allowed", [False, True])
def test_nothing_in_the_corpora_is_off_the_scale(tmp_path: Path, allowed: bool) -> None:
    for name, example in CORPUS.items():
        (tmp_path / name).mkdir()
        options = ReadOptions(**{**vars(example.options), "derived": allowed})
        assert flagged(read_program(lay(tmp_path / name, example), example.frames, options)) == [], name


@pytest.mark.sampled(1)
@pytest.mark.parametrize("maker", CORPORA)
def test_nothing_in_the_backups_is_off_the_scale(tmp_path: Path, maker: str) -> None:
    path = tmp_path / "cell.zip"
    path.write_bytes(small.packed(CORPORA[maker](tmp_path / "made")))
    for options in (ReadOptions(), ReadOptions(derived=True, whole_task=True, external_axes=True)):
        found = read_programs([path], FrameTable(tool="map"), options)
        assert sum(len(program.targets) for program in found.programs) > 400
        assert [flagged(program) for program in found.programs if flagged(program)] == []
