"""KRL's lexer: its fast paths read what a plain reading does."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import FileError
from truepose.programs.core.source import Source
from truepose.programs.krl.lexer import closing_brace, parse_aggregate, parse_point, split_commas

TEXT = st.text(st.sampled_from(list("{}()[],\"' X1")), max_size=14)


def plain_commas(text: str) -> list[str] | None:
    """Split at commas outside brackets and closed quotes, character by character; None where brackets do not pair."""
    pieces, depth, k = [""], 0, 0
    while k < len(text):
        quote = text.find(text[k], k + 1) if text[k] in "\"'" else -1
        step = text[k : quote + 1] if quote > 0 else text[k]
        depth += (step in "{([") - (step in "})]")
        if depth < 0:
            return None
        pieces[-1:] = [pieces[-1], ""] if step == "," and depth == 0 else [pieces[-1] + step]
        k += len(step)
    return [piece.strip(" \\") for piece in pieces] if depth == 0 else None


@given(TEXT)
def test_commas_outside_brackets_separate(text: str) -> None:
    data = text.encode()
    wanted = plain_commas(text)
    if wanted is None:
        with pytest.raises(ValueError, match="brackets do not pair"):
            split_commas(data, 0, len(data))
    else:
        assert [data[a:b].decode() for a, b in split_commas(data, 0, len(data))] == wanted


@given(TEXT)
def test_a_brace_is_closed_by_its_own(text: str) -> None:
    source = Source(Path("a.src"), ("{" + text).encode())
    depth, k, wanted = 0, 0, 0
    while k < len(source.data) and not wanted:
        quote = source.data.find(b'"', k + 1) if source.data[k : k + 1] == b'"' else -1
        depth += {b"{": 1, b"}": -1}.get(source.data[k : k + 1], 0)
        k = quote + 1 if quote > 0 else k + 1
        wanted = k if depth == 0 else 0
    if wanted:
        assert closing_brace(source, 0, len(source.data), 1) == wanted
    else:
        with pytest.raises(FileError, match="is not closed"):
            closing_brace(source, 0, len(source.data), 1)


@pytest.mark.parametrize("n", range(6, 15))
@pytest.mark.parametrize("blank", ["", " ", "\t "])
def test_a_usual_point_is_read_as_any_other(n: int, blank: str) -> None:
    """Cut off behind C, S, T, E1 … E6; the general reader is the reference."""
    keys = ("X", "Y", "Z", "A", "B", "C", "S", "T", "E1", "E2", "E3", "E4", "E5", "E6")[:n]
    text = "{" + f",{blank}".join(f"{key} {k - 3}.{k}" for k, key in enumerate(keys)) + "}"
    source = Source(Path("a.dat"), text.encode())
    found = parse_point(source, 0, len(text), 1)
    assert found == parse_aggregate(source, 0, len(text), 1)
    assert tuple(found.values) == tuple(found.spans) == keys
