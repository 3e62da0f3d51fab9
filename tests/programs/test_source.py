"""The mechanism under every dialect: patches by position, number style, the proof, the diff."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from truepose.errors import RefusedError
from truepose.programs.core.source import Source, apply_patches, format_number, parse_number, prove, unified_diff
from truepose.programs.krl.lexer import LEXER

NUMBERS = st.from_regex(rb"\A[+-]?(?:[0-9]{1,5}(?:\.[0-9]{0,9})?|\.[0-9]{1,9})(?:[eE][+-]?[0-2])?\Z")


@pytest.mark.parametrize(
    ("token", "delta", "expected"),
    [
        (b"812.5", 0.25, b"812.75"),
        (b"812.5", 0.5, b"813.0"),
        (b"300", 0.25, b"300.25"),
        (b"300", 1.0, b"301"),
        (b"300.", 0.5, b"300.5"),
        (b"-40.250", -0.001, b"-40.251"),
        (b"1.123456789", 0.1, b"1.223456789"),
        (b"-0.0", 0.0, b"-0.0"),
        (b"-0.0", 0.25, b"0.25"),
        (b"-0.2", 0.2, b"0.0"),
        (b"0.1", -0.35, b"-0.25"),
        (b"+40.25", 0.5, b"+40.75"),
        (b"+0.25", -0.5, b"-0.25"),
        (b"-.858", 0.1, b"-.758"),
        (b".9", 0.2, b"1.1"),
        (b"-2.6E-14", 0.25, b"0.25"),
        (b"8.125E2", 0.25, b"812.75"),
        (b"   812.5", 0.25, b"  812.75"),
        (b"  -9.500", 0.6, b"  -8.900"),
    ],
)
def test_a_number_keeps_its_style(token: bytes, delta: float, expected: bytes) -> None:
    assert format_number(token, delta) == expected


def test_resolution_limits_what_a_number_gains_not_what_it_has() -> None:
    assert format_number(b"300", 0.23456, 0.01) == b"300.23"
    assert format_number(b"300", 0.004, 0.01) == b"300"
    assert format_number(b"300.000", 0.2346, 0.05) == b"300.235"
    assert format_number(b"300", 0.23, 0.05) == b"300.25"


@given(token=NUMBERS, delta=st.floats(-10, 10))
@example(token=b".1E2", delta=-10.0)  # becomes zero, whose only digit must stay
def test_a_number_moves_by_what_was_asked(token: bytes, delta: float) -> None:
    written = format_number(token, delta)
    assert abs(float(written) - float(token) - delta) <= 0.5001e-3 + 1e-9
    assert re.fullmatch(rb"[+-]?(\d+\.?\d*|\.\d+)", written) or written == token


@given(token=NUMBERS)
def test_no_change_returns_the_same_token(token: bytes) -> None:
    assert format_number(token, 0.0) == token
    assert format_number(token, 0.0004999) == token


@pytest.mark.parametrize(
    ("token", "message"),
    [
        (b"1.2.3", "1.2.3 is not a number"),
        (b"--5", "--5 is not a number"),
        (b"", " is not a number"),
        (b"9" * 400, "has 400 characters, at most 40 were expected"),
        (b"1e300", "beyond 1e.06"),
        (b"-1E99999", "beyond 1e.06"),
        (b"nan", "nan is not a number"),
    ],
)
def test_broken_numbers(token: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_number(token)


def test_patches_go_by_position() -> None:
    assert apply_patches(b"X 5,Y 5", [(2, 3), (6, 7)], [b"66", b"7"]) == b"X 66,Y 7"
    assert apply_patches(b"X 5,Y 5", [(6, 7)], [b"7"], 4) == b"Y 7"
    for wrong in ([(2, 5), (4, 6)], [(6, 9)], [(3, 2)], [(6, 7), (2, 3)]):
        with pytest.raises(ValueError, match="overlap or lie outside"):
            apply_patches(b"X 5,Y 5", wrong, [b""] * len(wrong))


@given(data=st.binary(max_size=200))
def test_the_lexer_is_lossless_and_never_crosses_a_line_end(data: bytes) -> None:
    tokens = LEXER.findall(data)
    assert b"".join(tokens) == data
    assert not any(re.search(rb"[\r\n]", token) and token not in (b"\r\n", b"\r", b"\n") for token in tokens)


SOURCE = Source(Path("a.src"), b"DEF a()\r\nLIN {X 812.5,Y 1}\nEND")


def test_proof_accepts_corrected_numbers() -> None:
    spans = [(16, 21), (24, 25)]
    prove(SOURCE, 0, len(SOURCE.data), apply_patches(SOURCE.data, spans, [b"813.25", b"1.5"]), spans, LEXER)


@pytest.mark.parametrize(
    ("span", "patched", "message"),
    [
        # another byte changed than the patch says
        ((16, 21), b"DEF b()\r\nLIN {X 813.25,Y 1}\nEND", r"a\.src:1: .*b'a' became b'b'"),
        # a number that no patch names
        ((16, 21), b"DEF a()\r\nLIN {X 813.25,Y 2}\nEND", r"a\.src:2: .*b'1' became b'2'"),
        # what was written is no number, or grows together with what stands beside it
        ((16, 21), b"DEF a()\r\nLIN {X 8a,Y 1}\nEND", r"a\.src:2"),
        ((15, 21), b"DEF a()\r\nLIN {X813.25,Y 1}\nEND", r"a\.src:2.*number of words changed"),
        # a line end was normalised
        ((16, 21), b"DEF a()\nLIN {X 813.25,Y 1}\nEND", r"a\.src:"),
        # the end is missing
        ((16, 21), b"DEF a()\r\nLIN {X 813.25,Y 1}\n", r"a\.src:3?"),
    ],
)
def test_proof_finds_any_other_change(span: tuple[int, int], patched: bytes, message: str) -> None:
    with pytest.raises(RefusedError, match=message):
        prove(SOURCE, 0, len(SOURCE.data), patched, [span], LEXER)


def test_proof_goes_piece_by_piece() -> None:
    data = b"LIN {X 1.5}\r\n" * 50
    source = Source(Path("a.src"), data)
    patches = [(13 * i + 7, 13 * i + 10) for i in range(40, 48, 3)]
    patched = apply_patches(data, patches, [b"1.625"] * 3, 13 * 40)
    prove(source, 13 * 40, len(data), patched, patches, LEXER)
    with pytest.raises(RefusedError, match=r"a\.src:50"):
        prove(source, 13 * 40, len(data), patched[:-4] + b"9}\r\n", patches, LEXER)


def test_lines_end_at_lf_crlf_and_cr() -> None:
    source = Source(Path("a.src"), b"1\r\n2\n3\r4")
    assert [source.line(i) for i in range(len(source.data))] == [1, 1, 1, 2, 2, 3, 3, 4]


def test_diff_shows_changed_lines_in_context() -> None:
    old = b"".join(b"line %d\r\n" % i for i in range(20)) + b"last \xe4 1"
    new = old.replace(b"line 3\r", b"line 33\r").replace(b"\xe4 1", b"\xe4 2")
    text = unified_diff(Path("a.src"), old, new)
    assert text.splitlines() == [
        "--- a.src", "+++ a.src (corrected)", "@@ -1,7 +1,7 @@", " line 0", " line 1", " line 2", "-line 3", "+line 33",
        " line 4", " line 5", " line 6", "@@ -18,4 +18,4 @@", " line 17", " line 18", " line 19", "-last ä 1",
        "\\ No newline at end of file", "+last ä 2", "\\ No newline at end of file",
    ]  # fmt: skip
    assert unified_diff(Path("a.src"), old, old) == ""


@given(st.lists(st.sampled_from([b"a", b"\r", b"\n", b"\r\n", b"xyz"]), max_size=40).map(b"".join), st.integers(1, 9))
def test_lines_start_behind_every_line_end(data: bytes, block: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truepose.programs.core.source._BLOCK", block)
        source = Source(Path("a"), data)
        ends = [m.end() for m in re.finditer(rb"\r\n|\n|\r", data)]
        assert [source.line(k) for k in range(len(data) + 1)] == [
            1 + sum(end <= k for end in ends) for k in range(len(data) + 1)
        ]
