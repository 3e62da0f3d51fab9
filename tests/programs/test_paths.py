"""Paths that a correction bends are refused; files that are no files are not opened."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from truepose.cell.sections import Correction, FramesSection
from truepose.errors import FileError, RefusedError
from truepose.programs import FrameTable, ReadOptions, correct_program, read_program

N = 6
FRAMES = FrameTable(
    tools={**{n: np.eye(4) for n in range(3)}, "tGrip": np.eye(4)},
    bases={**{n: np.eye(4) for n in range(3)}},
    tool="map",
    base=0,
)
RT = "[[{x},0,500],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def corrected(folder: Path, make_map: Any, shifts: Any, word: str = "LIN", y: float = 0.0, **more: Any) -> Any:
    """Correct six motions along x, 100 mm apart, the third of them off the line by y [mm]."""
    path = folder / "a.src"
    lines = [f"{word} {{X {100 * i},Y {y * (i == 2)},Z 500,A 0,B 0,C 0}}" for i in range(N)]
    path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n" + "\n".join(lines) + "\nEND\n")
    more.setdefault("on_guard", "skip")
    return correct_program(path, make_map(np.asarray(shifts, float), std=0.02), **more)


def states(limit: float) -> Any:
    """Return a cell that states a largest bend [mm]."""
    correction = Correction(max_bend_mm=limit)
    return SimpleNamespace(
        correction=correction, config_dat=None, tools={}, bases={}, frames=FramesSection(), robot_id=None
    )


@pytest.mark.promise("A correction that bends a path beyond the limit is refused, with its place and size.")
@pytest.mark.parametrize("y", [0.0, 5.0, 60.0])
def test_a_bent_path_is_refused(tmp_path: Path, make_map: Any, y: float) -> None:
    jump = np.zeros((N, 3))
    jump[2, 2] = 1.2
    message = (
        r"a\.src:6: the correction would bend the path by 1\.200 mm at LIN:6 \(line 6\), limit 0\.139 mm; leave such"
    )
    with pytest.raises(RefusedError, match=message):
        corrected(tmp_path, make_map, jump, y=y, on_guard="refuse")
    left = corrected(tmp_path, make_map, jump, y=y)
    assert left.coverage.corrected == 0
    reasons = {t.reason.split(" by ")[0] for t in left.targets}
    assert reasons == {"its whole path stays nominal: the correction would bend the path"}


def test_what_does_not_bend_a_path(tmp_path: Path, make_map: Any) -> None:
    even = np.linspace(0, 4, N)[:, None] * [1.0, -1.0, 0.5]
    assert corrected(tmp_path, make_map, even, on_guard="refuse").coverage.corrected == N
    jump = np.zeros((N, 3))
    jump[2, 2] = 0.45  # less than 5 mm per metre of spacing
    assert corrected(tmp_path, make_map, jump, on_guard="refuse").coverage.corrected == N
    assert corrected(tmp_path, make_map, 9 * jump, "PTP", on_guard="refuse").coverage.corrected == N


@pytest.mark.promise("A largest bend that [correction] states holds at any spacing.")
def test_a_limit_that_is_stated(tmp_path: Path, make_map: Any) -> None:
    jump = np.zeros((N, 3))
    jump[2, 2] = 0.45
    assert corrected(tmp_path, make_map, jump, cell=states(0.5)).coverage.corrected == N
    assert corrected(tmp_path, make_map, jump, cell=states(0.3)).coverage.corrected == 0
    assert corrected(tmp_path, make_map, 5 * jump, cell=states(3.0)).coverage.corrected == N
    record = corrected(tmp_path, make_map, jump, cell=states(0.5)).to_dict()
    assert record["continuity"]["max_bend_mm"] == 0.5


@pytest.mark.promise("A target that stays nominal between corrected ones is a kink, in every language.")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.src", "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{moves}END\n"),
        ("spline.src", "DEF spline()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nSPLINE\n{moves}ENDSPLINE\nEND\n"),
        ("a.mod", "MODULE m\nPERS robtarget p2:=" + RT.format(x=40) + ";\nPROC main()\n{moves}ENDPROC\nENDMODULE\n"),
        ("a.ls", "/PROG  A\n/MN\n{moves}/POS\n{points}/END\n"),
        ("a.script", "def a():\n{moves}end\n"),
        ("a.jbi", "/JOB\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n{points}//INST\nNOP\n{moves}END\n"),
        ("a.csv", "name,motion,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n{moves}"),
        ("a.nc", "G21 G90\n{moves}"),
        ("a.apt", "UNITS/MM\nLOADTL/1\n{moves}FINI\n"),
    ],
)
def test_corrected_skipped_corrected(tmp_path: Path, make_map: Any, name: str, text: str) -> None:
    """Five targets, 20 mm apart; the third is guarded, or skipped by the language where a point may be."""
    xs = range(0, 100, 20)
    lines = {
        "a.src": lambda i, x: f"LIN {{X {x},Y 0,Z 500,A 0,B 0,C 0}} C_DIS\n",
        "spline.src": lambda i, x: f"SPL {{X {x},Y 0,Z 500,A 0,B 0,C 0}}\n",
        "a.mod": lambda i, x: f"MoveL {'p2' if i == 2 else RT.format(x=x)},v10,z1,tGrip;\n",
        "a.ls": lambda i, _: f"  {i + 1}:L P[{i + 1}] 9mm/sec CNT100 ;\n",
        "a.script": lambda i, x: f"  movel(p[{x / 1000},0,0.5,0,0,0],r=0.001)\n",
        "a.jbi": lambda i, _: f"MOVL C{i:05} V=9.0\n",
        "a.csv": lambda i, x: f"p{i},LIN,{x},0,500,0,0,0\n",
        "a.nc": lambda i, x: f"G1 X{x} Y0 Z500 A0 B0 C0\n",
        "a.apt": lambda i, x: f"GOTO/{x},0,500,0,0,1\n",
    }
    points = {
        "a.ls": lambda i, x: (
            f"P[{i + 1}]{{\n GP1:\n UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n X = {x:.3f} mm, Y = 0.000 mm,"
            " Z = 500.000 mm,\n W = 0.000 deg, P = 0.000 deg, R = 0.000 deg\n};\n"
        ),
        "a.jbi": lambda i, x: f"C{i:05}={x:.3f},0.000,500.000,0.0000,0.0000,0.0000\n",
    }
    write, place = lines[name], points.get(name, lambda i, x: "")
    moves = "".join(write(i, x) for i, x in enumerate(xs))
    path = tmp_path / name
    path.write_text(text.format(moves=moves, points="".join(place(i, x) for i, x in enumerate(xs))))
    guarded = {} if name == "a.mod" else {2: "far away"}
    options = ReadOptions(angles="z" if name == "a.apt" else "kuka")
    more = {"frames": FRAMES, "options": options, "on_guard": "skip"}
    done = correct_program(path, make_map([0.0, 3.7, 0.0], guarded, std=0.02), **more)
    assert done.coverage == (0, 5)
    assert sum("would bend the path by 3.700 mm at" in t.reason for t in done.targets) == 4
    kept = correct_program(path, make_map([0.0, 3.7, 0.0], guarded, std=0.02), cell=states(4.0), **more)
    assert kept.coverage == (4, 5)
    assert kept.continuity.summary()["largest_bend_mm"] == pytest.approx(3.7, abs=1e-9)


@pytest.mark.promise("Circles are judged with the straight motions around them.")
def test_circles(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.src"
    pose = "{{X {},Y {},Z 500,A 0,B 0,C 0}}".format
    moves = f"LIN {pose(0, 0)}\nLIN {pose(30, 0)}\nCIRC {pose(50, 10)},{pose(60, 30)}\nLIN {pose(60, 60)}\n"
    path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{moves}END\n")
    shifted = correct_program(path, make_map([1.0, 2.0, 0.0], std=0.02))
    assert (shifted.coverage.corrected, shifted.continuity.summary()["largest_bend_mm"]) == (5, pytest.approx(0.0))
    with pytest.raises(RefusedError, match=r"bend the path by .* at CIRC:6 auxiliary \(line 6\)"):
        correct_program(path, make_map((np.arange(5) == 2)[:, None] * np.ones(3), std=0.02))


@pytest.mark.promise("Points are judged in the order of the motions to them, not in that of their declarations.")
def test_the_order_of_motions(tmp_path: Path, make_map: Any) -> None:
    order = [3, 0, 4, 1, 2]
    points = "".join(f"DECL E6POS P{k}={{X {20 * order.index(k)},Y 0,Z 500,A 0,B 0,C 0}}\n" for k in range(5))
    (tmp_path / "a.dat").write_text(f"DEFDAT A\n{points}ENDDAT\n")
    body = "".join(f"LIN P{k}\n" for k in order)
    (tmp_path / "a.src").write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{body}END\n")
    even = np.array([[0.0, 0.5 * order.index(k), 0.0] for k in range(5)])
    assert correct_program(tmp_path / "a.src", make_map(even, std=0.02)).coverage.corrected == 5
    uneven = np.array([[0.0, 0.5 * k, 0.0] for k in range(5)])
    with pytest.raises(RefusedError, match="bend the path"):
        correct_program(tmp_path / "a.src", make_map(uneven, std=0.02))


@pytest.mark.promise("A path ends at joint motions, at unknown targets and with its routine; others stay corrected.")
@pytest.mark.parametrize(
    "between",
    ["PTP {X 100,Y 0,Z 500,A 0,B 0,C 0}", "PTP {A1 0,A2 -90}", "LIN_REL {X 5}", "LIN XUNKNOWN", "END\nDEF b()"],
)
def test_the_ends_of_a_path(tmp_path: Path, make_map: Any, between: str) -> None:
    line = "LIN {{X {},Y 0,Z 500,A 0,B 0,C 0}}\n".format
    body = "".join(map(line, (0, 20, 40))) + between + "\n" + "".join(map(line, (120, 140, 160)))
    (tmp_path / "a.dat").write_text("DEFDAT A\nEXT XUNKNOWN\nENDDAT\n")
    text = f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{body}END\n"
    (tmp_path / "a.src").write_text(text.replace("DEF b()", "DEF b()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME"))
    done = correct_program(tmp_path / "a.src", make_map([0, 2.0, 0], {1: "far away"}, std=0.02), on_guard="skip")
    corrected_lines = {t.line for t in done.targets if t.verdict == "correct"}
    assert corrected_lines.isdisjoint({4, 5, 6})
    assert len(corrected_lines) >= 3


@pytest.mark.promise("A point of a path that stays nominal is judged again in the other paths through it.")
def test_points_of_two_paths(tmp_path: Path, make_map: Any) -> None:
    names = [f"P{k}" for k in range(7)]
    points = "".join(f"DECL E6POS {n}={{X {20 * k},Y 0,Z 500,A 0,B 0,C 0}}\n" for k, n in enumerate(names))
    (tmp_path / "a.dat").write_text(f"DEFDAT A\n{points}ENDDAT\n")
    rows = ("P0", "P1", "P2"), ("P2", "P3", "P4"), ("P4", "P5", "P6")
    body = "".join("PTP " + "\nLIN ".join(row) + "\n" for row in rows)
    (tmp_path / "a.src").write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{body}END\n")
    done = correct_program(tmp_path / "a.src", make_map([0, 2.0, 0], {1: "far away"}, std=0.02), on_guard="skip")
    assert done.coverage.corrected == 0
    assert [t.name for t in done.targets if "bend the path by 2.000 mm at P1" in t.reason] == ["P0", "P2"]


@pytest.mark.promise("The largest change of direction and of spacing is in the record, JSON and CSV.")
def test_the_record(tmp_path: Path, make_map: Any) -> None:
    jump = np.zeros((N, 3))
    jump[2, 1], jump[5, 0] = 0.4, 0.25
    done = corrected(tmp_path, make_map, jump)
    found = done.to_dict()
    turn = float(np.rad2deg(2 * np.arctan(0.4 / 100)))
    assert found["continuity"]["largest_bend_mm"] == pytest.approx(0.4, abs=1e-6)
    assert found["continuity"]["largest_change_of_direction_deg"] == pytest.approx(turn, rel=1e-4)
    assert found["continuity"]["largest_change_of_spacing_mm"] == pytest.approx(0.25, abs=1e-6)
    assert found["limits"]["max_bend_mm"] == {
        "value": pytest.approx(4 * 0.02 * np.sqrt(3)),
        "origin": "default: 4 times the RMS standard deviation of the corrected targets, at least 0.1 mm",
    }
    target = found["targets"][2]
    assert (target["bend_mm"], target["turn_deg"]) == (pytest.approx(0.4), pytest.approx(turn, rel=1e-4))
    assert found["targets"][0]["bend_mm"] is None  # a path's first target has one neighbour
    head, *rows = [line.split(",") for line in done.to_csv().splitlines()]
    row = dict(zip(head, rows[2], strict=True))
    assert (float(row["bend_mm"]), float(row["spacing_mm"])) == (pytest.approx(0.4), pytest.approx(0.0008, abs=1e-5))


@pytest.mark.promise("A dense seam with an even field of corrections keeps all of them.")
def test_a_seam_in_an_even_field(tmp_path: Path, make_map: Any) -> None:
    x = 15.0 * np.arange(20)
    lines = "".join(f"LIN {{X {v:.1f},Y {0.002 * v * v:.3f},Z 500,A 0,B 0,C 0}} C_DIS\n" for v in x)
    path = tmp_path / "a.src"
    path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{lines}END\n")
    field = np.column_stack([np.sin(x / 150), 1.5 * np.cos(x / 200), 0.01 * x])
    noise = np.random.default_rng(4).normal(0.0, 0.02, field.shape)
    assert correct_program(path, make_map(field + noise, std=0.02)).coverage.corrected == 20


def test_going_there_and_back_is_no_bend(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.src"
    poses = "\n".join(f"LIN {{X {x},Y 0,Z 500,A 0,B 0,C 0}}" for x in (0, 100, 0, 0, 100))
    path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{poses}\nEND\n")
    jump = np.zeros((5, 3))
    jump[1] = 1.0
    with np.errstate(all="raise"):
        assert correct_program(path, make_map(jump, std=0.02)).coverage.corrected == 5
    jump[3] = 1.0  # the same place, another correction
    with pytest.raises(RefusedError, match=r"bend the path by 1\.732 mm"):
        correct_program(path, make_map(jump, std=0.02))


def test_pipes_folders_and_links(tmp_path: Path, make_map: Any) -> None:
    os.mkfifo(tmp_path / "a.nc")
    with pytest.raises(FileError, match="is a device or a pipe, not a file"):
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
