import numpy as np
import pytest

from truepose.errors import DataError
from truepose.verification import accuracy, coverage, mean_noise, summary


def test_summary_by_hand():
    figures = summary([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0], [0.0, 3.0, 0.0]])
    assert figures == pytest.approx(
        {"n": 3, "mean_mm": 3.0, "rms_mm": np.sqrt(35 / 3), "std_mm": 2.0, "p95_mm": 4.8, "max_mm": 5.0}
    )


def test_one_component():
    assert summary([-2.0, 1.0])["max_mm"] == 2.0


def test_reduction_and_axes(rng):
    before = rng.normal(size=(50, 3))
    figures = accuracy(before, 0.2 * before)
    assert figures.reduction_mean_percent == pytest.approx(80.0)
    assert figures.reduction_max_percent == pytest.approx(80.0)
    assert figures.axes["y"]["after"]["max_mm"] == pytest.approx(0.2 * np.abs(before[:, 1]).max())
    assert figures.intervals["reduction_mean_percent"] == pytest.approx((80.0, 80.0))


@pytest.mark.exhaustive
def test_interval_covers_the_true_mean():
    """In 200 repetitions the 95 % interval of the mean holds the true mean 95 % of the time, within chance."""
    held = 0
    true_mean = np.sqrt(8 / np.pi)  # of the length of a standard normal vector in 3-D
    for seed in range(200):
        e = np.random.default_rng(seed).normal(size=(60, 3))
        low, high = accuracy(e, e, rng=seed).intervals["after_mean_mm"]
        held += low <= true_mean <= high
    assert 180 <= held <= 198


def test_same_seed_same_intervals(rng):
    before, after = rng.normal(size=(2, 30, 3))
    assert accuracy(before, after).intervals == accuracy(before, after).intervals


def test_nothing_to_reduce():
    assert accuracy(np.zeros((2, 3)), np.zeros((2, 3))).reduction_max_percent == 0.0


def test_different_poses_are_refused():
    with pytest.raises(DataError, match=r"before has shape \(2, 3\), after \(3, 3\)"):
        accuracy(np.zeros((2, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize(("e", "message"), [([], "n > 0"), ([[0.0, np.nan, 0.0]], "error 0 is not finite")])
def test_bad_errors_are_refused(e, message):
    with pytest.raises(DataError, match=message):
        summary(e)


def test_coverage_of_an_honest_predictor(rng):
    std = rng.uniform(0.1, 2.0, size=(20_000, 3))
    found = coverage(std * rng.normal(size=std.shape), std)
    assert found.within_68 == pytest.approx(0.68, abs=0.01)
    assert found.within_95 == pytest.approx(0.95, abs=0.005)
    assert found.standardised_rms == pytest.approx(1.0, abs=0.01)


def test_mean_noise_is_the_mean_length_of_draws():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    drawn = np.linalg.norm(rng.multivariate_normal(np.zeros(3), covariance, size=400_000), axis=1).mean()
    assert mean_noise([covariance])[0] == pytest.approx(drawn, rel=5e-3)


def test_mean_noise_in_one_and_three_directions():
    """√(2/π) σ on a line, 2 √(2/π) σ in space: half-normal and Maxwell distributions."""
    line, space = np.diag([0.0, 4.0, 0.0]), 4.0 * np.eye(3)
    np.testing.assert_allclose(mean_noise([line, space]), np.sqrt(2 / np.pi) * np.array([2.0, 4.0]))


def test_mean_noise_of_no_covariance():
    with pytest.raises(DataError, match=r"covariance has shape \(3, 3\); expected"):
        mean_noise(np.eye(3))
    with pytest.raises(DataError, match="negative eigenvalue"):
        mean_noise([np.diag([1.0, 1.0, -1.0])])
