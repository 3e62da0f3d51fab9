"""What the second proof compares: every part of a target, and every number, alone."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from truepose.errors import RefusedError
from truepose.geometry import make_transform
from truepose.programs import Target, correct_program, proof
from truepose.programs.core.columns import ProgramTargets, TargetColumns
from truepose.programs.core.joint_targets import JointForm
from truepose.programs.core.target import Shifts

XYZ, ANGLES = (812.5, -40.25, 1033.0), (90.0, 10.0, -170.0)
SHIFTED = make_transform(np.eye(3), [1.0, 0.0, 0.0])
TARGET = Target(
    "P1", Path("a.src"), 7, ("LIN",), "correct", xyz=XYZ, angles=ANGLES, status=2, turn=10,
    tf_base_frame=np.eye(4), tf_flange_tool=np.eye(4),
)  # fmt: skip
JOINTS = Target("P2", Path("a.src"), 8, ("PTP",), "correct", joints=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
OTHER = {
    "name": "P9",
    "path": Path("b.src"),
    "line": 8,
    "motions": ("PTP",),
    "verdict": "skip",
    "frame": "BASE 2",
    "tool": "TOOL 2",
    "frame_number": 2,
    "tool_number": 2,
    "xyz": (812.5, -40.25, 1033.001),
    "angles": (90.0, 10.0, -170.0001),
    "controller": "fanuc",
    "tf_base_frame": SHIFTED,
    "tf_flange_tool": SHIFTED,
    "status": 3,
    "turn": 11,
    "configuration": "N U T",
    "unit": 1000.0,
    "joints": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    "joint_form": JointForm("deg", (1.0,) * 6, 0.001),
    "derived": (Shifts("one", "how", (), ((0.0, 0.0, 1.0),)),),
    "follows": ("P3",),
    "frame_changed": "line 3",
    "tool_changed": "line 4",
    "stands": "tool",
}
"""Another value of each attribute. A reason may differ: it names lines. Places of numbers move with their digits."""


def columns(*targets: Target) -> TargetColumns:
    ((_, found),) = ProgramTargets(targets).chunks()
    return found


def compare(old: Target, new: Target, after: Any = None, joints: Any = None) -> None:
    """Compare two readings of one target; `after` and `joints` are the numbers that were meant, NaN for no change."""
    meant = np.full((1, 6), np.nan) if after is None else np.array([after], float)
    joint = None if joints is None else SimpleNamespace(after=np.array([joints], float))
    proof._compare(SimpleNamespace(after=meant, joints=joint), 0, columns(old), columns(new))  # type: ignore[arg-type]


def test_each_attribute_has_another_value() -> None:
    assert {field.name for field in fields(Target)} - set(OTHER) == {"spans", "reason"}


@pytest.mark.parametrize("name", OTHER)
def test_a_target_that_differs_in_one_part_is_refused(name: str) -> None:
    """Whether it is there now or was there before."""
    other = replace(TARGET, **{name: OTHER[name]})  # type: ignore[arg-type]
    compare(TARGET, TARGET)
    compare(other, other)
    for old, new in ((TARGET, other), (other, TARGET)):
        with pytest.raises(RefusedError, match=rf"{old.where}: {old.name}: the corrected program reads otherwise: "):
            compare(old, new)


@pytest.mark.parametrize("axis", range(6))
def test_a_number_is_the_one_that_was_meant(axis: int) -> None:
    """Within 1e-9 where it was corrected, exactly where it was not; of positions and angles."""
    after = np.full(6, np.nan)
    after[axis] = 0.5
    for read, refused in ((0.5, False), (0.5 + 0.99e-9, False), (0.5 - 0.99e-9, False), (0.5 + 1.01e-9, True)):
        numbers = np.array([*XYZ, *ANGLES])
        numbers[axis] = read
        new = replace(TARGET, xyz=tuple(numbers[:3]), angles=tuple(numbers[3:]))
        if refused:
            with pytest.raises(RefusedError, match=rf"its {axis + 1}\. number reads 0\.5.*, 0\.5 was meant"):
                compare(TARGET, new, after)
        else:
            compare(TARGET, new, after)
    numbers = np.array([*XYZ, *ANGLES])
    numbers[axis] = np.nextafter(numbers[axis], np.inf)
    with pytest.raises(RefusedError, match=rf"its {axis + 1}\. number"):
        compare(TARGET, replace(TARGET, xyz=tuple(numbers[:3]), angles=tuple(numbers[3:])))


def test_numbers_that_are_lost_or_appear_are_refused() -> None:
    without = replace(TARGET, xyz=None, angles=None)
    compare(without, without)
    for old, new in ((TARGET, without), (without, TARGET)):
        with pytest.raises(RefusedError, match=r"its 1\. number reads"):
            compare(old, new)


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_is_the_one_that_was_meant(joint: int) -> None:
    compare(JOINTS, JOINTS)
    after = np.full(6, np.nan)
    after[joint] = 0.5
    for read, refused in ((0.5, False), (0.5 + 0.99e-9, False), (0.5 + 1.01e-9, True), (joint + 1.0, True)):
        new = replace(JOINTS, joints=tuple(np.where(np.arange(6) == joint, read, JOINTS.joints)))
        if refused:
            with pytest.raises(RefusedError, match=rf"P2: .*its {joint + 1}\. joint reads .*, 0\.5 was meant"):
                compare(JOINTS, new, joints=after)
        else:
            compare(JOINTS, new, joints=after)
    other = np.array(JOINTS.joints)
    other[joint] = np.nextafter(other[joint], np.inf)
    for meant in (None, np.full(6, np.nan)):
        with pytest.raises(RefusedError, match=rf"its {joint + 1}\. joint"):
            compare(JOINTS, replace(JOINTS, joints=tuple(other)), joints=meant)


def test_joints_that_are_lost_or_appear_are_refused() -> None:
    """All of them, or the last one."""
    none, five = replace(JOINTS, joints=None), replace(JOINTS, joints=JOINTS.joints[:5])  # type: ignore[index]
    for old, new in ((JOINTS, none), (none, JOINTS), (JOINTS, five), (five, JOINTS)):
        with pytest.raises(RefusedError, match=r"\. joint reads"):
            compare(old, new)
    compare(none, none)
    compare(five, five)


def test_a_difference_is_named_with_its_own_target() -> None:
    """Among others that agree, of another kind and of the same."""
    many = [replace(TARGET, name=f"P{k}", line=k, motions=("PTP" if k % 2 else "LIN",)) for k in range(6)]
    for name, value in (
        ("verdict", "skip"),
        ("name", "Q"),
        ("follows", ("P0",)),
        ("xyz", (0.0, 0.0, 0.0)),
        ("turn", 1),
    ):
        changed = [*many[:4], replace(many[4], **{name: value}), many[5]]  # type: ignore[arg-type]
        outcomes = SimpleNamespace(after=np.full((9, 6), np.nan), joints=None)
        with pytest.raises(RefusedError, match=r"a\.src:4: P4: "):
            proof._compare(outcomes, 3, columns(*many), columns(*changed))  # type: ignore[arg-type]


def test_the_meant_numbers_are_those_of_the_targets_compared() -> None:
    """Not those of the first ones of the program."""
    after = np.full((3, 6), np.nan)
    after[2, 0] = 0.5
    new = columns(replace(TARGET, xyz=(0.5, *XYZ[1:])))
    proof._compare(SimpleNamespace(after=after, joints=None), 2, columns(TARGET), new)  # type: ignore[arg-type]
    with pytest.raises(RefusedError, match=r"1\. number"):
        proof._compare(SimpleNamespace(after=after, joints=None), 1, columns(TARGET), new)  # type: ignore[arg-type]


@pytest.mark.parametrize("cuts", [([10], [10]), ([4, 6], [10]), ([10], [3, 3, 4]), ([4, 6], [3, 5, 2])])
def test_readings_in_parts_of_any_size_are_compared_side_by_side(cuts: Any) -> None:
    whole = columns(*[replace(TARGET, name=f"P{k}", line=k) for k in range(10)])

    def reading(sizes: list[int]) -> Any:
        starts = np.cumsum([0, *sizes])
        parts = [whole.take(np.arange(a, b)) for a, b in pairwise(starts.tolist())]
        return SimpleNamespace(chunks=lambda: iter([(0, part) for part in parts]))

    found = list(proof._side_by_side(*map(reading, cuts)))
    assert [first for first, _, _ in found] == np.cumsum([0, *(len(a) for _, a, _ in found)])[:-1].tolist()
    for old in (1, 2):
        assert [name for part in found for name in part[old].names] == [f"P{k}" for k in range(10)]


@pytest.mark.parametrize("what", ["circles", "follows", "count"])
def test_targets_joined_in_another_way_are_refused(pair: Any, make_map: Any, what: str) -> None:
    frame = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
    path = pair(f"DEF cell( )\n{frame}CIRC {{X 1,Y 2,Z 3,A 0,B 0,C 0}},{{X 4,Y 5,Z 6,A 0,B 0,C 0}}\nEND\n")
    corrected = correct_program(path, make_map([0.25, 0.0, 0.0]))
    outcomes = corrected.targets
    program = outcomes.program
    assert program.again is not None
    again = program.again()
    other = {
        "circles": replace(again, circles=()),
        "follows": replace(again, targets=ProgramTargets(again.targets, again.targets.motions, {0: ()})),  # type: ignore[dict-item]
        "count": replace(again, targets=ProgramTargets([*again.targets, TARGET])),
    }[what]
    outcomes = replace(outcomes, program=replace(program, again=lambda: other))
    with pytest.raises(RefusedError, match=r"reads otherwise \(\d targets in place of 2\)"):
        proof.prove_meaning(outcomes, corrected.files)
