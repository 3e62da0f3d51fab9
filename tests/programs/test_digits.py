"""Numbers in arrays are read, moved and written as they are one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.programs.core.digits import moved, read_digits, values_at, written
from truepose.programs.core.source import format_number

TOKENS = st.from_regex(
    rb"\A(?: {0,3}[+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,9})?|\.[0-9]{1,9})(?:[eE][+-]?[0-2])?|-?[0-9]{1,3}\.[0-9]{0,3})\Z"
)


def joined(tokens: list[bytes]) -> tuple[bytes, np.ndarray]:
    ends = np.cumsum([len(token) + 1 for token in tokens])
    return b"|".join(tokens), np.column_stack([ends - [len(t) + 1 for t in tokens], ends - 1])


@given(st.lists(st.tuples(TOKENS, st.floats(-5, 5)), min_size=1, max_size=8), st.sampled_from([1e-3, 1e-6, 0.05, 0.01]))
def test_arrays_agree_with_one_by_one(pairs: list[tuple[bytes, float]], resolution: float) -> None:
    tokens = [token for token, _ in pairs]
    delta = np.array([d for _, d in pairs])
    data, spans = joined(tokens)
    values = values_at(data, spans)
    assert values.tolist() == [float(token) for token in tokens]
    after = moved(data, spans, values, delta, resolution)
    expected = [format_number(token, d, resolution) for token, d in pairs]
    assert after.tolist() == [float(token) for token in expected]
    changed = after != values
    texts = written(data, spans[changed], values[changed], after[changed], resolution)
    assert texts == [e for e, c in zip(expected, changed, strict=True) if c]


@pytest.mark.parametrize("token", [b"  87.3893", b"87.3893", b"+87.3893", b" .3893", b"8.73893e1"])
@pytest.mark.parametrize("delta", [0.00050000001, -0.00050000001, 0.0005, 0.00149999, 0.0012345])
def test_a_change_at_the_border_of_the_resolution_is_written(token: bytes, delta: float) -> None:
    """What counts as a change is decided once: the written number is the one that was meant."""
    data, spans = joined([token])
    values = values_at(data, spans)
    after = moved(data, spans, values, np.array([delta]), 1e-3)
    if after != values:
        (text,) = written(data, spans, values, after, 1e-3)
        assert float(text) == pytest.approx(after[0], abs=1e-12)
    assert (after != values) == (round(delta / 1e-3) != 0)


@pytest.mark.parametrize(
    "token", [b"-", b".", b"-.", b"1.2.3", b"1-2", b"+1", b"1e3", b" +1", b"9" * 18, b"1 2", b"1,2", b" "]
)
def test_what_is_not_plain_is_known(token: bytes) -> None:
    assert not read_digits(*joined([token])).plain[0]


def test_numbers_of_columns_are_plain() -> None:
    digits = read_digits(*joined([b"   -.858", b" 812.500", b"\t.5", b"-0.25"]))
    assert digits.plain.all()
    assert digits.mantissa.tolist() == [-858, 812500, 5, -25]
    assert digits.bare.tolist() == [True, False, True, False]


def test_negative_zero_keeps_its_sign_until_it_moves() -> None:
    data, spans = joined([b"-0.000", b"-0.250"])
    assert np.signbit(values_at(data, spans)).all()
    after = moved(data, spans, values_at(data, spans), np.array([0.0, 0.25]), 1e-3)
    assert written(data, spans[1:], np.array([-0.25]), after[1:], 1e-3) == [b"0.000"]
