"""Whether a model holds: levels of the tests, their power, and the cause that is found."""

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.verification.consistency import check_consistency, drift, explanations, length_std

STD = 0.03


def correlated(n, rng):
    """Residuals of a covariance that ties all readings together."""
    half = rng.normal(scale=STD, size=(3 * n, 3 * n)) / np.sqrt(n)
    covariance = half @ half.T + STD**2 * np.eye(3 * n)
    return (np.linalg.cholesky(covariance) @ rng.normal(size=3 * n)).reshape(n, 3), covariance


def independent(n):
    return np.tile(STD**2 * np.eye(3), (n, 1, 1))


def test_a_model_that_holds_is_seldom_called_wrong(rng):
    found = [check_consistency(*correlated(10, rng)) for _ in range(300)]
    assert np.mean([h.p_chi_square < 0.05 for h in found]) == pytest.approx(0.05, abs=0.04)
    assert np.mean([h.p_white < 0.05 for h in found]) == pytest.approx(0.05, abs=0.04)
    assert sum(h.verdict != "holds" for h in found) < 12
    assert np.mean([h.ratio for h in found]) == pytest.approx(1.0, abs=0.05)


def test_both_forms_of_the_covariance_agree(rng):
    residual = rng.normal(scale=STD, size=(8, 3))
    a, b = check_consistency(residual, independent(8)), check_consistency(residual, STD**2 * np.eye(24))
    assert (a.n, a.far, a.verdict) == (b.n, b.far, b.verdict)
    assert (a.ratio, a.p_chi_square, a.p_white) == pytest.approx((b.ratio, b.p_chi_square, b.p_white))


def test_what_predictions_share_is_allowed_for(rng):
    """Where only variances are known, an error that all predictions have in common is no reason to doubt."""
    covariance = np.tile(2 * STD**2 * np.eye(3), (15, 1, 1))
    shared = np.full((15, 3), STD**2)
    found = [
        check_consistency(rng.normal(scale=STD, size=(15, 3)) + rng.normal(scale=STD, size=3), covariance, shared)
        for _ in range(300)
    ]
    assert np.mean([h.p_chi_square < 0.05 for h in found]) < 0.09
    assert np.mean([h.p_chi_square < 0.01 for h in found]) < 0.03
    assert check_consistency(rng.normal(scale=4 * STD, size=(15, 3)), covariance, shared).verdict == "does not hold"


@pytest.mark.parametrize("n", [10, 40])
def test_deviations_that_are_far_too_wide_do_not_hold(rng, n):
    """Three times too wide is told; margins as a map's own are not, nor is chance."""
    wide, covariance = rng.normal(scale=STD / 3, size=(n, 3)), independent(n)
    found = check_consistency(wide, covariance)
    assert (found.verdict, found.fails) == ("too cautious", False)
    assert found.to_dict()["p_wide"] < 1e-3
    margins = [check_consistency(rng.normal(scale=STD / 1.3, size=(n, 3)), covariance) for _ in range(200)]
    assert all(one.verdict != "too cautious" for one in margins)
    assert check_consistency(np.zeros((1, 3)) + 0.01 * STD, independent(1)).verdict == "too cautious"
    assert check_consistency(np.full((1, 3), 0.3 * STD), independent(1)).verdict == "holds"


def test_one_gross_reading_is_named(rng):
    residual = rng.normal(scale=STD, size=(20, 3))
    residual[7] += [0.0, 0.4, 0.0]
    found = check_consistency(residual, independent(20))
    assert found.verdict == "does not hold"
    assert found.far == [7]


def test_what_changes_slowly_is_not_white(rng):
    residual = 0.7 * STD * rng.normal(size=(60, 3)) + 0.7 * STD * np.sin(np.arange(60) / 10)[:, None]
    found = check_consistency(residual, independent(60))
    assert found.p_chi_square > 0.05
    assert found.p_white < 1e-3
    assert found.verdict != "holds"


def test_the_cause_is_found(rng):
    n = 12
    p = rng.uniform(-500, 500, size=(n, 3))
    lever = rng.normal(scale=1000, size=(n, 3, 1))
    causes = {"a shift": np.tile(np.eye(3), (n, 1, 1)), "a joint": lever, "growth": p[:, :, None]}
    residual = 2e-4 * lever[:, :, 0] + rng.normal(scale=STD, size=(n, 3))
    found = explanations(residual, independent(n), causes)
    assert found[0].cause == "a joint"
    assert abs(found[0].estimate[0] - 2e-4) < 4 * found[0].std[0] < 1e-4
    assert found[0].explained > 0.9
    assert found[0].p_left > 1e-3
    assert explanations(rng.normal(scale=STD, size=(n, 3)), independent(n), causes) == []


def test_drift_and_its_interval(rng):
    hours = np.sort(rng.uniform(0, 8, size=60))
    true = np.array([0.02, 0.0, -0.01])
    inside = []
    for _ in range(100):
        found = drift(hours[:, None] * true + rng.normal(scale=2 * STD, size=(60, 3)), independent(60), hours)
        inside.append(np.abs(found.slope - true) < 1.96 * found.std)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)  # also where the noise was stated too small
    none = [drift(rng.normal(scale=STD, size=(60, 3)), independent(60), hours).p_value < 0.05 for _ in range(300)]
    assert np.mean(none) == pytest.approx(0.05, abs=0.04)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: check_consistency(np.zeros((3, 2)), independent(3)), r"residuals \(3, 2\) and covariance \(3, 3, 3\)"),
        (lambda: check_consistency(np.zeros((3, 3)), 0 * independent(3)), "is not positive definite"),
        (lambda: drift(np.zeros((5, 3)), independent(5), np.ones(5)), "got 5 whose quantity changes by 0"),
    ],
)
def test_wrong_input(call, message):
    with pytest.raises(DataError, match=message):
        call()


def test_repr_has_the_verdict(rng):
    found = check_consistency(rng.normal(scale=4 * STD, size=(20, 3)), independent(20))
    assert repr(found).startswith("<ConsistencyTest: does not hold (p = ")
    assert "; 20 readings, " in repr(found)


def test_deviation_of_a_length_agrees_with_the_test_of_the_vector(rng):
    """Three components of 2 standard deviations each are 2 √3 of the length, as the χ² test has it."""
    slope, std = np.array([2.0, 2.0, 2.0]), np.ones(3)
    assert np.linalg.norm(slope) / length_std(slope, std) == pytest.approx(2.0 * np.sqrt(3.0))
    assert length_std(np.zeros(3), std) == pytest.approx(1.0)
    drawn = np.linalg.norm(np.array([30.0, 0.0, 40.0]) + rng.normal(0.0, [0.5, 0.1, 2.0], (4000, 3)), axis=1).std()
    assert length_std(np.array([30.0, 0.0, 40.0]), np.array([0.5, 0.1, 2.0])) == pytest.approx(drawn, rel=0.05)
