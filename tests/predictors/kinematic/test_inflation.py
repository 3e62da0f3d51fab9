"""The factor of predicted variances, computed by hand; residuals of fits without a fold are given where it says so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.geometry import make_transform
from truepose.predictors.folds import random_folds
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kinematic import inflation as module
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.inflation import Part, inflation
from truepose.robots import load_robot

K = 6
START: Any = SimpleNamespace(hyper=SimpleNamespace(to_vector=lambda: np.zeros(K)))


def part(n: int, *, visit: Any = None, turn: Any = None, reading: float = 0.0) -> Part:
    q = np.arange(n, dtype=float)[:, None] if visit is None else np.asarray(visit, float)[:, None]
    visit = np.full(n, np.nan) if visit is None else np.asarray(visit, float)
    turn = np.zeros(n) if turn is None else np.asarray(turn, float)
    empty = np.zeros((n, 1))
    design = Design(q, *[empty] * 7, visit, turn)
    return Part(None, design, np.arange(1), np.zeros((n, 3)), np.full((n, 3), reading), np.ones(n))  # type: ignore[arg-type]


def found(samples: Part, squared: Any = 1.0, seed: int = 0) -> float:
    """Return the factor, with the square of the standardised leave-one-out residuals."""
    n = len(samples.e)
    residual = 0.1 * np.sqrt(np.broadcast_to(np.reshape(squared, (-1, 1)), (n, 3)))
    return inflation(samples, residual, np.tile(0.01 * np.eye(3), (n, 1, 1)), START, seed)


@pytest.fixture
def folds(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Give residuals and variances of fits without a fold; return the numbers of samples that were asked for."""
    asked: list[int] = []

    def give(squared: Any, variance: float) -> list[int]:
        def fold_residuals(some: Part, start: Any, seed: int) -> tuple[np.ndarray, np.ndarray]:
            asked.append(len(some.e))
            shape = some.e.shape
            return np.sqrt(np.broadcast_to(np.reshape(squared, (-1, 1)), shape)), np.full(shape, variance)

        monkeypatch.setattr(module, "fold_residuals", fold_residuals)
        return asked

    return give


def near(factor: float) -> Any:
    return pytest.approx(factor, rel=1e-12)


def test_it_is_the_factor_of_the_folds_with_what_more_samples_make_of_it(folds: Any) -> None:
    """Residuals of 4 mm² from variances of 2 mm² and readings of 1 mm²: (4 − 1)/2 = 1.5, with 4/5 of the samples."""
    folds(4.0, 2.0)
    assert found(part(12, reading=1.0)) == near(1.4)


@pytest.mark.parametrize(("squared", "alone"), [(0.5, 1.0), (1.0, 1.0), (2.0, 2.0)])
def test_it_is_at_least_that_of_leave_one_out_with_its_degrees_of_freedom(
    folds: Any, squared: float, alone: float
) -> None:
    folds(0.1, 1.0)
    assert found(part(12), squared) == near(alone * 36 / (36 - K))


def test_few_samples_count_alone_and_hyperparameters_take_no_more_than_two_thirds() -> None:
    assert found(part(5), 2.0) == pytest.approx(2.0 * 15 / (15 - K))
    assert found(part(2), 2.0) == pytest.approx(2.0 * 6 / 2)


def test_six_samples_are_enough_for_folds(folds: Any) -> None:
    folds(4.0, 1.0)
    assert found(part(6)) == near(3.4)


def test_rows_of_orientation_do_not_count(folds: Any) -> None:
    """Whose residuals are 100 times as large, in the folds and of leave-one-out."""
    turn = np.arange(12) % 2
    folds(np.where(turn, 400.0, 4.0), 1.0)
    assert found(part(12, turn=turn), np.where(turn, 300.0, 3.0)) == near(3.0 * 18 / (18 - K))


def test_of_many_samples_250_make_the_folds_and_350_the_degrees_of_freedom(folds: Any) -> None:
    asked = folds(0.1, 1.0)
    assert found(part(400), 2.0) == near(2.0 * 1050 / (1050 - K))
    assert asked == [250]


def test_fits_with_200_of_350_samples_show_more_than_the_search_of_all(folds: Any) -> None:
    folds(4.0, 1.0)
    assert found(part(400)) == near(1.0 + 3.0 * 200 / 350)


def test_a_fold_is_predicted_from_the_others_with_their_hyperparameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a fit of the others, but for terms of second order, with the noise of the readings and the weights."""
    rng = np.random.default_rng(3)
    robot, tool = load_robot("kuka-kr210-r2700-extra"), make_transform(Rotation.identity(), [110.0, 20.0, 360.0])
    q = np.deg2rad([0, -75, 95, 10, 50, 20]) + rng.uniform(-0.5, 0.5, (25, 6))
    e, reading, weight = rng.normal(scale=0.2, size=(25, 3)), rng.uniform(0.01, 0.05, (25, 3)), rng.uniform(0.1, 1, 25)
    hyper = Hyperparameters.start(6, 6, noise=0.02)

    def fitted(rows: Any) -> KinematicKriging:
        model = KinematicKriging(robot, tool, hyper=hyper.to_dict(), weight=weight[rows], joints=range(6))
        return model.fit(q[rows], e[rows], noise_std=reading[rows])

    whole = fitted(slice(None))
    samples = Part(whole._terms, whole._terms.at(q), np.arange(6), e, reading, weight)
    monkeypatch.setattr(module, "search_near", lambda *_, **__: (SimpleNamespace(hyper=hyper),))
    residual, variance = module.fold_residuals(samples, START, 7)
    fold = random_folds(25, 5, rng=7)
    for k in range(5):
        mean, std = fitted(fold != k).predict(q[fold == k], return_std=True)
        np.testing.assert_allclose(residual[fold == k], e[fold == k] - mean, atol=2e-3)
        np.testing.assert_allclose(variance[fold == k], std**2 + hyper.noise**2, rtol=1e-2)
