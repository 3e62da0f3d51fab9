import numpy as np
import pytest

from truepose.errors import DataError
from truepose.predictors.folds import block_folds, branch_folds, point_folds, random_folds, split_samples
from truepose.robots import load_robot


def test_random_folds_are_of_equal_size():
    fold = random_folds(103, 5)
    assert sorted(np.bincount(fold)) == [20, 20, 21, 21, 21]
    np.testing.assert_array_equal(fold, random_folds(103, 5))


def test_blocks_are_compact(rng):
    x = rng.uniform(size=(400, 3)) * [2000.0, 1000.0, 500.0]
    fold = block_folds(x, 5)
    assert sorted(np.bincount(fold)) == [80, 80, 80, 80, 80]
    within = np.mean([x[fold == k].var(axis=0) / x.var(axis=0) for k in range(5)])
    assert within < 0.6  # random folds have 1


def test_one_place_has_no_blocks():
    assert set(block_folds(np.zeros((10, 3)), 5)) == set(range(5))


@pytest.mark.parametrize(("n", "folds"), [(3, 4), (10, 1)])
def test_impossible_folds(n, folds):
    with pytest.raises(DataError, match="folds of"):
        random_folds(n, folds)


def test_repeats_stay_together(rng):
    x = rng.uniform(size=(60, 3))
    x = np.concatenate([x, x[:20] + 1e-5])
    fold = point_folds(x, 5)
    np.testing.assert_array_equal(fold[60:], fold[:20])
    assert set(fold) == set(range(5))


@pytest.mark.parametrize("name", ["kuka-kr210-r2700-extra", "universal-robots-ur10"])
def test_branches_are_those_of_the_inverse(name, rng):
    robot = load_robot(name)
    q = rng.uniform(-0.2, 0.2, (20, 6)) + np.deg2rad([10.0, -80.0, 80.0, 20.0, 50.0, 30.0])
    every = robot.inverse(robot.forward(q))
    other = next(slot for slot in range(8) if np.isfinite(every[:, slot]).all() and np.ptp(every[:, slot] - q) > 0.5)
    turned = every[:, other] + 2 * np.pi * np.array([0, 0, 0, 0, 0, 1])  # a full turn is no branch
    fold = branch_folds(robot, np.concatenate([q, turned]))
    assert len(set(fold[:20])) == len(set(fold[20:])) == 1
    assert fold[0] != fold[20]
    with pytest.raises(DataError, match=r'on one branch of the arm; take "blocks" or "points"'):
        branch_folds(robot, q)


def test_splits_by_name(rng):
    x = rng.uniform(size=(40, 3))
    found = split_samples(["blocks", "points"], {"cartesian": x}, folds=4)
    assert list(found) == ["blocks", "points"]
    np.testing.assert_array_equal(found["blocks"], block_folds(x, 4))
