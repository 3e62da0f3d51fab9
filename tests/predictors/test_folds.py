import numpy as np
import pytest

from truepose.errors import DataError
from truepose.predictors.folds import block_folds, random_folds


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
