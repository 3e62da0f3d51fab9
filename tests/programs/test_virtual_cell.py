"""The last step on the virtual cell, in each language: corrected, read again independently, driven and measured.

Programs have targets of several orientations in two frames. The reading of the corrected file is the test's own: plain
regular expressions on the lines that the test itself wrote. What remains after correction is what the map leaves.
"""
# ruff: noqa: E501

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.error_map import ErrorMap
from truepose.error_map.fit import fit_cell
from truepose.geometry import apply_transform, euler, invert_transform, make_transform
from truepose.programs import FrameTable, ReadOptions, correct_program
from truepose.simulation import VirtualCell

N = 24
Write = Callable[[list[np.ndarray], list[int]], str]


@dataclass(frozen=True)
class Language:
    ending: str
    controller: str
    pattern: str
    write: Write
    unit: float = 1.0
    options: ReadOptions = ReadOptions()  # noqa: RUF009 - frozen


def rapid(rows: list[np.ndarray], frames: list[int]) -> str:
    ext = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    lines = [
        f"MoveL [[{x:.3f},{y:.3f},{z:.3f}],[{a:.9f},{b:.9f},{c:.9f},{d:.9f}],[0,0,0,0],{ext}],v1,fine,tA\\WObj:=w{f};"
        for (x, y, z, a, b, c, d), f in zip(rows, frames, strict=True)
    ]
    return "MODULE m\nPROC main()\n" + "\n".join(lines) + "\nENDPROC\nENDMODULE\n"


def fanuc(rows: list[np.ndarray], frames: list[int]) -> str:
    moves = "".join(f"{i}:  UFRAME_NUM={f} ;\n{i}:L P[{i}] 9mm/sec FINE ;\n" for i, f in enumerate(frames, 1))
    points = "".join(
        f"P[{i}]{{\n GP1:\n UF : {f}, UT : 1, CONFIG : '',\n X = {r[0]:9.3f} mm, Y = {r[1]:9.3f} mm, Z = {r[2]:9.3f} mm,\n W = {r[3]:9.3f} deg, P = {r[4]:9.3f} deg, R = {r[5]:9.3f} deg\n}};\n"
        for i, (r, f) in enumerate(zip(rows, frames, strict=True), 1)
    )
    return f"/PROG A\n/MN\n{moves}/POS\n{points}/END\n"


def krl(rows: list[np.ndarray], frames: list[int]) -> str:
    lines = [
        f"$BASE=BASE_DATA[{f}]\nLIN {{" + ",".join(f"{k} {v:.3f}" for k, v in zip("XYZABC", r, strict=True)) + "}"
        for r, f in zip(rows, frames, strict=True)
    ]
    return "DEF a()\n$TOOL=TOOL_DATA[1]\n" + "\n".join(lines) + "\nEND\n"


def inform(rows: list[np.ndarray], frames: list[int]) -> str:
    points = "".join(
        f"///USER {f}\nC{i:05}="
        + ",".join(f"{v:.3f}" for v in r[:3])
        + ","
        + ",".join(f"{v:.4f}" for v in r[3:])
        + "\n"
        for i, (r, f) in enumerate(zip(rows, frames, strict=True))
    )
    moves = "".join(f"MOVL C{i:05} V=9.0\n" for i in range(len(rows)))
    return f"/JOB\n//POS\n///TOOL 1\n///POSTYPE USER\n///RECTAN\n{points}//INST\nNOP\n{moves}END\n"


def val3(rows: list[np.ndarray], frames: list[int]) -> str:
    keys = ("x", "y", "z", "rx", "ry", "rz")
    data = "".join(
        f'<Data name="p{i}" access="private" type="pointRx"><Value key="0" '
        + " ".join(f'{k}="{v:.4f}"' for k, v in zip(keys, r, strict=True))
        + f' fatherId="w{f}[0]" /></Data>\n'
        for i, (r, f) in enumerate(zip(rows, frames, strict=True))
    )
    return f"<Database><Datas>\n{data}</Datas></Database>\n"


def table(rows: list[np.ndarray], frames: list[int]) -> str:
    lines = [f"p,w{f}," + ",".join(f"{v:.4f}" for v in r) for r, f in zip(rows, frames, strict=True)]
    return "name,frame,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n" + "\n".join(lines) + "\n"


def gcode(rows: list[np.ndarray], frames: list[int]) -> str:
    return "G21 G90\n" + "".join(
        f"G{53 + f}\nG1" + "".join(f" {k}{v:.4f}" for k, v in zip("XYZABC", r, strict=True)) + "\n"
        for r, f in zip(rows, frames, strict=True)
    )


def urscript(rows: list[np.ndarray], frames: list[int]) -> str:
    return "def a():\n" + "".join("  movel(p[" + ",".join(f"{v:.7f}" for v in r) + "])\n" for r in rows) + "end\n"


def apt(rows: list[np.ndarray], frames: list[int]) -> str:
    lines = ["GOTO/" + ",".join(f"{v:.4f}" for v in r[:3]) + "," + ",".join(f"{v:.9f}" for v in r[3:]) for r in rows]
    return "UNITS/MM\nLOADTL/1\n" + "\n".join(lines) + "\nFINI\n"


def with_x_near(tf: np.ndarray) -> np.ndarray:
    """Turn poses about their z so that x is as near to the frame's x as it can be: what an axis alone says."""
    turned = tf.copy()
    for row, pose in zip(turned, tf, strict=True):
        y = np.cross(pose[:3, 2], [1.0, 0.0, 0.0])
        row[:3, 1] = y / np.linalg.norm(y)
        row[:3, 0] = np.cross(row[:3, 1], pose[:3, 2])
    return turned


NUM = r"\s*(-?[\d.]+)"
LANGUAGES = {
    "krl": Language(".src", "kuka", rf"X{NUM},Y{NUM},Z{NUM}", krl),
    "rapid": Language(".mod", "abb", rf"\[\[{NUM},{NUM},{NUM}\]", rapid),
    "fanuc": Language(".ls", "fanuc", rf"X ={NUM} mm, Y ={NUM} mm, Z ={NUM} mm", fanuc),
    "inform": Language(".jbi", "yaskawa", rf"C\d+={NUM},{NUM},{NUM}", inform),
    "val3": Language(".dtx", "staubli", rf' x="{NUM}" y="{NUM}" z="{NUM}"', val3),
    "table": Language(".csv", "kuka", rf"p,w\d,{NUM},{NUM},{NUM}", table),
    "gcode": Language(".nc", "kuka", rf"G1 X{NUM} Y{NUM} Z{NUM}", gcode, options=ReadOptions(angles="kuka")),
    "urscript": Language(".script", "ur", rf"p\[{NUM},{NUM},{NUM}", urscript, unit=1000.0),
}
APT = Language(".apt", "apt", rf"GOTO/{NUM},{NUM},{NUM}", apt, options=ReadOptions(angles="z"))


@pytest.fixture(scope="module")
def measured_cell() -> tuple[VirtualCell, ErrorMap]:
    virtual = VirtualCell("paper", seed=11)
    samples = virtual.measure(virtual.design(160, seed=2))
    return virtual, fit_cell(virtual.cell, samples, "ordinary-kriging")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", [*LANGUAGES, "apt"])
def test_what_remains_is_what_the_map_leaves(
    tmp_path: Path, measured_cell: tuple[VirtualCell, ErrorMap], name: str
) -> None:
    language = LANGUAGES.get(name, APT)
    virtual, error_map = measured_cell
    rng = np.random.default_rng(7)
    middle = np.asarray(virtual.preset.centre_mm)
    size = np.asarray(virtual.preset.size_mm)
    p_base = middle + rng.uniform(-0.3, 0.3, (N, 3)) * size
    turn = Rotation.from_rotvec(rng.uniform(-0.02, 0.02, (N, 3)))
    rotation = turn * euler("kuka", list(virtual.preset.abc_deg))
    poses = make_transform(rotation, p_base)
    frames = {
        1: make_transform(euler("kuka", [30.0, -10.0, 5.0]), np.add(middle, [100.0, 0.0, 0.0])),
        2: make_transform(euler("kuka", [-120.0, 20.0, 0.0]), np.subtract(middle, [0.0, 50.0, 20.0])),
    }
    number = [1 + i % 2 for i in range(N)]
    if name == "apt":  # an axis, in one frame that the user names; its x lies as the tool's was when measured
        number, frames[1] = [1] * N, make_transform(euler("kuka", list(virtual.preset.abc_deg)), frames[1][:3, 3])
    in_frame = (
        poses
        if name == "urscript"
        else np.array([invert_transform(frames[f]) @ tf for f, tf in zip(number, poses, strict=True)])
    )
    if name == "apt":
        in_frame = with_x_near(in_frame)
        poses = frames[1] @ in_frame
        rotation = Rotation.from_matrix(poses[:, :3, :3])
        angles = in_frame[:, :3, 2]
    else:
        angles = euler(language.controller, Rotation.from_matrix(in_frame[:, :3, :3]))
    rows = list(np.column_stack([in_frame[:, :3, 3] / language.unit, angles]))
    path = tmp_path / f"a{language.ending}"
    path.write_text(language.write(rows, number))
    tool = virtual.tf_flange_tool
    known = FrameTable(
        tools={1: tool, "tA": tool},
        bases={**frames, "w1": frames[1], "w2": frames[2], "G54": frames[1], "G55": frames[2]},
        tool="map",
        base=1 if name == "apt" else None,
    )
    corrected = correct_program(path, error_map, frames=known, options=language.options, other_maker=True)
    assert corrected.summary()["corrected"] == N
    text = corrected.files[path].decode()
    found = np.array(re.findall(language.pattern, text), dtype=float) * language.unit
    assert len(found) == N
    if name != "urscript":
        found = np.array([apply_transform(frames[f], p[None])[0] for f, p in zip(number, found, strict=True)])

    # driven on the true robot, without the noise of a reading
    def misses(p: np.ndarray) -> np.ndarray:
        p_tracker = apply_transform(tf_tracker_base, virtual.true_position(virtual.reach(p, rotation)))
        return apply_transform(error_map.registration.tf_base_tracker, p_tracker) - p_base

    tf_tracker_base = invert_transform(virtual.truth.tf_base_tracker)
    before, after = misses(p_base), misses(found)
    # the map's own command, unrounded, driven in the same way
    answer = error_map.correct(poses, tf_flange_tool=tool)
    ideal = misses(answer.p_command)
    digits = 0.5e-3 * np.sqrt(3) + 1e-4
    angle = np.deg2rad(0.5e-3) * np.linalg.norm(tool[:3, 3])  # orientations are written with few digits
    assert np.abs(np.linalg.norm(after, axis=1) - np.linalg.norm(ideal, axis=1)).max() < digits + angle
    assert np.linalg.norm(after, axis=1).mean() < 0.5 * np.linalg.norm(before, axis=1).mean()


@pytest.fixture(scope="module")
def arm_map(measured_cell: tuple[VirtualCell, ErrorMap]) -> ErrorMap:
    virtual, _ = measured_cell
    return fit_cell(virtual.cell, virtual.measure(virtual.design(160, seed=2, orientation_deg=10.0)), "calibration")


WHOLE = {
    "krl": rf"X{NUM},Y{NUM},Z{NUM},A{NUM},B{NUM},C{NUM}",
    "rapid": rf"\[\[{NUM},{NUM},{NUM}\],\[{NUM},{NUM},{NUM},{NUM}\]",
    "urscript": rf"p\[{NUM},{NUM},{NUM},{NUM},{NUM},{NUM}\]",
}


@pytest.mark.parametrize("name", WHOLE)
def test_orientations_are_what_the_map_leaves(
    tmp_path: Path, measured_cell: tuple[VirtualCell, ErrorMap], arm_map: ErrorMap, name: str
) -> None:
    language, virtual = LANGUAGES[name], measured_cell[0]
    rng = np.random.default_rng(8)
    middle, size = np.asarray(virtual.preset.centre_mm), np.asarray(virtual.preset.size_mm)
    turn = Rotation.from_rotvec(rng.uniform(-0.08, 0.08, (N, 3)))
    p_base = middle + rng.uniform(-0.3, 0.3, (N, 3)) * size
    poses = make_transform(turn * euler("kuka", list(virtual.preset.abc_deg)), p_base)
    base = make_transform(euler("kuka", [30.0, -10.0, 5.0]), middle) if name != "urscript" else np.eye(4)
    in_frame = invert_transform(base) @ poses
    angles = euler(language.controller, Rotation.from_matrix(in_frame[:, :3, :3]))
    path = tmp_path / f"a{language.ending}"
    path.write_text(language.write(list(np.column_stack([in_frame[:, :3, 3] / language.unit, angles])), [1] * N))
    tool = virtual.tf_flange_tool
    known = FrameTable(tools={1: tool, "tA": tool}, bases={1: base, "w1": base}, tool="map")
    corrected = correct_program(path, arm_map, frames=known, on_guard="skip", orientation=True, other_maker=True)
    done = np.array([outcome.verdict == "correct" for outcome in corrected.targets])
    assert done.mean() > 0.8, corrected.targets[0].reason
    rows = np.array(re.findall(WHOLE[name], corrected.files[path].decode()), dtype=float)
    found = base @ make_transform(euler(language.controller, rows[:, 3:]), rows[:, :3] * language.unit)

    def misses(command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = virtual.reach(command[:, :3, 3], Rotation.from_matrix(command[:, :3, :3]))
        true = seen @ virtual.truth.forward(q, virtual._conditions(q, None, None, None))
        error = Rotation.from_matrix(true[:, :3, :3]) * Rotation.from_matrix(poses[:, :3, :3]).inv()
        return true[:, :3, 3] - p_base, error.as_rotvec()

    # as the map's registration sees the true robot
    seen = arm_map.registration.tf_base_tracker @ invert_transform(virtual.truth.tf_base_tracker)
    answer = arm_map.correct(poses, tf_flange_tool=tool, on_guard="skip", orientation=True)
    ideal = make_transform(
        Rotation.from_rotvec(answer.rotation) * Rotation.from_matrix(poses[:, :3, :3]), answer.p_command
    )
    (_, before), (_, after), (_, best) = misses(poses), misses(found), misses(ideal)
    assert np.abs(after - best)[done].max() < 2e-5
    assert np.linalg.norm(after[done], axis=1).mean() < 0.85 * np.linalg.norm(before[done], axis=1).mean()
