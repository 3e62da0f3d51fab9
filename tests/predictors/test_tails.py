"""Heavy tails of the readings are told from errors of the arm that differ from pose to pose."""

from __future__ import annotations

import numpy as np

from truepose.predictors.tails import Tails, tails

N, FIELD, NUGGET, READING = 80, 0.01, 0.02, 0.03


def found(heavy: bool, seed: int, repeat: float = NUGGET) -> Tails:
    """Return the tails of readings with a field, noise of the arm, and noise of the readings that is normal or t3."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(scale=READING, size=(N, 3))
    if heavy:
        noise /= np.sqrt(rng.chisquare(3, (N, 1)) / 3)
    residual = noise + rng.normal(scale=FIELD, size=(N, 3)) + rng.normal(scale=repeat, size=(N, 3))
    excess = max(float(np.mean(residual**2)) - FIELD**2 - READING**2, 1e-6)  # as a fit with normal noise finds it
    return tails(residual, np.tile(FIELD**2 * np.eye(3), (N, 1, 1)), excess, np.full(N, READING))


def test_heavy_tails_leave_the_nugget_of_the_arm() -> None:
    """Where they are seen: a sample of 80 readings of t3 may have no far one."""
    every = [found(True, seed) for seed in range(12)]
    heavy = [one for one in every if one != Tails()]
    assert len(heavy) >= 10
    assert all(one.factor > 1.2 and one.share < 0.8 for one in heavy)


def test_normal_noise_of_readings_and_of_the_arm_is_normal() -> None:
    for seed in range(20):
        assert found(False, seed) == Tails()
        assert found(False, seed, repeat=0.1) == Tails()
