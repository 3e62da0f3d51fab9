import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from truepose.compensation import BELOW, Corrections, Guards, Limits, Region, apply_policy, supported_angle
from truepose.compensation.orientations import orientation_blocks


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
NO_STD = np.zeros((3, 3))


@pytest.mark.parametrize("policy", ["refuse", "skip"])
def test_guarded_targets_stay_nominal(policy):
    share, verdict, reason = apply_policy(CORRECTION, NO_STD, REASONS, Limits(), policy)
    assert verdict.tolist() == ["correct", policy, policy]
    assert share.tolist() == [1.0, 0.0, 0.0]
    assert reason == ["", "correction of 8.000 mm is larger than the limit of 5 mm", "outside"]


def test_clip_shortens_only_what_is_too_long():
    share, verdict, _ = apply_policy(CORRECTION, NO_STD, REASONS, Limits(), "clip")
    assert verdict.tolist() == ["correct", "clip", "skip"]
    np.testing.assert_allclose(share, [1.0, 5 / 8, 0.0])


def test_length_is_no_second_reason():
    _, _, reason = apply_policy(9 * CORRECTION[:1], NO_STD[:1], ["outside"], Limits(), "clip")
    assert reason == ["outside"]


def test_turns_are_limited_too():
    correction = np.array([[1.0, 0, 0, 0, 0.004, 0], [1.0, 0, 0, 0.02, 0, 0], [10.0, 0, 0, 0, 0, 0.03]])
    share, verdict, reason = apply_policy(correction, np.zeros((3, 6)), [""] * 3, Limits(), "clip")
    assert verdict.tolist() == ["correct", "clip", "clip"]
    np.testing.assert_allclose(share, [1.0, 0.5, 1 / 3])
    assert reason[1] == "correction of 20.000 mrad is larger than the limit of 10 mrad"


def test_uncertain_orientation_is_told(cube):
    guards = Guards(cube, Limits(), np.zeros(3))
    std = np.array([[0.1, 0.1, 0.1, 1e-3, 0, 0], [0.1, 0.1, 0.1, 4e-3, 0, 0]])
    reasons = guards.reasons(cube[:2], "mm", std, np.ones(2, bool))
    assert reasons[0] == ""
    assert "of orientation of 4.00 mrad is above the limit of 3 mrad" in reasons[1]


@pytest.mark.promise("A correction smaller than twice its standard deviation is not applied, and refuses no program.")
@pytest.mark.parametrize("policy", ["refuse", "skip", "clip"])
def test_a_correction_below_its_deviation_is_not_applied(policy, record_property):
    correction = np.array([[0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.2, 0.0, 0.0]])
    std = np.array([[0.05, 0.05, 0.05], [0.06, 0.06, 0.06], [0.06, 0.06, 0.06]])
    share, verdict, reason = apply_policy(correction, std, ["", "", "outside"], Limits(), policy)
    assert verdict.tolist() == ["correct", BELOW, "skip" if policy == "clip" else policy]
    assert share.tolist() == [1.0, 0.0, 0.0]
    assert reason[1] == "correction of 0.200 mm is smaller than 2 times its standard deviation of 0.104 mm"
    once = Limits(min_correction_stds=1.0)
    assert apply_policy(correction / 2, std, [""] * 3, once, policy)[1].tolist() == ["correct", BELOW, BELOW]
    assert "smaller than its" in apply_policy(correction / 2, std, [""] * 3, once, policy)[2][1]
    never = Limits(min_correction_stds=0.0)
    assert apply_policy(correction, std, [""] * 3, never, policy)[1].tolist() == ["correct"] * 3
    record_property("cases", 9)


@pytest.mark.promise("A correction at the limit moves its target away in 4 % of cases, if its deviation is right.")
def test_the_smallest_correction_seldom_moves_a_target_away(rng, record_property):
    std, n = 0.1, 200_000
    predicted = np.array([0.0, 0.0, Limits().min_correction_stds * np.sqrt(3.0) * std])
    error = predicted + std * rng.standard_normal((n, 3))
    worse = np.linalg.norm(error - predicted, axis=1) > np.linalg.norm(error, axis=1)
    assert worse.mean() == pytest.approx(norm.cdf(-np.sqrt(3.0)), abs=4 * np.sqrt(0.042 / n))
    record_property("cases", 1)


def test_a_pose_stays_nominal_only_if_its_turn_is_below_as_well():
    correction = np.array([[0.1, 0, 0, 1e-3, 0, 0], [0.1, 0, 0, 1e-4, 0, 0]])
    std = np.array([[0.2, 0, 0, 5e-4, 0, 0]] * 2)
    assert apply_policy(correction, std, ["", ""], Limits(), "refuse")[1].tolist() == ["correct", BELOW]


def turned(*degrees):
    return Rotation.from_rotvec(np.deg2rad(degrees)[:, None] * [0.0, 1.0, 0.0])


def test_orientations_fall_into_blocks(rng):
    assert orientation_blocks(turned(0, 0.5, 10, 10.5, 0.1)).tolist() == [0, 0, 1, 1, 0]
    many = orientation_blocks(Rotation.from_rotvec(np.deg2rad(rng.uniform(-15, 15, (200, 3)))))
    assert len(np.unique(many)) == 10
    assert np.bincount(many).min() >= 3


@pytest.mark.promise("A Cartesian map accepts only orientations that its samples, predicted from others, support.")
def test_the_angle_is_what_residuals_from_other_orientations_support(rng, record_property):
    rotation = turned(*np.repeat([0.0, 4.0, 12.0, 30.0], 20))
    noise = rng.normal(size=(80, 3))

    def supported(size_by_group):
        size = np.repeat(size_by_group, 20)[:, None]
        return np.rad2deg(supported_angle(lambda _: (size * noise, np.ones((80, 3))), rotation))

    cases = {(1, 1, 1, 1): 18.0, (1, 1, 1, 3): 8.0, (1, 1, 3, 1): 4.0, (3, 3, 1, 1): 2.0}
    for sizes, angle in cases.items():
        assert supported(sizes) == pytest.approx(angle)
    one = np.rad2deg(supported_angle(lambda _: pytest.fail("nothing to compare"), turned(*np.zeros(30))))
    assert one == pytest.approx(2.0)
    record_property("cases", len(cases) + 1)


def test_repr_counts_verdicts():
    p, verdict = np.zeros((3, 3)), np.array(["correct", "refuse", "correct"])
    moved = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    found = Corrections(p, moved, moved, -moved, np.ones((3, 3)), verdict, ["", "outside", ""])
    expected = "<Corrections of 3 targets: 2 correct, 1 refuse; lengths have mean 0.200 mm, max 0.300 mm>"
    assert repr(found) == expected
