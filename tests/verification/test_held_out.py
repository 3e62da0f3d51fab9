"""Held-out figures: intervals by groups, the ratio to the noise, coverage."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.robots import load_robot
from truepose.verification import RP_PER_STD, coverage, held_out, usual_groups
from truepose.verification.performance import pose_repeatability


@pytest.mark.exhaustive
def test_a_perfect_predictor_leaves_the_noise() -> None:
    rng = np.random.default_rng(1)
    std = np.array([0.02, 0.01, 0.03])
    noise = rng.normal(scale=std, size=(5000, 3))
    figures = held_out(10 * noise, noise, np.tile(std, (5000, 1)), noise=np.tile(std, (5000, 1)))
    assert figures.noise_floor["ratio"] == pytest.approx(1.0, abs=0.02)
    low, high = figures.noise_floor["ratio_interval_95"]
    assert low < 1.0 < high
    assert figures.coverage is not None
    assert figures.coverage.within_68 == pytest.approx(0.68, abs=0.01)
    assert figures.coverage.within_95 == pytest.approx(0.95, abs=0.01)
    assert figures.coverage.standardised_rms == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(figures.coverage.standardised_mean, 0.0, atol=0.05)
    as_covariance = held_out(noise, noise, noise=np.tile(np.diag(std**2), (5000, 1, 1)))
    assert as_covariance.noise_floor == figures.noise_floor
    assert set(held_out(noise, noise).to_dict()) >= {"before", "after", "intervals_95", "groups"}
    assert "noise_floor" not in held_out(noise, noise).to_dict()


def test_alike_groups_widen_the_interval() -> None:
    """Ten blocks whose errors differ: the mean of new blocks is far less certain than that of new poses."""
    rng = np.random.default_rng(2)
    block = np.repeat(np.arange(10), 50)
    after = (0.1 + 0.05 * block)[:, None] * rng.normal(size=(500, 3))
    figures = held_out(after, after, groups={"blocks": block, "single": np.arange(500)})
    by_pose, by_block = figures.accuracy.intervals["after_mean_mm"], figures.groups["blocks"]["interval_95_mean_mm"]
    assert np.ptp(by_block) > 3 * np.ptp(by_pose)
    assert np.ptp(figures.groups["single"]["interval_95_mean_mm"]) == pytest.approx(np.ptp(by_pose), rel=0.15)
    parts = figures.groups["blocks"]["parts"]
    assert [part["name"] for part in parts] == list("0123456789")
    assert [part["after"]["n"] for part in parts] == [50] * 10
    means = [part["after"]["mean_mm"] for part in parts]
    assert means == sorted(means)
    np.testing.assert_allclose(np.mean(means), figures.accuracy.after["mean_mm"])


@pytest.mark.parametrize("n", [2, 5, 9, 10])
def test_few_groups_give_no_interval(n: int) -> None:
    """Two branches or five blocks would give an interval that is a matter of luck."""
    after = np.random.default_rng(5).normal(size=(180, 3))
    figures = held_out(after, after, groups={"branches": np.arange(180) % n})
    assert (figures.groups["branches"]["interval_95_mean_mm"] is None) == (n < 10)
    assert len(figures.groups["branches"]["parts"]) == n
    assert (f"branches: {n} are too few for an interval; that by pose counts" in repr(figures)) == (n < 10)


def test_groups_that_poses_allow() -> None:
    rng = np.random.default_rng(3)
    robot = load_robot("kuka-kr210-r2700-extra")
    p = rng.uniform(-500, 500, (40, 3))
    q = np.tile(np.deg2rad([0.0, -75.0, 95.0, 0.0, 50.0, 0.0]), (40, 1)) + rng.uniform(-0.1, 0.1, (40, 6))
    assert set(usual_groups(p, q=q, robot=robot)) == {"blocks"}
    flipped = q.copy()
    flipped[::2, 4] *= -1.0
    groups = usual_groups(p, q=flipped, robot=robot, time=np.arange(40.0))
    assert np.unique(groups["branches"], return_counts=True)[1].tolist() == [20, 20]
    assert groups["time"].tolist() == np.repeat(np.arange(4), 10).tolist()
    assert len(np.unique(groups["blocks"])) == 6
    assert usual_groups(p[:5], time=np.arange(5.0)) == {}


def test_rp_per_std() -> None:
    p = np.random.default_rng(4).normal(size=(400_000, 3))
    assert pose_repeatability(p) == pytest.approx(RP_PER_STD, rel=5e-3)


def test_what_cannot_be_compared() -> None:
    e = np.ones((4, 3))
    with pytest.raises(
        DataError, match=r"noise has shape \(4,\); expected \(4, 3\) standard deviations or \(4, 3, 3\)"
    ):
        held_out(e, e, noise=np.ones(4))
    with pytest.raises(DataError, match=r"labels have shape \(3,\), expected \(4,\)"):
        held_out(e, e, groups={"blocks": np.arange(3)})
    with pytest.raises(DataError, match=r"residuals have shape \(4, 3\), their std \(4,\)"):
        coverage(e, np.ones(4))
    with pytest.raises(DataError, match=r"std of pose 2 is .* expected positive numbers"):
        coverage(e, np.ones((4, 3)) * [[1], [1], [0], [1]])


def test_repr_fits_a_screen(rng: np.random.Generator) -> None:
    e = rng.normal(size=(40, 3))
    groups = {"blocks": np.arange(40) // 4}
    shown = repr(held_out(10 * e, e, np.ones((40, 3)), noise=np.ones((40, 3)), groups=groups))
    assert shown.startswith("Accuracy of 40 poses [mm]\n")
    assert "noise floor: mean 1.596 mm; mean after is " in shown
    assert "mean after, blocks resampled: " in shown
    assert len(shown.splitlines()) == 9
    assert max(map(len, shown.splitlines())) < 80
