"""Uncertainty budgets by hand: direction, degrees of freedom, what is not stated."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from truepose.verification.budget import Contribution, along, budget, isotropic

ALONG_X = np.array([[0.3, 0.0, 0.0]])


def test_only_what_lies_along_the_error_counts() -> None:
    across = Contribution("temperature", along(np.array([0.6]), np.array([[0.0, 1.0, 0.0]])), "rectangular")
    same = Contribution("temperature", along(np.array([0.6]), np.array([[-2.0, 0.0, 0.0]])), "rectangular")
    assert budget(ALONG_X, [across]).u[0] == pytest.approx(0.0)
    assert budget(ALONG_X, [same]).u[0] == pytest.approx(0.6 / np.sqrt(3.0))
    assert budget(np.zeros((1, 3)), [across]).u[0] == pytest.approx(0.6 / np.sqrt(3.0))  # of no length: the worst


def test_few_repeats_have_a_larger_factor() -> None:
    """Welch-Satterthwaite: equal variances of 4 and of very many degrees of freedom have 16."""
    few = Contribution("reading", isotropic(np.array([0.02])), dof=4.0)
    many = Contribution("station", isotropic(np.array([0.02])), common=True)
    alone, both = budget(ALONG_X, [few]), budget(ALONG_X, [few, many])
    assert alone.k[0] == pytest.approx(student.ppf(0.97725, 4.0))
    assert both.k[0] == pytest.approx(student.ppf(0.97725, 16.0))
    assert both.expanded[0] == pytest.approx(both.k[0] * 0.02 * np.sqrt(2.0))
    assert budget(ALONG_X, [many]).k[0] == 2.0


def test_what_is_not_stated_is_a_line_without_a_value() -> None:
    unknown = Contribution("reflector", None, "rectangular", origin="[uncertainty] reflector_mm")
    found = budget(ALONG_X, [unknown, Contribution("reading", isotropic(np.array([0.01])))])
    first, second = found.lines
    assert (first.u_mm, first.share, first.distribution) == (None, None, "rectangular")
    assert (second.u_mm, second.share) == (pytest.approx(0.01), pytest.approx(1.0))


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6), st.integers(0, 2**31))
def test_a_further_contribution_never_makes_it_smaller(sizes: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(3, 3))
    parts = [Contribution("reading", along(np.full(3, size), rng.normal(size=(3, 3)))) for size in sizes]
    u = [budget(errors, parts[:k]).u for k in range(len(parts) + 1)]
    assert all((b >= a - 1e-12).all() for a, b in itertools.pairwise(u))
