"""An independent idea of the numbers of a program: plain regular expressions, nothing of the readers.

`check_numbers` compares an original with its corrected version number by number, and with the record of the correction.
"""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from truepose.programs import CorrectedProgram

WORD = re.compile(rb"[+-]?[0-9.][0-9._]*(?:[eEdD][+-]?[0-9]+)?")
"""As much as could be one number: digits, points, and an exponent of either letter."""
STRICT = re.compile(r"[ \t]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t]*")
"""What every language of ours agrees to be a number."""


def value(text: str) -> float | None:
    """Return the value of a number; None if it is none, or not for certain."""
    try:
        return float(Decimal(text.strip())) if STRICT.fullmatch(text) else None
    except InvalidOperation:
        return None


def changed_numbers(before: bytes, after: bytes) -> list[tuple[float | None, float | None]]:
    """Return the numbers that differ, old and new, in the order of the file; all else must be the same."""
    assert WORD.sub(b"0", before).replace(b" ", b"") == WORD.sub(b"0", after).replace(b" ", b"")
    pairs = zip(WORD.findall(before), WORD.findall(after), strict=True)
    return [(value(a.decode()), value(b.decode())) for a, b in pairs if a != b]


def check_numbers(corrected: CorrectedProgram, originals: dict[Path, bytes]) -> int:
    """Require that the numbers that changed are those of the record, before and after; return how many there are."""
    found = 0
    files = corrected.files
    for path, before in originals.items():
        numbers = changed_numbers(before, files[path])
        recorded = []
        for outcome in corrected.targets:
            target = outcome.target
            if outcome.verdict != "correct" or target.path != path:
                continue
            new = [*(outcome.p_after / target.unit), *outcome.angles_after]
            old = [*(outcome.p_before / target.unit), *(target.angles or ())]
            recorded += [
                (span[0], a, b) for span, a, b in zip(target.spans, old, new, strict=True) if a != b and span[0] >= 0
            ]
        assert None not in [number for pair in numbers for number in pair], numbers
        wanted = np.array([(a, b) for _, a, b in sorted(recorded)]).reshape(-1, 2)
        np.testing.assert_allclose(np.array(numbers, float).reshape(-1, 2), wanted, rtol=1e-12, atol=1e-12)
        found += len(numbers)
    return found
