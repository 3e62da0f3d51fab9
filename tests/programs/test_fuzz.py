"""The fuzzer for a while; ``TRUEPOSE_FUZZ_SECONDS`` says how long (CI: a minute)."""

from __future__ import annotations

import os

from tests.programs.fuzz import run


def test_injured_programs_give_our_errors_and_keep_everything_but_digits() -> None:
    seconds = float(os.environ.get("TRUEPOSE_FUZZ_SECONDS", "15"))
    tried, corrected = run(seconds, seed=0)
    assert corrected > 0.1 * tried > 0
