"""Controllers' angles: one worked matrix per convention, round trips, and bad numbers."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from truepose.errors import DataError
from truepose.geometry import ANGLES, euler

DEGREES = st.floats(-360, 360)


def axis_matrix(axis: str, degrees: float) -> np.ndarray:
    """Elementary rotation written out, right-handed about x, y or z."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@pytest.mark.parametrize(
    ("controller", "order"),
    [  # (axis, which number) from left to right in the matrix product: conventions.md, "Orientation and pose syntax"
        ("kuka", [("z", 0), ("y", 1), ("x", 2)]),
        ("fanuc", [("z", 2), ("y", 1), ("x", 0)]),
        ("yaskawa", [("z", 2), ("y", 1), ("x", 0)]),
        ("staubli", [("x", 0), ("y", 1), ("z", 2)]),
    ],
)
@given(angles=st.tuples(DEGREES, DEGREES, DEGREES))
def test_degrees_are_the_written_product(
    controller: str, order: list[tuple[str, int]], angles: tuple[float, ...]
) -> None:
    product = np.linalg.multi_dot([axis_matrix(axis, angles[i]) for axis, i in order])
    np.testing.assert_allclose(euler(controller, angles).as_matrix(), product, atol=1e-12)


def test_abb_quaternion_is_w_first() -> None:
    np.testing.assert_allclose(
        euler("abb", [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]).as_matrix(), axis_matrix("z", 90), atol=1e-12
    )


def test_ur_is_a_rotation_vector_in_rad() -> None:
    np.testing.assert_allclose(euler("ur", [0, np.pi / 2, 0]).as_matrix(), axis_matrix("y", 90), atol=1e-12)


@pytest.mark.parametrize("controller", sorted(ANGLES))
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_round_trip_returns_the_rotation(controller: str, seed: int, n: int) -> None:
    rotation = Rotation.random(n, rng=np.random.default_rng(seed))
    numbers = euler(controller, rotation)
    assert numbers.shape == (n, len(ANGLES[controller].names))
    assert (euler(controller, numbers) * rotation.inv()).magnitude().max() < 1e-7


@pytest.mark.parametrize("controller", ["kuka", "fanuc", "yaskawa", "staubli"])
@pytest.mark.parametrize("middle", [90.0, -90.0])
def test_gimbal_lock_keeps_the_rotation_without_warning(controller: str, middle: float) -> None:
    rotation = euler(controller, [30.0, middle, 50.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        numbers = euler(controller, rotation)
    assert numbers[2] == 0.0
    assert (euler(controller, numbers) * rotation.inv()).magnitude() < 1e-7


@pytest.mark.parametrize(
    ("controller", "value", "match"),
    [
        ("kuca", [0, 0, 0], 'unknown controller "kuca"; did you mean "kuka"'),
        ("KUKA", [0, 0, 0], 'did you mean "kuka"'),
        ("kuka", [0, 0, 0, 1], r"kuka orientation \(A, B, C\) has shape \(4,\), expected \(3,\) or \(n, 3\)"),
        ("abb", np.zeros((2, 3)), r"shape \(2, 3\), expected \(4,\) or \(n, 4\)"),
        ("abb", [[1, 0, 0, 0], [0.9, 0.1, 0, 0]], "length 0.905539 in row 1, expected 1; is the order w, x, y, z"),
        ("abb", [0, 0, 0, 0], "length 0 in row 0"),
        ("fanuc", [[0, 0, 0], [np.nan, 0, 0]], "NaN or infinite numbers in row 1"),
        ("ur", [180.0, 0, 0], "looks like degrees, expected rad"),
        ("kuka", np.zeros((0, 3)), "is empty"),
        ("kuka", "A 0", "not an array of numbers"),
    ],
)
def test_invalid_numbers_are_refused(controller: str, value: object, match: str) -> None:
    with pytest.raises(DataError, match=match):
        euler(controller, value)  # type: ignore[call-overload]
