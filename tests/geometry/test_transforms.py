"""Transforms: inner letters cancel, and what is no transform is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from truepose.errors import DataError
from truepose.geometry import apply_transform, check_transforms, invert_transform, make_transform


@pytest.fixture
def tf_a_b(rng: np.random.Generator) -> np.ndarray:
    return make_transform(Rotation.random(5, rng=rng), rng.normal(scale=1e3, size=(5, 3)))


def test_agrees_with_scipy_rigid_transform(tf_a_b: np.ndarray, rng: np.random.Generator) -> None:
    p_b = rng.normal(size=(5, 3))
    scipy_transform = RigidTransform.from_matrix(tf_a_b)
    np.testing.assert_allclose(apply_transform(tf_a_b, p_b), scipy_transform.apply(p_b), atol=1e-10)
    np.testing.assert_allclose(invert_transform(tf_a_b), scipy_transform.inv().as_matrix(), atol=1e-10)


def test_inverse_cancels(tf_a_b: np.ndarray) -> None:
    np.testing.assert_allclose(invert_transform(tf_a_b) @ tf_a_b, np.tile(np.eye(4), (5, 1, 1)), atol=1e-10)


def test_leading_axes_broadcast(tf_a_b: np.ndarray, rng: np.random.Generator) -> None:
    p_b = rng.normal(size=(4, 3))
    np.testing.assert_allclose(apply_transform(tf_a_b[0], p_b), [apply_transform(tf_a_b[0], p) for p in p_b])
    np.testing.assert_allclose(apply_transform(tf_a_b, p_b[0]), [apply_transform(tf, p_b[0]) for tf in tf_a_b])
    assert make_transform(np.eye(3), np.zeros((2, 7, 3))).shape == (2, 7, 4, 4)


@pytest.mark.parametrize(
    ("value", "match"),
    [
        (np.eye(3), r"poses has shape \(3, 3\), expected \(4, 4\) or \(n, 4, 4\)"),
        (np.zeros((0, 4, 4)), "poses is empty"),
        (np.full((2, 4, 4), np.nan), "NaN or infinite numbers in rows 0, 1"),
        (make_transform(translation=[1.0, 2.0, 3.0]).T, "lower row is not 0 0 0 1 in row 0; is it transposed"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "not a rotation in row 0"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "not a rotation in row 0"),
        ("text", "not an array of numbers"),
    ],
)
def test_refuses_what_is_no_transform(value: object, match: str) -> None:
    with pytest.raises(DataError, match=match):
        check_transforms("poses", value)  # type: ignore[arg-type]


def test_make_refuses_wrong_shapes() -> None:
    with pytest.raises(DataError, match="expected"):
        make_transform(np.eye(4))
