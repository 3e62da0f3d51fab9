"""The two tiers of tests: every behaviour once by default, and its repetitions with ``TRUEPOSE_TESTS=all``.

``make test`` runs the first tier, ``make test-all`` both. A test with the mark ``exhaustive`` is in the second tier;
the mark ``sampled(n)`` leaves n parameter sets of a test in the first one, evenly spread; `examples` gives a property
fewer examples there.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import pytest

EXHAUSTIVE: Final = os.environ.get("TRUEPOSE_TESTS") == "all"
"""Whether the second tier runs, too."""

_SHARE: Final = 5
_FEWEST: Final = 8


def examples(number: int) -> int:
    """Return how many examples a property tries: `number` in the second tier, a fifth (at least 8) in the first."""
    return number if EXHAUSTIVE else min(number, max(number // _SHARE, _FEWEST))


def second_tier(items: Sequence[pytest.Item]) -> list[pytest.Item]:
    """Return the tests of the second tier, and mark them as such where `sampled` put them there."""
    groups = defaultdict(list)
    for item in items:
        if mark := item.get_closest_marker("sampled"):
            groups[item.nodeid.split("[")[0], mark.args[0]].append(item)
    for (_, keep), group in groups.items():
        kept = {round(i * (len(group) - 1) / max(keep - 1, 1)) for i in range(keep)}
        for i in set(range(len(group))) - kept:
            group[i].add_marker("exhaustive")
    return [item for item in items if item.get_closest_marker("exhaustive")]
