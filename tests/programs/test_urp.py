"""Programs of Universal Robots' own editor: joints corrected by the arm that the waypoints state."""

# ruff: noqa: E501

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.joint_arms import Sagging
from tests.programs.urp_files import (
    ANGLES,
    CALIBRATED,
    NOMINAL,
    Waypoint,
    as_transform,
    forward,
    installation,
    listed,
    move,
    packed,
    program,
)

from truepose.errors import FileError, RefusedError
from truepose.programs import CorrectedProgram, FrameTable, Program, ReadOptions, correct_program, read_program
from truepose.robots import load_robot

TCP = (0.01, -0.02, 0.15, 0.1, 0.0, 0.3)
PLANE = (0.4, -0.2, 0.05, 0.0, 0.1, 0.7)
ROBOT = load_robot("universal-robots-ur10e")
Q = np.array(
    [[-1.55, -1.62, 1.93, -1.87, -1.51, 0.2], [-1.4, -1.5, 1.8, -1.7, -1.4, 0.1], [-1.2, -1.3, 1.5, -1.6, -1.3, 0.0]]
)


def points(arm: dict[str, tuple[float, ...]] = NOMINAL, **more: Any) -> list[Waypoint]:
    return [Waypoint(f"Waypoint_{k}", q, TCP, arm, **more) for k, q in enumerate(Q, 1)]


def lay(folder: Path, nodes: Sequence[str], name: str = "cell.urp", **more: Any) -> Path:
    path = folder / name
    path.write_bytes(packed(program(nodes, **more), "cell.xml"))
    return path


def correct(
    path: Path, scale: float = 1.0, *, frames: FrameTable | None = None, stated: bool = False, **more: Any
) -> CorrectedProgram:
    options = ReadOptions(joint_targets=True, controller_kinematics=stated)
    return correct_program(path, Sagging(ROBOT, scale), frames=frames, options=options, **more)


def told(data: bytes) -> np.ndarray:
    return np.array([[float(part) for part in m[1].split(b",")] for m in ANGLES.finditer(gzip.decompress(data))])


def reasons(found: Program) -> list[str]:
    return [f"{target.verdict}: {target.reason}" for target in found.targets]


@pytest.mark.parametrize(("arm", "stated"), [(NOMINAL, False), (CALIBRATED, True)])
def test_written_joints_bring_the_tool_to_the_taught_pose(
    tmp_path: Path, arm: dict[str, tuple[float, ...]], stated: bool
) -> None:
    """The controller's pose of the new joints, with the errors that the map states, is the pose that was taught."""
    path = lay(tmp_path, [move(points(arm), "MoveJ"), move([Waypoint("W9", Q[0] + 0.05, TCP, arm)])])
    corrected = correct(path, stated=stated)
    before, after = told(path.read_bytes()), told(corrected.files[path])
    assert (before != after).any(axis=1).all()
    tool = as_transform(TCP)
    for old, new in zip(before, after, strict=True):
        target, command = (1000.0 * (forward(arm, q) @ tool)[:3, 3] for q in (old, new))
        assert np.linalg.norm(command + Sagging(ROBOT).error(command) - target) < 1e-3
        assert np.linalg.norm(command - target) > 0.3
        turned = forward(arm, old)[:3, :3].T @ forward(arm, new)[:3, :3]
        assert np.abs(turned - np.eye(3)).max() < 1e-6
    text, patched = (gzip.decompress(data) for data in (path.read_bytes(), corrected.files[path]))
    assert ANGLES.sub(b"", text) == ANGLES.sub(b"", patched)


def test_a_correction_of_zero_keeps_the_packed_bytes(tmp_path: Path) -> None:
    path = lay(tmp_path, [move(points())])
    corrected = correct(path, 0.0)
    assert corrected.files[path] == path.read_bytes()
    assert corrected.coverage.corrected == 3
    assert corrected.hashes[path] == corrected.program.sources[0].sha256


def test_the_header_of_the_file_is_kept_and_its_sums_are_right(tmp_path: Path) -> None:
    path = lay(tmp_path, [move(points())])
    written = correct(path).write(tmp_path / "out")
    data = next(file for file in written if file.suffix == ".urp").read_bytes()
    assert data[: 10 + len(b"cell.xml\0")] == path.read_bytes()[: 10 + len(b"cell.xml\0")]
    assert int.from_bytes(data[-8:-4], "little") == zlib.crc32(gzip.decompress(data))


def test_written_in_place_and_recognised(tmp_path: Path) -> None:
    path = lay(tmp_path, [move(points())])
    original = path.read_bytes()
    correct(path).write_in_place()
    assert (tmp_path / "cell.urp.original").read_bytes() == original
    with pytest.raises(RefusedError, match="already"):
        correct(path)


def test_joints_are_left_without_the_option(tmp_path: Path) -> None:
    found = read_program(lay(tmp_path, [move(points())]))
    assert reasons(found) == ["skip: joint target; allow joint_targets to correct it"] * 3
    assert (found.language, found.targets[0].motions, found.targets[0].name) == ("urp", ("MoveL",), "Waypoint_1")


def test_another_arm_model_is_refused_unless_stated(tmp_path: Path) -> None:
    with pytest.raises(
        RefusedError, match=r"mm from where universal-robots-ur10e does; state .*--controller-kinematics"
    ):
        correct(lay(tmp_path, [move(points(CALIBRATED))]))
    other = {**NOMINAL, "a": (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)}
    with pytest.raises(RefusedError, match="it is a program of another robot"):
        correct(lay(tmp_path, [move(points(other))]), stated=True)
    zeros = dict.fromkeys(NOMINAL, (0.0,) * 6)
    assert correct(lay(tmp_path, [move(points(zeros))])).coverage.corrected == 3


@pytest.mark.parametrize(
    ("node", "reason"),
    [
        (move([Waypoint("W", Q[0], TCP, kind="Relative")]), "relative"),
        (move([Waypoint("W", Q[0], TCP, kind="Variable")]), "known at run time"),
        (f"<Force>{move([Waypoint('W', Q[0], TCP)])}</Force>", "inside <Force>, which may change where it leads"),
        (f"<Pallet><children>{Waypoint('W', Q[0], TCP).xml()}</children></Pallet>", "inside <Pallet>"),
        (move([Waypoint("W", Q[0], TCP)]) + "<Script>force_mode(a,b)</Script>", "may shift it at run time"),
        (move([Waypoint("W", Q[0], TCP)]) + "<Script>set_tcp(p[0,0,0,0,0,0])</Script>", "a Script node sets the TCP"),
        (move([Waypoint("W", Q[0], TCP)]) + "<Script>x=pose_add(W_p,d)</Script>", "both moved to"),
        (move([Waypoint("W", Q[0], TCP)], feature="Plane_1"), r"base Plane_1 is not known; give it in \[frames"),
        (move([Waypoint("W", Q[0], TCP, feature=PLANE)]), "is not where it was when the waypoint was taught"),
        (move([Waypoint("W", Q[0], TCP)], feature='<feature class="G" reference="../../Move[7]/feature"/>'), "refers to a feature"),
    ],
)  # fmt: skip
def test_what_may_lead_elsewhere_is_named(tmp_path: Path, node: str, reason: str) -> None:
    found = read_program(lay(tmp_path, [node]), None, ReadOptions(joint_targets=True))
    assert found.counts()["correct"] == 0
    text = reasons(found)[0]
    assert re.search(reason, text), text


@pytest.mark.parametrize("name", ["", "../other", "a\\b", "x" * 300, ".", "none"])
def test_installations_that_are_not_beside_the_program(tmp_path: Path, name: str) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "other.installation").write_bytes(b"broken")
    found = read_program(
        lay(tmp_path / "sub", [move(points())], installation=name), None, ReadOptions(joint_targets=True)
    )
    assert found.counts()["correct"] == 3


def test_motions_of_script_nodes_are_listed(tmp_path: Path) -> None:
    found = read_program(lay(tmp_path, ["<Script>movel(p[0.1,0.2,0.3,0,3,0])</Script>"]))
    assert [text.partition(":")[0] for text in reasons(found)] == ["skip"]


def test_a_waypoint_that_several_moves_share(tmp_path: Path) -> None:
    again = '\n    <Waypoint reference="../../../Move/children/Waypoint[2]"/>'
    path = lay(tmp_path, [move(points()), move([again])])
    found = read_program(path, None, ReadOptions(joint_targets=True))
    assert [target.motions for target in found.targets] == [("MoveL",), ("MoveL", "MoveL"), ("MoveL",)]
    assert found.counts()["correct"] == 3


@pytest.mark.promise(
    "What is suppressed or was removed in a .urp is not executed: it moves nothing and changes nothing."
)
@pytest.mark.parametrize("tag", ["suppressedNode", "SuppressedNode", "removedSiblings"])
def test_what_is_not_executed(tmp_path: Path, tag: str) -> None:
    changes = "<Script>set_tcp(p[0,0,0,0,0,0])</Script><Script>force_mode(a,b)</Script><Script>x=Waypoint_1_p</Script>"
    inside = f"<Folder><{tag}>{changes}{move([Waypoint('W', Q[0], TCP)])}</{tag}></Folder>"
    again = f'<Waypoint reference="../../../Folder/{tag}/Move/children/Waypoint"/>'
    found = read_program(lay(tmp_path, [move(points()), inside]), None, ReadOptions(joint_targets=True))
    assert {t.name: (t.verdict, len(t.motions)) for t in found.targets if t.motions} == {
        f"Waypoint_{k}": ("correct", 1) for k in (1, 2, 3)
    }
    assert [t.verdict for t in found.targets if not t.motions] in (["skip"], [])
    found = read_program(lay(tmp_path, [inside, move([again])]), None, ReadOptions(joint_targets=True))
    assert [(t.name, t.verdict, t.motions) for t in found.targets] == [("W", "correct", ("MoveL",))]


CALL = (
    """<CallSubProgram><subprogram name="sub" keepHidden="true"><children>{}</children></subprogram></CallSubProgram>"""
)
AGAIN = '<CallSubProgram><subprogram reference="{}"/></CallSubProgram>'


@pytest.mark.promise("The tree of a subprogram in a .urp is executed where it is called, and judged by all its calls.")
@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("", ("correct", "")),
        (AGAIN.format("../../CallSubProgram/subprogram"), ("correct", "")),
        (f"<Loop><children>{AGAIN.format('../../../../CallSubProgram/subprogram')}</children></Loop>", ("correct", "")),
        (f"<Force>{AGAIN.format('../../Elsewhere/subprogram')}</Force>", ("refuse", "inside <Force>")),
        (f"<Force>{AGAIN.format('../../../CallSubProgram/subprogram')}</Force>", ("refuse", "inside <Force>")),
        (
            f"<suppressedNode><Force>{AGAIN.format('../../../../CallSubProgram/subprogram')}</Force></suppressedNode>",
            ("correct", ""),
        ),
    ],
)
def test_subprograms(tmp_path: Path, more: str, expected: tuple[str, str]) -> None:
    nodes = [CALL.format(move([Waypoint("W", Q[0], TCP)])), more]
    text = program(nodes).replace(
        "</MainProgram>", '</MainProgram><SubProgram reference="../MainProgram/children/CallSubProgram/subprogram"/>'
    )
    path = tmp_path / "cell.urp"
    path.write_bytes(packed(text))
    (target,) = read_program(path, None, ReadOptions(joint_targets=True)).targets
    assert target.verdict == expected[0]
    assert expected[1] in target.reason
    assert target.motions == (("MoveL",) if target.verdict == "correct" else ("Waypoint",))


def test_a_subprogram_that_is_defined_apart(tmp_path: Path) -> None:
    tree = f'<SubProgram name="s"><children>{move([Waypoint("W", Q[0], TCP)])}</children></SubProgram>'
    call = AGAIN.format("../../../../SubProgram")
    for node, verdict in ((call, "correct"), (f"<Force>{call.replace('../', '../../', 1)}</Force>", "refuse")):
        path = tmp_path / "cell.urp"
        path.write_bytes(packed(program([node]).replace("</MainProgram>", f"</MainProgram>{tree}")))
        (target,) = read_program(path, None, ReadOptions(joint_targets=True)).targets
        assert target.verdict == verdict, target.reason


@pytest.mark.promise("A .urp that is not packed, as PolyScope 1.8 to 3.1 writes it, is read and written as text.")
@pytest.mark.parametrize("head", [b"", b'<?xml version="1.0" encoding="UTF-8"?>\n', b"\xef\xbb\xbf"])
def test_programs_of_older_controllers(tmp_path: Path, head: bytes) -> None:
    """They have no arm model in waypoints, and waypoints directly in the program, which has the settings of a Move."""
    plain = re.sub(r"\s*<Kinematics.*?</Kinematics>", "", Waypoint("W2", Q[1], TCP).xml(), flags=re.S)
    text = program([move([Waypoint("W1", Q[0], TCP)]), plain]).replace("5.11.1", "1.8.16941")
    text = text.replace("<MainProgram ", '<MainProgram motionType="MoveJ" speed="1.05" useActiveTCP="false" ')
    path = tmp_path / "old.urp"
    path.write_bytes(head + text.replace("\n", "\r\n").encode())
    corrected = correct(path)
    assert [t.motions for t in corrected.program.targets] == [("MoveL",), ("MoveJ",)]
    assert corrected.coverage.corrected == 2
    written = corrected.files[path]
    assert written.startswith(head + b"<URProgram")
    assert ANGLES.sub(b"", written) == ANGLES.sub(b"", path.read_bytes())


def test_features_and_tcps_of_the_installation(tmp_path: Path) -> None:
    taught = points(feature=PLANE)
    shared = '<feature class="GeomFeatureReference" reference="../../Move/feature"/>'
    path = lay(tmp_path, [move(taught[:1], feature="Plane_1"), move(taught[1:], feature=shared)])
    options = ReadOptions(joint_targets=True)
    assert read_program(path, FrameTable(bases={"Plane_1": _mm(PLANE)}), options).counts()["correct"] == 3
    beside = tmp_path / "default.installation"
    for tcp, plane, expected in [
        (TCP, PLANE, "correct: "),
        (TCP, listed_shift(PLANE), "refuse: the feature Plane_1 is not where it was"),
        (listed_shift(TCP), PLANE, "refuse: it was taught with another TCP than grip"),
    ]:
        beside.write_bytes(packed(installation({"grip": tcp}, "grip", {"Plane_1": plane})))
        found = read_program(path, None, options)
        assert all(text.startswith(expected) for text in reasons(found)), reasons(found)


def _mm(pose: Sequence[float]) -> np.ndarray:
    tf = as_transform(pose)
    tf[:3, 3] *= 1000.0
    return tf


def listed_shift(pose: Sequence[float]) -> tuple[float, ...]:
    return (pose[0] + 0.002, *pose[1:])


WHOLE = packed(program([move(points())]))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (WHOLE[:-20], "is truncated; copy it from the controller again"),
        (WHOLE[:9], "is truncated"),
        (b"\x1f\x8b\x08", "is truncated"),
        (WHOLE[:-8] + b"\0" * 8, "its check sum is wrong"),
        (WHOLE[:30] + b"\xff" * 20 + WHOLE[50:], "is broken"),
        (WHOLE + WHOLE, "holds bytes behind its end"),
        (gzip.compress(b"<URProgram>" + b" " * 30_000_000), "bytes when it is unpacked; that is no program"),
        (packed("<!DOCTYPE a [<!ENTITY b 'c'>]><URProgram>&b;</URProgram>"), "has a DOCTYPE"),
        (packed("<URProgram>&b;</URProgram>"), "is broken XML: undefined entity"),
        (packed("<Installation/>"), "expected <URProgram>"),
        (packed("<a>" * 600), "500 deep"),
        (packed(program([move(points())]).replace(listed(Q[0]), "1, 2, 3")), "angles of <JointAngles> has 3 numbers"),
        (packed(program([move(points())]).replace("-1.55", "-1.5.5")), r"cell\.urp:11: angles of <JointAngles>: -1\.5\.5 is not a number"),
        (b"", "broken XML"),
    ],
)  # fmt: skip
def test_broken_files(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "cell.urp"
    path.write_bytes(data)
    with pytest.raises(FileError, match=message):
        read_program(path)
