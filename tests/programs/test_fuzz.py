"""The fuzzer for a while: a minute where ``CI`` is set, or as long as ``TRUEPOSE_FUZZ_SECONDS`` says."""

from __future__ import annotations

import os

import pytest
from tests.programs.fuzz import run


@pytest.mark.exhaustive
def test_injured_programs_give_our_errors_and_keep_everything_but_digits() -> None:
    seconds = float(os.environ.get("TRUEPOSE_FUZZ_SECONDS", "60" if os.environ.get("CI") else "5"))
    tried, corrected = run(seconds, seed=0)
    assert corrected > 0.1 * tried > 0
