"""Joint targets: forward with the arm of the map, corrected, and back; checked by another model of the arm."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.programs.joint_arms import FRAMES, MAKERS, TOOL, Maker, Sagging, forward
from tests.tiers import examples

from truepose.errors import RefusedError
from truepose.programs import CorrectedProgram, Program, ReadOptions, correct_program, read_program
from truepose.programs.core.joint_targets import in_degrees, in_pulses
from truepose.robots import list_robots, load_robot, shown_joints
from truepose.robots.pendant import ground_objection

JOINTS = ReadOptions(joint_targets=True, whole_task=True)
ALL = pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS.keys())


def texts(numbers: np.ndarray, decimals: int = 3) -> list[list[str]]:
    return [[f"{value:.{decimals}f}" for value in row] for row in numbers]


def correct(path: Path | Program, maker: Maker, scale: float = 1.0, **more: Any) -> CorrectedProgram:
    read = {} if isinstance(path, Program) else {"frames": FRAMES, "options": JOINTS}
    return correct_program(path, Sagging(maker.robot, scale), **{**read, **more})


def after(corrected: CorrectedProgram) -> bytes:
    (content,) = corrected.files.values()
    return content


@ALL
def test_the_model_of_this_test_is_the_librarys(maker: Maker) -> None:
    q = maker.joints(maker.some(5, 1))
    np.testing.assert_allclose([forward(maker.robot, row) for row in q], maker.robot.forward(q), atol=1e-9)


@ALL
def test_written_joints_bring_the_tool_to_the_target(tmp_path: Path, maker: Maker) -> None:
    """The arm with its errors, at the joints that were written, stands where the nominal arm was told to stand."""
    path = maker.file(tmp_path, texts(maker.some(25, 2)))
    steps: list[tuple[int, int]] = []
    corrected = correct(path, maker, progress=lambda *now: steps.append(now))
    assert steps == [(25, 25)]
    told = maker.read(path.read_bytes())
    written, errors = maker.read(after(corrected)), Sagging(maker.robot)
    assert len(written) == len(told) == 25
    assert (written != told).any(axis=1).all()
    np.testing.assert_allclose(written, told, atol=1.0)  # on the same branch, within the same turn
    for before, now, outcome in zip(told, written, corrected.targets, strict=True):
        target, command = maker.tool(before), maker.tool(now)
        miss = np.linalg.norm(command + errors.error(command) - target)
        assert miss == pytest.approx(outcome.remaining, abs=2e-4)
        assert miss < 4 * np.radians(maker.step) * 2500
        assert outcome.verdict == "correct"
        np.testing.assert_allclose(outcome.joints_after, now, atol=1e-9)
        turned = forward(maker.robot, maker.joints(now))[:3, :3].T @ forward(maker.robot, maker.joints(before))[:3, :3]
        assert np.degrees(np.arccos(min(1.0, (np.trace(turned) - 1) / 2))) < 4 * maker.step


@ALL
def test_a_correction_of_zero_returns_the_file(tmp_path: Path, maker: Maker) -> None:
    path = maker.file(tmp_path, texts(maker.some(10, 3), 5 if maker.step < 1e-3 else 3))
    corrected = correct(path, maker, scale=0.0)
    assert after(corrected) == path.read_bytes()
    assert corrected.coverage.corrected == 10


@ALL
def test_off_by_default_and_named(tmp_path: Path, maker: Maker) -> None:
    path = maker.file(tmp_path, texts(maker.some(3, 4)))
    program = read_program(path, FRAMES, replace(JOINTS, joint_targets=False))
    assert {(t.verdict, t.reason) for t in program.targets} == {
        ("skip", "joint target; allow joint_targets to correct it")
    }
    corrected = correct(program, maker)
    assert after(corrected) == path.read_bytes()
    assert "joint_targets" not in corrected.summary()
    unknown = read_program(path, None, replace(JOINTS, joint_targets=False))
    assert {t.reason for t in unknown.targets} == {"joint target"}  # the option would not help


@ALL
def test_an_unknown_tool_is_refused_an_unknown_base_is_not(tmp_path: Path, maker: Maker) -> None:
    path = maker.file(tmp_path, texts(maker.some(1, 5)))
    (target,) = read_program(path, None, JOINTS).targets
    assert target.verdict == "refuse"
    assert "not known" in target.reason
    (target,) = read_program(path, FRAMES, JOINTS).targets
    assert (target.verdict, target.frame, target.tf_base_frame) == ("correct", "", None)
    np.testing.assert_array_equal(target.tf_flange_tool, TOOL)


@ALL
def test_outside_limits_and_singular_joints_are_refused(tmp_path: Path, maker: Maker) -> None:
    good, far, singular = maker.some(3, 6)
    far[0], singular[4] = 500.0, 0.01
    path = maker.file(tmp_path, texts(np.array([good, far, singular])))
    with pytest.raises(RefusedError, match=r"joint 1 is at 500\.000°, limits .* near a singularity"):
        correct(path, maker)
    left = correct(path, maker, on_guard="skip")
    assert [t.verdict for t in left.targets] == ["correct", "skip", "skip"]
    written = maker.read(after(left))
    np.testing.assert_array_equal(written[1:], maker.read(path.read_bytes())[1:])


@ALL
def test_guarded_joint_targets_stay(tmp_path: Path, maker: Maker) -> None:
    class Guarded(Sagging):
        def correct(self, poses: np.ndarray, on_guard: str = "", **more: Any) -> Any:
            answer = super().correct(poses, **more)
            answer.verdict[:] = "refuse" if on_guard == "refuse" else "skip"
            answer.reason[:] = ["far away"] * len(poses)
            answer.p_command = answer.p_target
            return answer

    path = maker.file(tmp_path, texts(maker.some(2, 14)))
    given = {"frames": FRAMES, "options": JOINTS}
    with pytest.raises(RefusedError, match="far away"):
        correct_program(path, Guarded(maker.robot), **given)
    left = correct_program(path, Guarded(maker.robot), on_guard="skip", **given)
    assert after(left) == path.read_bytes()
    assert [(t.verdict, t.reason) for t in left.targets] == [("skip", "far away")] * 2
    assert all(np.isnan(t.joints_after).all() for t in left.targets)
    assert left.summary()["joint_targets"] == 0


def test_full_turns_are_kept(tmp_path: Path) -> None:
    maker = MAKERS["kuka"]
    numbers = maker.some(1, 7).repeat(4, axis=0)
    numbers[:, 3], numbers[:, 5] = (250.0, -110.0, 179.999, -179.999), (340.0, -20.0, -180.001, 180.001)
    path = maker.file(tmp_path, texts(numbers))
    np.testing.assert_allclose(maker.read(after(correct(path, maker))), numbers, atol=0.2)


@pytest.mark.parametrize("text", ["-5", "-5.", "-.5", "+7.25", "-5.125000", "1e1", "-0.0", "  12.5", "12.5"])
def test_every_style_of_number_keeps_its_style(tmp_path: Path, text: str) -> None:
    maker = MAKERS["kuka"]
    row = [text, "-80.0", "95", "-20.25", "-45.5", "30"]
    path = maker.file(tmp_path, [row])
    new = re.search(rb"A1 (\s*[-+.0-9e]+)", after(correct(path, maker)))
    assert new is not None
    written = new[1].decode()
    assert float(written) == pytest.approx(float(text), abs=0.2)
    assert written != text
    assert written.startswith("+") == text.startswith("+")
    assert len(written.partition(".")[2]) >= len(text.strip().lower().partition("e")[0].partition(".")[2])
    assert after(correct(path, maker, scale=0.0)) == path.read_bytes()


def test_fanuc_columns_are_kept(tmp_path: Path) -> None:
    maker = MAKERS["fanuc"]
    numbers = np.array([[-0.858, 10.0, -9.999, 99.999, -100.0, 0.001], [-100.25, -20.5, 30.0, -179.999, 45.0, -0.001]])
    rows = [[text.replace("-0.", "-.").replace("0.001", ".001") for text in row] for row in texts(numbers)]
    path = maker.file(tmp_path, rows)
    before, now = path.read_bytes().decode().splitlines(), after(correct(path, maker)).decode().splitlines()
    assert [len(line) for line in before] == [len(line) for line in now]
    changed = [(a, b) for a, b in zip(before, now, strict=True) if a != b]
    assert len(changed) == 4
    for old, new in changed:
        assert re.sub(r"[-.\d ]+ deg", "# deg", old) == re.sub(r"[-.\d ]+ deg", "# deg", new)
        assert all(re.fullmatch(r" +-?\d*\.\d{3}", text) for text in re.findall(r"=([^d]*) deg", new))


def test_fanuc_counts_j3_from_the_ground(tmp_path: Path) -> None:
    # the forearm stays level while J2 alone moves
    robot = MAKERS["fanuc"].robot
    level = robot.forward(
        shown_joints(robot).to_model(np.radians([[0.0, a, 0.0, 0.0, 0.0, 0.0] for a in (0.0, 20.0, -35.0)]))
    )
    np.testing.assert_allclose(level[:, :3, :3], np.broadcast_to(level[0, :3, :3], (3, 3, 3)), atol=1e-9)
    assert all(not ground_objection(load_robot(name)) for name in list_robots() if name.startswith("fanuc"))
    other = replace(robot, name="turned", sign=np.array([1, 1, 1, -1, -1, -1]))
    lying = replace(robot, name="lying", offset=np.zeros(6))
    bent = replace(robot, name="bent", offset=robot.offset + np.array([0, 0, 0.5, 0, 0, 0]))
    maker = MAKERS["fanuc"]
    path = maker.file(tmp_path, texts(maker.some(1, 8)))
    for arm, why in ((other, "against each other"), (lying, "upper arm"), (bent, "forearm")):
        assert why in ground_objection(arm)
        with pytest.raises(RefusedError, match=f"J3 counts from the ground, and .*{why}"):
            correct_program(path, Sagging(arm), frames=FRAMES, options=JOINTS, other_maker=True)
        stated = replace(arm, coupling=[[3, 2, 1.0]])  # the robot file knows better
        read = correct_program(path, Sagging(stated), frames=FRAMES, options=JOINTS, other_maker=True, on_guard="skip")
        assert "J3 counts" not in " ".join(target.reason for target in read.targets)


@pytest.mark.parametrize("maker", [MAKERS["kuka"], MAKERS["fanuc"]], ids=["kuka", "fanuc"])
def test_couplings_of_the_robot_file_hold_in_programs(tmp_path: Path, maker: Maker) -> None:
    """A file written for the same arm with other couplings brings the tool to the same places."""
    q = maker.joints(maker.some(6, 21))
    coupling = [[3, 2, 0.5], [6, 5, -0.25], [5, 4, 0.125]]
    robot = replace(maker.robot, coupling=coupling)
    # by hand: model joints less what other joints add, from the first to the last
    shown = q.copy()
    shown[:, 2] -= 0.5 * shown[:, 1]
    shown[:, 4] -= 0.125 * shown[:, 3]
    shown[:, 5] += 0.25 * shown[:, 4]
    path = maker.file(tmp_path, texts(np.degrees(shown), 3))
    corrected = correct_program(path, Sagging(robot), frames=FRAMES, options=JOINTS)
    written = np.radians(maker.read(after(corrected)))
    written[:, 5] -= 0.25 * written[:, 4]
    written[:, 4] += 0.125 * written[:, 3]
    written[:, 2] += 0.5 * written[:, 1]
    for angles, target, outcome in zip(written, q, corrected.targets, strict=True):
        command, wanted = ((forward(robot, one) @ TOOL)[:3, 3] for one in (angles, target))
        miss = np.linalg.norm(command + Sagging(robot).error(command) - wanted)
        assert miss < 4 * np.radians(max(maker.step, 1e-3)) * 2500
        assert outcome.verdict == "correct"


def test_an_arm_of_seven_joints_or_none_is_refused(tmp_path: Path) -> None:
    maker = MAKERS["kuka"]
    path = maker.file(tmp_path, texts(maker.some(1, 9)))
    arm = maker.robot
    seven = replace(
        arm, name="seven", alpha=np.append(arm.alpha, 0.5), a=np.append(arm.a, 0.0), d=np.append(arm.d, 50.0),
        offset=np.append(arm.offset, 0.0), beta=np.append(arm.beta, 0.0), sign=np.append(arm.sign, 1),
        limits=np.vstack([arm.limits, [-2.0, 2.0]]),
    )  # fmt: skip
    with pytest.raises(RefusedError, match="joint target: it has 6 joints, seven has 7"):
        correct_program(path, Sagging(seven), frames=FRAMES, options=JOINTS, other_maker=True)
    without = Sagging(arm)
    del without.robot
    with pytest.raises(RefusedError, match="joint target: the map knows no robot"):
        correct_program(path, without, frames=FRAMES, options=JOINTS)


def test_an_arm_of_another_maker_is_refused(tmp_path: Path) -> None:
    """Its zero and senses are its own maker's; without a maker the robot's file states those of the controller."""
    maker = MAKERS["kuka"]
    path = maker.file(tmp_path, texts(maker.some(1, 15)))
    other = replace(maker.robot, maker="ABB")
    with pytest.raises(RefusedError, match="of ABB counts its joints as a controller of KUKA is not known"):
        correct_program(path, Sagging(other), frames=FRAMES, options=JOINTS, other_maker=True)
    none = correct_program(path, Sagging(replace(maker.robot, maker="")), frames=FRAMES, options=JOINTS)
    assert none.coverage.corrected == 1
    assert "names no maker" in " ".join(none.warnings)


@pytest.mark.parametrize("maker", ["kuka", "abb", "fanuc"])
def test_an_external_axis_away_from_zero_is_refused_unless_allowed(tmp_path: Path, maker: str) -> None:
    kind = MAKERS[maker]
    path = kind.file(tmp_path, texts(kind.some(1, 10)))
    old, new = {
        "kuka": (b"E1 0.0", b"E1 -12.5"),
        "abb": (b"[9E9,9E9", b"[350.25,9E9"),
        "fanuc": (b" deg\n}", b" deg,\n\tE1=   120.000  mm\n}"),
    }[maker]
    path.write_bytes(path.read_bytes().replace(old, new))
    (target,) = read_program(path, FRAMES, JOINTS).targets
    assert target.verdict == "refuse"
    assert "external axis" in target.reason
    corrected = correct(path, kind, options=replace(JOINTS, external_axes=True))
    assert corrected.coverage.corrected == 1
    assert new in after(corrected)


@ALL
def test_coarse_digits_leave_a_target_nominal(tmp_path: Path, maker: Maker) -> None:
    """A correction of less than the digits can hold is left out; that is no reason to refuse the program."""
    path = maker.file(tmp_path, texts(maker.some(3, 11)))
    with pytest.MonkeyPatch.context() as patch:
        for module in ("krl.points.KUKA", "rapid.data.ABB", "tp.positions.FANUC"):
            patch.setattr(f"truepose.programs.{module}", in_degrees(0.1, ground=maker.coupled))
        corrected = correct(path, maker, scale=0.2, on_guard="refuse")
    assert {t.verdict for t in corrected.targets} == {"skip"}
    assert all("digits are too coarse" in t.reason for t in corrected.targets)
    assert after(corrected) == path.read_bytes()


@ALL
def test_the_record_tells_joints_and_what_remains(tmp_path: Path, maker: Maker) -> None:
    path = maker.file(tmp_path, texts(maker.some(2, 12)))
    corrected = correct(path, maker)
    told, written = maker.read(path.read_bytes()), maker.read(after(corrected))
    record = corrected.to_dict()
    assert record["summary"]["joint_targets"] == 2
    assert record["summary"]["largest_remaining_mm"] == max(t.remaining for t in corrected.targets)
    rows = list(csv.DictReader(io.StringIO(corrected.to_csv())))
    for before, now, entry, row in zip(told, written, record["targets"], rows, strict=True):
        np.testing.assert_allclose(entry["joints"], before, atol=1e-9)
        np.testing.assert_allclose(entry["joints_after"], now, atol=1e-9)
        assert (entry["joint_unit"], entry["frame"]) == ("deg", "")
        np.testing.assert_allclose(entry["before_mm"], maker.tool(before), atol=2e-6)
        np.testing.assert_allclose(entry["after_mm"], maker.tool(now), atol=2e-6)
        np.testing.assert_allclose([float(row[f"joint{j}_after"]) for j in range(1, 7)], now, atol=1e-9)
        assert float(row["remaining_mm"]) == entry["remaining_mm"] < 0.05


@ALL
def test_orientation_is_corrected_too(tmp_path: Path, maker: Maker) -> None:
    class Turning(Sagging):
        def correct(self, poses: np.ndarray, **more: Any) -> Any:
            answer = super().correct(poses, **more)
            answer.rotation = np.tile([4e-4, -3e-4, 2e-4], (len(poses), 1))
            return answer

    path = maker.file(tmp_path, texts(maker.some(4, 13)))
    corrected = correct_program(path, Turning(maker.robot), frames=FRAMES, options=JOINTS, orientation=True)
    for before, now in zip(maker.read(path.read_bytes()), maker.read(after(corrected)), strict=True):
        old, new = (forward(maker.robot, maker.joints(row))[:3, :3] for row in (before, now))
        turn = new @ old.T
        vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        np.testing.assert_allclose(vector, [4e-4, -3e-4, 2e-4], atol=4 * np.radians(maker.step))


@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_joints_any_digits(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever the digits: nothing but joints changes, by less than what the error asks for and half a digit each."""
    maker = data.draw(st.sampled_from(list(MAKERS.values())))
    numbers = maker.some(data.draw(st.integers(1, 4)), data.draw(st.integers(0, 10**6)))
    most = 3 if maker.coupled else 9
    rows = [[f"{value:.{data.draw(st.integers(0, most))}f}" for value in row] for row in numbers]
    path = maker.file(tmp_path, rows)
    scale = data.draw(st.sampled_from([0.0, 0.3, -2.0, 6.0]))
    corrected = correct(path, maker, scale=scale, on_guard="skip")
    written = maker.read(after(corrected))
    blank = re.compile(rb"[ ]*-?\d*\.?\d+(?=[, \]}])")
    assert blank.sub(b"#", after(corrected)) == blank.sub(b"#", path.read_bytes())
    errors = Sagging(maker.robot, scale)
    for told, now, outcome in zip(maker.read(path.read_bytes()), written, corrected.targets, strict=True):
        if outcome.verdict == "correct":
            command = maker.tool(now)
            miss = np.linalg.norm(command + errors.error(command) - maker.tool(told))
            assert miss <= outcome.remaining + 2e-4
        else:
            np.testing.assert_array_equal(told, now)


def test_pulses_are_whole_and_signed() -> None:
    form = in_pulses((1000.0, -500.0, 2000.0, 800.0, 800.0, 400.0))
    q = np.radians([[10.0, -20.0, 30.0, 0.0, -5.0, 1.0]])
    np.testing.assert_allclose(form.numbers(q), [[10000, 10000, 60000, 0, -4000, 400]])
    np.testing.assert_allclose(form.joints(form.numbers(q)), q)
    assert (form.unit, form.step, form.count) == ("pulse", 1.0, 6)


@pytest.mark.sampled(1)
@ALL
@pytest.mark.parametrize("count", [3, 2100], ids=["few", "many"])
def test_joint_targets_among_others(tmp_path: Path, maker: Maker, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions and joints in one program, also where runs of motions are read in parts."""
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "state"))
    path = maker.file(tmp_path, texts(maker.some(3, 17)))
    data = path.read_bytes()
    if maker.name.endswith(".src"):
        lines = "".join(f"LIN {{X {900 + k}.0,Y 0.0,Z 800.0,A 0.0,B 90.0,C 0.0}} C_DIS\r\n" for k in range(count))
        data = data.replace(b"$TOOL", b"$BASE=$NULLFRAME\r\n$TOOL").replace(b"END\r\n", f"{lines}END\r\n".encode())
    elif maker.name.endswith(".mod"):
        pose = "[[{}.0,0.0,800.0],[0.0,0.0,1.0,0.0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
        lines = "".join(f"    MoveL {pose.format(900 + k)},v100,z1,tGrip;\n" for k in range(count))
        data = data.replace(b"  ENDPROC", f"{lines}  ENDPROC".encode())
    else:
        axes = {"X": "{}.000  mm", "Y": "0.000  mm", "Z": "800.000  mm", "W": "180.000 deg", "P": "0.000 deg"}
        numbers = ",\t".join(f"{key} =   {value}" for key, value in {**axes, "R": "0.000 deg"}.items())
        head = "P[{}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\t"
        lines = "".join(f"{k + 4:4d}:L P[{k + 4}] 90mm/sec FINE    ;\n" for k in range(count))
        positions = "".join(head.format(k + 4) + numbers.format(900 + k) + "\n};\n" for k in range(count))
        data = data.replace(b"/POS\n", f"{lines}/POS\n".encode()).replace(b"/END", f"{positions}/END".encode())
    path.write_bytes(data)
    if count == 3:
        assert after(correct(path, maker, scale=0.0)) == data
    corrected = correct(path, maker)
    assert corrected.coverage == (count + 3, count + 3)
    assert corrected.summary()["joint_targets"] == 3
    told, written = maker.read(data), maker.read(after(corrected))
    assert ((told != written).any(axis=1)).all()
    assert len(corrected.to_dict()["targets"]) == count + 3
    for outcome in (t for t in corrected.targets[:: max(1, count // 50)] if t.target.xyz is not None):
        miss = outcome.p_after + Sagging(maker.robot).error(outcome.p_after) - outcome.p_before
        assert np.abs(miss).max() < 0.6e-3
    corrected.write(tmp_path / "out")
    copy = tmp_path / f"copy{path.suffix}"
    copy.write_bytes(after(corrected).replace(b"50", b"51", 1))
    with pytest.raises(RefusedError, match="that were corrected"):
        correct(copy, maker)
