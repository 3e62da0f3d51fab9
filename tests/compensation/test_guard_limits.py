"""Each guard at its limit and 1 % to both sides of it, at the default limits."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.compensation import BELOW, Guards, JointCoverage, Limits, Region, apply_policy

ALONG = np.array([[-100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
"""Three samples on a line. The leverage of x is 1/3 + x²/20000: at most 5/6 at a sample, so 1.25 is its limit."""
NEAR = Limits(max_distance=10.0)
TILT = np.array([0.6, 0.0, 0.8])


def asked(limits: Limits = NEAR, **target: Any) -> str:
    """Return the reason of one target; what is not given is that of a sample."""
    guards = Guards(ALONG, limits, np.array([0.0, 0.0, 100.0]), Rotation.identity(3), np.array([2, 2, 6]))
    given = {"x": ALONG[1:2], "unit": "mm", "std": np.zeros((1, 3)), "converged": np.ones(1, bool)} | target
    return guards.reasons(**given)[0]


def std(size: float) -> str:
    return asked(std=np.array([[0.0, 0.6 * size, 0.8 * size]]))


def rotation_std(size: float) -> str:
    return asked(std=np.array([[0.0, 0.0, 0.0, 0.6 * size, 0.0, 0.8 * size]]))


def distance(size: float) -> str:
    return asked(x=np.array([[100.0, size, 0.0]]))


def distance_by_default(size: float) -> str:
    """1.5 times the largest distance of a sample to its nearest neighbour, here 20 mm."""
    samples = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [25.0, 0.0, 0.0]])
    return Region(samples).reasons(np.array([[0.0, size, 0.0]]), "mm")[0]


def leverage(size: float) -> str:
    return asked(Limits(max_distance=1000.0), x=np.array([[np.sqrt(20000.0 * (size - 1.0 / 3.0)), 0.0, 0.0]]))


def joint_gap(size: float) -> str:
    """With the samples' first coordinate [rad] as the only joint, and a stated limit."""
    q = ALONG / 100.0
    guards = Guards(q, NEAR, np.zeros(3), coverage=JointCoverage(q, np.array([0]), np.array([1.0]), 0.25))
    return guards.reasons(np.array([[1.0 + size, 0.0, 0.0]]), "rad", np.zeros((1, 3)), np.ones(1, bool))[0]


def angle(size: float) -> str:
    return asked(rotation=Rotation.from_rotvec([size * TILT]))


def tool(size: float) -> str:
    return asked(p_flange_tool=np.array([[0.0, 0.6 * size, 100.0 + 0.8 * size]]))


def policy(correction: list[float], deviation: list[float]) -> tuple[str, str]:
    found = apply_policy(np.array([correction]), np.array([deviation]), [""], Limits(), "refuse")
    return str(found.verdict[0]), found.reason[0]


def length(size: float) -> str:
    return policy([0.6 * size, 0.0, 0.8 * size], [0.0] * 3)[1]


def rotation(size: float) -> str:
    return policy([1.0, 0.0, 0.0, 0.6 * size, 0.0, 0.8 * size], [0.0] * 6)[1]


class Guarded(NamedTuple):
    limit: float
    reason: Callable[[float], str]
    words: str


GUARDED = {
    "standard deviation": Guarded(0.25, std, r"^predicted standard deviation of 0\.25\d mm is above .* 0\.250 mm$"),
    "that of orientation": Guarded(0.003, rotation_std, r"^predicted .* of 3\.03 mrad is above the limit of 3 mrad$"),
    "distance": Guarded(10.0, distance, r"nearest sample 10\.1 mm away, limit 10 mm$"),
    "distance by default": Guarded(30.0, distance_by_default, r"nearest sample 30\.3 mm away, limit 30 mm$"),
    "leverage": Guarded(1.25, leverage, r"leverage 1\.3, limit 1\.2$"),
    "gap of a joint": Guarded(
        0.25, joint_gap, r"^no sample covers joint 1 at 71\.8°: .* 57\.3°, limit 14\.3°; measure"
    ),
    "angle": Guarded(np.deg2rad(20.0), angle, r"^orientation is 20\.2° from that of any sample, limit 20°$"),
    "tool": Guarded(50.0, tool, r"^tool point is 50\.5 mm from the measured one, limit 50 mm: measure with this tool$"),
    "length": Guarded(5.0, length, r"^correction of 5\.050 mm is larger than the limit of 5 mm$"),
    "rotation": Guarded(0.01, rotation, r"^correction of 10\.100 mrad is larger than the limit of 10 mrad$"),
}


@pytest.mark.parametrize("name", GUARDED)
def test_a_guard_refuses_beyond_its_limit_only(name: str) -> None:
    limit, reason, words = GUARDED[name]
    assert reason(0.0 if name != "leverage" else 1.0 / 3.0) == ""
    assert reason(0.99 * limit) == ""
    assert re.search(words, reason(1.01 * limit))


@pytest.mark.parametrize("name", ["standard deviation", "distance", "gap of a joint", "tool", "length"])
def test_the_limit_itself_is_allowed(name: str) -> None:
    """Of those that numbers can hold exactly."""
    assert GUARDED[name].reason(GUARDED[name].limit) == ""


@pytest.mark.parametrize("name", ["standard deviation", "that of orientation"])
def test_a_deviation_that_is_no_number_is_refused(name: str) -> None:
    assert "nan m" in GUARDED[name].reason(np.nan)


@pytest.mark.parametrize("axis", range(3))
def test_each_axis_of_a_deviation_counts(axis: int) -> None:
    assert asked(std=np.where(np.arange(3) == axis, 0.26, 0.0)[None]) != ""
    assert asked(std=np.where(np.arange(6) == 3 + axis, 0.0031, 0.0)[None]) != ""
    assert asked(std=np.where(np.arange(6) == axis, np.nan, 0.0)[None]) != ""


def test_the_deviation_of_orientation_is_none_of_position() -> None:
    assert asked(std=np.array([[0.24, 0.0, 0.0, 0.0029, 0.0, 0.0]])) == ""
    assert asked(replace(NEAR, max_rotation_std=1.0), std=np.array([[0.0, 0.0, 0.0, 0.9, 0.0, 0.0]])) == ""


def test_a_command_that_was_not_found_is_refused() -> None:
    assert asked(converged=np.zeros(1, bool)) == "no command was found whose predicted outcome is the target"


@pytest.mark.parametrize("status", range(-1, 16))
def test_an_arm_branch_without_samples_is_refused(status: int) -> None:
    """The samples have Status 2 and 6. Bits above the third do not name the branch; −1 is none that is given."""
    reason = asked(status=np.array([status]))
    if status < 0 or status % 8 in (2, 6):
        assert reason == ""
    else:
        assert reason == f"no sample was on arm branch (Status) {status % 8}, only on 2, 6"


def test_bits_of_samples_that_do_not_name_the_branch_do_not_count() -> None:
    guards = Guards(ALONG, NEAR, np.zeros(3), status=np.array([10, 26, 2]))
    reasons = guards.reasons(ALONG, "mm", np.zeros((3, 3)), np.ones(3, bool), status=np.array([2, 18, 1]))
    assert reasons == ["", "", "no sample was on arm branch (Status) 1, only on 2"]


def test_the_nearest_of_several_orientations_counts_and_neither_sign_of_its_quaternion() -> None:
    sampled = Rotation.from_rotvec(np.deg2rad([[0.0, 0.0, 0.0], [0.0, 0.0, 170.0], [0.0, 0.0, 60.0]]))
    guards = Guards(ALONG, NEAR, np.zeros(3), sampled)
    asked = Rotation.from_rotvec(np.deg2rad([[0.0, 0.0, -171.0], [0.0, 0.0, 79.8], [0.0, 0.0, 80.2]]))
    reasons = guards.reasons(ALONG, "mm", np.zeros((3, 3)), np.ones(3, bool), asked)
    assert reasons == ["", "", "orientation is 20.2° from that of any sample, limit 20°"]


def test_the_first_reason_stays() -> None:
    """Those of the region come first, then the gap, the deviations, the command, orientation, tool and branch."""
    bad = {
        "x": np.array([[0.0, 11.0, 0.0]]),
        "std": np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]]),
        "converged": np.zeros(1, bool),
        "rotation": Rotation.from_rotvec([[1.0, 0.0, 0.0]]),
        "p_flange_tool": np.zeros((1, 3)),
        "status": np.array([1]),
    }
    words = ["nearest sample", "standard deviation of 1", "no command", "orientation is", "tool point", "arm branch"]
    given, found = dict(bad), []
    for name in bad:
        found.append(asked(**given))
        del given[name]
    assert [word in reason for word, reason in zip(words, found, strict=True)] == [True] * 6


@pytest.mark.parametrize("share", [0.99, 1.0, 1.01])
def test_a_correction_stays_out_below_twice_its_deviation_only(share: float) -> None:
    verdict, reason = policy([0.5 * share, 0.0, 0.0], [0.0, 0.25, 0.0])
    assert verdict == ("correct" if share >= 1.0 else BELOW)
    assert (reason == "") == (share >= 1.0)


@pytest.mark.parametrize(("mm", "mrad"), [(0.99, 0.99), (0.99, 1.01), (1.01, 0.99), (1.01, 1.01)])
def test_a_pose_stays_out_only_if_both_parts_are_below(mm: float, mrad: float) -> None:
    verdict, _ = policy([0.5 * mm, 0.0, 0.0, 0.0, 0.002 * mrad, 0.0], [0.25, 0.0, 0.0, 0.0, 0.0, 0.001])
    assert verdict == (BELOW if max(mm, mrad) < 1.0 else "correct")


@pytest.mark.parametrize("size", [4.95, 5.0, 5.05])
def test_clip_shortens_beyond_the_limit_only(size: float) -> None:
    share, verdict, _ = apply_policy(np.array([[size, 0.0, 0.0]]), np.zeros((1, 3)), [""], Limits(), "clip")
    assert share[0] == pytest.approx(min(1.0, 5.0 / size))
    assert verdict[0] == ("clip" if size > 5.0 else "correct")


def test_a_clipped_correction_is_not_compared_with_its_deviation() -> None:
    found = apply_policy(np.array([[6.0, 0.0, 0.0]]), np.full((1, 3), 9.0), [""], Limits(), "clip")
    assert (found.verdict[0], found.share[0]) == ("clip", pytest.approx(5.0 / 6.0))
