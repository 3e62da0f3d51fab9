import numpy as np
import pytest

from truepose.compensation import Guards, Limits, Region, apply_policy


@pytest.fixture
def cube(rng):
    return rng.uniform(0, 1000, size=(300, 3))


def test_inside_is_free_and_outside_is_told(cube):
    reasons = Region(cube).reasons(np.array([[500.0, 500.0, 500.0], [500.0, 500.0, 1900.0]]), "mm")
    assert reasons[0] == ""
    assert "nearest sample" in reasons[1]
    assert "mm away, limit" in reasons[1]


def test_leverage_sees_what_the_bounding_box_does_not(rng):
    along = rng.uniform(-1, 1, size=(200, 1))
    diagonal = 1000 * along + rng.normal(scale=20.0, size=(200, 3))
    off_diagonal = np.array([[800.0, -800.0, 0.0]])
    assert (np.abs(off_diagonal) < np.abs(diagonal).max()).all()
    assert "leverage" in Region(diagonal, max_distance=5000.0).reasons(off_diagonal, "mm")[0]


def test_samples_themselves_are_inside(cube):
    assert not any(Region(cube).reasons(cube, "mm"))


def test_leverage_of_samples_sums_to_rank(cube):
    assert Region(cube).leverage(cube).sum() == pytest.approx(4.0)


def test_flat_samples_are_guarded_by_distance(rng):
    plane = np.c_[rng.uniform(0, 1000, size=(100, 2)), np.zeros(100)]
    assert "nearest sample" in Region(plane).reasons(np.array([[500.0, 500.0, 800.0]]), "mm")[0]


CORRECTION = np.array([[1.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, 2.0]])
REASONS = ["", "", "outside"]


@pytest.mark.parametrize("policy", ["refuse", "skip"])
def test_guarded_targets_stay_nominal(policy):
    share, verdict, reason = apply_policy(CORRECTION, REASONS, Limits(), policy)
    assert verdict.tolist() == ["correct", policy, policy]
    assert share.tolist() == [1.0, 0.0, 0.0]
    assert reason == ["", "correction of 8.000 mm is larger than the limit of 5 mm", "outside"]


def test_clip_shortens_only_what_is_too_long():
    share, verdict, _ = apply_policy(CORRECTION, REASONS, Limits(), "clip")
    assert verdict.tolist() == ["correct", "clip", "skip"]
    np.testing.assert_allclose(share, [1.0, 5 / 8, 0.0])


def test_length_is_no_second_reason():
    _, _, reason = apply_policy(9 * CORRECTION[:1], ["outside"], Limits(), "clip")
    assert reason == ["outside"]


def test_turns_are_limited_too():
    correction = np.array([[1.0, 0, 0, 0, 0.004, 0], [1.0, 0, 0, 0.02, 0, 0], [10.0, 0, 0, 0, 0, 0.03]])
    share, verdict, reason = apply_policy(correction, [""] * 3, Limits(), "clip")
    assert verdict.tolist() == ["correct", "clip", "clip"]
    np.testing.assert_allclose(share, [1.0, 0.5, 1 / 3])
    assert reason[1] == "correction of 20.000 mrad is larger than the limit of 10 mrad"


def test_uncertain_orientation_is_told(cube):
    guards = Guards(cube, np.ones((300, 3)), Limits(), np.zeros(3))
    std = np.array([[0.1, 0.1, 0.1, 1e-3, 0, 0], [0.1, 0.1, 0.1, 4e-3, 0, 0]])
    reasons = guards.reasons(cube[:2], "mm", std, np.ones(2, bool))
    assert reasons[0] == ""
    assert "of orientation of 4.00 mrad is above the limit of 3 mrad" in reasons[1]
