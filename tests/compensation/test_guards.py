import numpy as np
import pytest

from truepose.compensation import Region, apply_policy


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


TARGET = np.zeros((3, 3))
COMMAND = np.array([[1.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, 2.0]])
REASONS = ["", "", "outside"]


@pytest.mark.parametrize("policy", ["refuse", "skip"])
def test_guarded_targets_stay_nominal(policy):
    command, verdict, reason = apply_policy(TARGET, COMMAND, REASONS, 5.0, policy)
    assert verdict.tolist() == ["correct", policy, policy]
    np.testing.assert_array_equal(command, [[1.0, 0.0, 0.0], [0, 0, 0], [0, 0, 0]])
    assert reason == ["", "correction of 8.000 mm is larger than the limit of 5 mm", "outside"]


def test_clip_shortens_only_what_is_too_long():
    command, verdict, _ = apply_policy(TARGET, COMMAND, REASONS, 5.0, "clip")
    assert verdict.tolist() == ["correct", "clip", "skip"]
    np.testing.assert_allclose(command, [[1.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.0]])


def test_length_is_no_second_reason():
    _, _, reason = apply_policy(TARGET[:1], 9 * COMMAND[:1], ["outside"], 5.0, "clip")
    assert reason == ["outside"]
