"""Correction: geometry, policies, circles, records, and where results may be written."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose
from truepose.errors import DataError, FileError, RefusedError
from truepose.programs import FrameTable, ReadOptions, correct, correct_program

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0,S 2,T 10}"
SRC = """&ACCESS RVP\r
DEF cell( )\r
BAS(#TOOL,3)\r
BAS(#BASE,2)\r
PTP XHOME\r
LIN XP7 ; gr\xfcn\r
CIRC {X 1,Y 2,Z 300,A 0,B 0,C 0},\t{X 700.125,Y -1E1,Z .5,A 0,B 0,C 0}\r
END"""
DAT = f"DEFDAT CELL\nDECL E6POS XP7={POSE}\nENDDAT"


@pytest.fixture
def path(pair: Any) -> Path:
    return pair(SRC, DAT)


def position(text: str, name: str) -> np.ndarray:
    """X, Y, Z behind a name, read in the plainest way."""
    words = text.split(name, 1)[1].split("{", 1)[1].split("}")[0].split(",")[:3]
    return np.array([float(word.split()[1]) for word in words])


def test_a_shift_in_the_base_frame_is_turned_into_the_targets_frame(
    path: Path, frames: FrameTable, make_map: Any
) -> None:
    shift = np.array([0.4, -0.3, 0.2])
    corrected = correct_program(path, make_map(shift), frames=frames)
    after = position(corrected.files[path.with_suffix(".dat")].decode(), "XP7")
    # base 2 of the fixture written out: Rz(60) Ry(-15) Rx(5)
    turned = Rotation.from_euler("ZYX", [60.0, -15.0, 5.0], degrees=True).inv().apply(shift)
    np.testing.assert_allclose(after - [812.5, -40.25, 1033.0], turned, atol=0.51e-3)
    outcome = next(t for t in corrected.targets if t.name == "XP7")
    np.testing.assert_allclose(outcome.p_after, after)
    np.testing.assert_allclose(outcome.e, -shift)


def test_the_map_is_asked_with_poses_tools_and_configuration(path: Path, frames: FrameTable, make_map: Any) -> None:
    error_map = make_map()
    correct_program(path, error_map, frames=frames)
    in_src, in_dat = error_map.calls
    tf = np.eye(4)
    tf[:3, :3] = Rotation.from_euler("ZYX", [90.0, 10.0, -170.0], degrees=True).as_matrix()
    tf[:3, 3] = [812.5, -40.25, 1033.0]
    np.testing.assert_allclose(in_dat["poses"], [frames.bases[2] @ tf], atol=1e-9)
    np.testing.assert_allclose(in_src["tf_flange_tool"], np.broadcast_to(frames.tools[3], (2, 4, 4)))
    # XP7 is the target of a LIN, whose Turn the controller ignores
    assert (in_dat["status"].tolist(), in_dat["turn"].tolist(), in_dat["on_guard"]) == ([2], [-1], "refuse")
    assert in_src["status"].tolist() == [-1, -1]


def test_zero_correction_returns_the_files(path: Path, frames: FrameTable, make_map: Any) -> None:
    corrected = correct_program(path, make_map(), frames=frames)
    assert corrected.files == {p: p.read_bytes() for p in (path, path.with_suffix(".dat"))}
    assert corrected.diff() == ""


def test_only_digits_change_and_the_diff_shows_them(path: Path, frames: FrameTable, make_map: Any) -> None:
    identity = FrameTable(frames.tools, {2: np.eye(4)})
    corrected = correct_program(path, make_map([0.5, 0.25, -0.125]), frames=identity)
    assert corrected.files[path] == SRC.encode("latin-1").replace(
        b"{X 1,Y 2,Z 300,A 0,B 0,C 0},\t{X 700.125,Y -1E1,Z .5,",
        b"{X 1.5,Y 2.25,Z 299.875,A 0,B 0,C 0},\t{X 700.625,Y -9.75,Z .375,",
    )
    assert "-DECL E6POS XP7={X 812.5,Y -40.25,Z 1033.0,A 90.0" in corrected.diff()
    assert "+DECL E6POS XP7={X 813.0,Y -40.00,Z 1032.875,A 90.0" in corrected.diff()
    assert " LIN XP7 ; grün" in corrected.diff()


def test_guards_refuse_the_program_or_skip_the_target(path: Path, frames: FrameTable, make_map: Any) -> None:
    guarded = {2: "std of 0.9 mm is larger than the limit"}
    with pytest.raises(RefusedError, match=r'cell\.dat:2: XP7: std of 0\.9 mm .*on_guard "skip"'):
        correct_program(path, make_map([0.1, 0, 0], guarded), frames=frames)
    corrected = correct_program(path, make_map([0.1, 0, 0], guarded), frames=frames, on_guard="skip")
    assert corrected.summary()["corrected"] == 2
    assert corrected.files[path.with_suffix(".dat")] == DAT.encode()
    assert [t.reason for t in corrected.targets if t.name == "XP7"] == ["std of 0.9 mm is larger than the limit"]


def test_a_circle_is_skipped_as_a_whole(path: Path, frames: FrameTable, make_map: Any) -> None:
    corrected = correct_program(path, make_map([0.1, 0, 0], {0: "far away"}), frames=frames, on_guard="skip")
    assert {t.name: t.verdict for t in corrected.targets} == {
        "XHOME": "skip",
        "CIRC:7 auxiliary": "skip",
        "CIRC:7 end": "skip",
        "XP7": "correct",
    }
    assert corrected.files[path] == SRC.encode("latin-1")


def test_a_refused_target_may_be_left_out(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair(f"DEF cell( )\nBAS(#TOOL,3)\nLIN {POSE}\n$BASE=$NULLFRAME\nLIN {POSE}\nEND\n")
    with pytest.raises(RefusedError, match=r"cell\.src:3: LIN:3: no \$BASE is set before this motion"):
        correct_program(path, make_map(), frames=frames)
    corrected = correct_program(path, make_map([1, 0, 0]), frames=frames, on_guard="skip")
    assert [t.verdict for t in corrected.targets] == ["skip", "correct"]
    assert "no $BASE is set" in corrected.targets[0].reason


def test_nothing_correctable_is_refused(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair("DEF cell( )\n" + f"LIN {POSE}\n" * 5 + "END\n")
    for policy in ("refuse", "skip"):
        with pytest.raises(RefusedError, match=r"cell\.src:2: LIN:2: no \$TOOL is set [^:]* \(4 more alike\)"):
            correct_program(path, make_map(), frames=frames, on_guard=policy)


def test_joints_alone_come_back_as_they_are(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair("DEF cell( )\nPTP XHOME\nPTP {A1 0}\nEND\n")
    error_map = make_map([1, 1, 1])
    corrected = correct_program(path, error_map, frames=frames)
    assert (corrected.files[path], error_map.calls) == (path.read_bytes(), [])
    assert corrected.summary()["skipped"] == 2


def test_a_map_that_answers_nonsense_is_refused(path: Path, frames: FrameTable, make_map: Any) -> None:
    with pytest.raises(RefusedError, match=r"the map gave a correction that is not a number"):
        correct_program(path, make_map([np.nan, 0, 0]), frames=frames)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"on_guard": "ask"}, "on_guard is 'ask', expected"), ({"resolution": 0.0}, r"resolution is 0\.0 mm, expected")],
)
def test_wrong_arguments(path: Path, make_map: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        correct_program(path, make_map(), **arguments)


def test_write_leaves_every_file_and_the_record(path: Path, frames: FrameTable, make_map: Any, tmp_path: Path) -> None:
    corrected = correct_program(path, make_map([0.3, 0.2, 0.1]), frames=frames)
    written = corrected.write(tmp_path / "out" / "deep")
    assert [p.name for p in written] == ["cell.src", "cell.dat", "cell.corrections.json", "cell.corrections.csv"]
    assert {p: (tmp_path / "out" / "deep" / p.name).read_bytes() for p in corrected.files} == corrected.files
    record = json.loads(written[2].read_text())
    assert record == corrected.to_dict()
    assert record["map_sha256"] == "0" * 64
    assert record["written_by"] == f"truepose {truepose.__version__}"
    assert record["summary"]["corrected"] == 3
    assert record["summary"]["largest_correction_mm"] == pytest.approx(np.sqrt(0.14), abs=2e-3)
    assert record["summary"]["largest_std_mm"] == pytest.approx(2.0 * np.sqrt(3))
    home = record["targets"][0]
    assert (home["name"], home["before_mm"], home["std_mm"]) == ("XHOME", [None] * 3, None)
    rows = list(csv.DictReader(io.StringIO(written[3].read_text())))
    assert [row["name"] for row in rows] == [t["name"] for t in record["targets"]]
    assert float(rows[-1]["x_after_mm"]) == record["targets"][-1]["after_mm"][0]
    assert rows[-1]["motion"] == "LIN"
    assert home["base_mm"] == [None] * 3
    for entry, k in zip(record["targets"][1:], corrected.program.correctable(), strict=True):
        tf = corrected.program.targets[int(k)].tf_base_frame
        for when, base in (("before_mm", "base_mm"), ("after_mm", "base_after_mm")):
            np.testing.assert_allclose(entry[base], (tf @ [*entry[when], 1.0])[:3], atol=2e-6)


def test_a_corrected_program_is_not_corrected_again(
    path: Path, frames: FrameTable, make_map: Any, tmp_path: Path
) -> None:
    correct_program(path, make_map([0.3, 0.2, 0.1]), frames=frames).write(tmp_path / "out")
    with pytest.raises(RefusedError, match=r"out/cell\.\w+: was corrected already, see cell\.corrections\.json"):
        correct_program(tmp_path / "out" / "cell.src", make_map(), frames=frames)
    # zero correction changed nothing, so the result is the original still
    correct_program(path, make_map(), frames=frames).write(tmp_path / "same")
    correct_program(tmp_path / "same" / "cell.src", make_map(), frames=frames)
    (tmp_path / "same" / "cell.corrections.json").write_text("{")
    with pytest.raises(FileError, match="is no readable record of corrections"):
        correct_program(tmp_path / "same" / "cell.src", make_map(), frames=frames)


def test_the_program_itself_is_never_overwritten(path: Path, frames: FrameTable, make_map: Any, tmp_path: Path) -> None:
    corrected = correct_program(path, make_map([1, 0, 0]), frames=frames)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(FileError, match=r"cell\.src: is an input, and inputs are never overwritten"):
        corrected.write(tmp_path)
    linked = tmp_path / "link"
    linked.mkdir()
    os.link(path.with_suffix(".dat"), linked / "cell.dat")
    with pytest.raises(FileError, match=r"cell\.dat: is an input, and"):
        corrected.write(linked)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before
    assert [p.name for p in linked.iterdir()] == ["cell.dat"]


def test_nothing_is_left_where_writing_fails(path: Path, frames: FrameTable, make_map: Any, tmp_path: Path) -> None:
    corrected = correct_program(path, make_map([1, 0, 0]), frames=frames)
    out = tmp_path / "out"
    (out / "cell.corrections.json").mkdir(parents=True)
    with pytest.raises(FileError, match="is a folder"):
        corrected.write(out)
    assert [p.name for p in out.iterdir()] == ["cell.corrections.json"]
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        corrected.write(tmp_path / "file")


def test_options_reach_the_reader(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair(f"DEF cell( )\nBAS(#TOOL,3)\nBAS(#BASE,1)\nother()\nLIN {POSE}\nEND\n")
    with pytest.raises(RefusedError, match=r"OTHER\(\) was called, which is not in this file"):
        correct_program(path, make_map(), frames=frames)
    options = ReadOptions(calls_keep_frames=True)
    assert correct_program(path, make_map(), frames=frames, options=options).summary()["corrected"] == 1


@pytest.mark.parametrize("share", [0.49, 0.51, -0.51, 3.0])
def test_digits_that_are_off_by_more_than_half_a_step_are_refused(
    path: Path, frames: FrameTable, make_map: Any, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """Whatever the reason is: here numbers are written off by a share of the step of 0.001 mm."""

    def off(data: bytes, spans: Any, values: np.ndarray, delta: np.ndarray, step: float) -> np.ndarray:
        return values + delta + share * step

    monkeypatch.setattr(correct, "moved", off)
    identity = FrameTable(frames.tools, {2: np.eye(4)})
    if abs(share) > 0.5:
        with pytest.raises(RefusedError, match=r"cell\.src:7: CIRC:7 auxiliary: its digits cannot hold the correction"):
            correct_program(path, make_map([0.5, 0.25, 0.125]), frames=identity, proven=False)
    else:
        correct_program(path, make_map([0.5, 0.25, 0.125]), frames=identity, proven=False)
