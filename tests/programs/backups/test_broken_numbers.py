"""Numbers that are none, or beyond any length, in any place of the programs and data of a backup."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from tests.programs.conftest import FakeMap
from tests.programs.fuzz_backups import PACKED, backups, injured, some

from truepose.errors import TrueposeError
from truepose.programs import ReadOptions, correct_programs
from truepose.programs.core.program import FrameTolerance

NUMBER = re.compile(rb"([-+*/=]\s*)?(?<![\w.])\d+(?:\.\d+)?(?![\w.])")
BROKEN = (
    *(b"951.2.3.5", b"1e999", b"9" * 400, b".", b"1..2", b"1.", b"--5"),
    *(b"+-3", b"5e", b"0x10", b"1_0", b"\xb2", b""),
)
OPTIONS = ReadOptions(derived=True, joint_targets=True, frame_tolerance=FrameTolerance(3.0, 0.2), ambiguous="skip")


def with_broken_numbers(rng: np.random.Generator, data: bytes) -> bytes:
    """Return a text in which some numbers are broken, most of them in arithmetic."""
    share = rng.choice([0.0005, 0.002, 0.02])

    def broken(m: re.Match[bytes]) -> bytes:
        before = m[1] or b""
        return before + BROKEN[rng.integers(len(BROKEN))] if rng.random() < (20 * share if before else share) else m[0]

    return NUMBER.sub(broken, data)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("maker", list(backups()))
def test_a_broken_number_is_an_error_with_words_and_never_a_crash(tmp_path: Path, maker: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    files = some(rng, backups()[maker][0])
    for name, data in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        text = name.lower().endswith((".src", ".dat", ".mod", ".ls", ".va", ".jbi", ".cnd", ".prm", ".script", ".pgx"))
        hurt = text or name.lower().endswith((".dtx", ".sys", ".cfg", *PACKED))
        path.write_bytes(injured(rng, with_broken_numbers, name, data) if hurt and rng.random() < 0.7 else data)
    with suppress(TrueposeError):
        correct_programs([tmp_path], FakeMap([0.5, -0.25, 0.125]), options=OPTIONS, keep_going=True, on_guard="skip")
