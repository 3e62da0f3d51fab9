"""The decimal step of numbers that were rounded."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.samples import decimal_step

VALUES = np.random.default_rng(0).uniform(-3000.0, 3000.0, (40, 3))


@pytest.mark.parametrize("digits", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("unit", [1.0, 25.4, np.pi / 180.0])
def test_the_digits_of_a_table_are_found_in_any_of_its_units(digits: int, unit: float) -> None:
    values = np.round(VALUES, digits) * unit
    assert decimal_step(values, (1.0, 25.4, np.pi / 180.0)) == pytest.approx(10.0**-digits * unit)


def test_numbers_with_all_digits_have_no_step() -> None:
    assert decimal_step(VALUES) == 0.0


def test_a_single_number_with_more_digits_counts() -> None:
    values = np.round(VALUES, 1)
    values[7, 1] += 0.05
    assert decimal_step(values) == pytest.approx(0.01)


def test_few_numbers_may_end_in_zeros_by_chance() -> None:
    assert decimal_step(np.array([100.0, 250.0, -30.0])) == 0.0
    assert decimal_step(np.zeros((40, 3))) == 0.0
