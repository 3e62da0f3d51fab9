"""The two tiers of tests: every behaviour once by default, and its repetitions with ``TRUEPOSE_TESTS=all``.

``make test`` runs the first tier, ``make test-all`` both. A test of the second tier alone has the mark ``exhaustive``;
`sampled` marks all but a few of a test's parameters, and `examples` gives a property fewer examples in the first tier.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any, Final

import pytest

EXHAUSTIVE: Final = os.environ.get("TRUEPOSE_TESTS") == "all"
"""Whether the second tier runs, too."""

_SHARE: Final = 5
_FEWEST: Final = 8
_PARAM: Final = type(pytest.param())


def sampled(values: Iterable[Any], keep: int = 2) -> list[Any]:
    """Return the parameters of a test: `keep` of them, evenly spread, for the first tier, the others for the second."""
    listed = [value if isinstance(value, _PARAM) else _param(value) for value in values]
    kept = {round(i * (len(listed) - 1) / max(keep - 1, 1)) for i in range(keep)}
    second = pytest.mark.exhaustive
    return [one if i in kept else one._replace(marks=(*one.marks, second)) for i, one in enumerate(listed)]


def examples(number: int) -> int:
    """Return how many examples a property tries: `number` in the second tier, a fifth (at least 8) in the first."""
    return number if EXHAUSTIVE else min(number, max(number // _SHARE, _FEWEST))


def _param(value: Any) -> Any:
    return pytest.param(*value) if isinstance(value, tuple) else pytest.param(value)
