"""Strict reading of numbers, JSON and TOML from untrusted files, with limits on depth and number of digits.

Numbers are ASCII: ``1_000`` and digits of other scripts, which Python's ``float`` accepts, are refused.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any, Final

from truepose.errors import FileError

LARGEST: Final = 1e12
"""The largest number in a table or map; in any unit a larger one is a mistake (10⁹ m, 30,000 years)."""
DEEPEST: Final = 32
"""The largest number of nested brackets or dotted keys in JSON or TOML."""

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?+")
_NOT_FINITE: Final = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_MOST_DIGITS: Final = 40
_OPEN, _CLOSED = "[{", "]}"
# an unterminated string matches up to the end of the text or line, in one way only: no quadratic time
_JSON_MARK: Final = re.compile(r'"(?:[^"\\]|\\.)*+"?+|[\[{]|[\]}]', re.DOTALL)
_TOML_TOKEN: Final = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:""")?+' + r"|'''(?:[^']|'(?!''))*+(?:''')?+"
    r'|"(?:[^"\\\n]|\\.)*+"?+' + r"|'[^'\n]*+'?+|#[^\n]*+|[\[\]{},=\n]|[^\s\[\]{},=\"'#]++",
    re.DOTALL,
)
_UNDERSCORED: Final = re.compile(r"[+-]?[0-9][0-9a-fA-Fxob.eE+-]*_[0-9a-fA-F_.eE+-]*")


def to_float(text: str) -> float:
    """Return the number in a text, including ``nan`` and ``inf``.

    Raises
    ------
    ValueError
        If it is not a number: ASCII digits, optionally with a decimal point and an exponent, are expected.

    Examples
    --------
    >>> to_float(" -1.5e3 ")
    -1500.0
    """
    bare = text.strip()
    if not _NUMBER.fullmatch(bare) and not _NOT_FINITE.fullmatch(bare):
        raise ValueError(f"{bare[:40]!r} is not a number")
    return float(bare)


def is_whole(text: str) -> bool:
    """Return whether a text is an unsigned whole number in ASCII digits, of plausible length.

    Examples
    --------
    >>> is_whole("12"), is_whole("1_2"), is_whole("²")
    (True, False, False)
    """
    return text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS


def parse_json(data: bytes) -> Any:
    """Return the content of a JSON text.

    Raises
    ------
    ValueError
        If the text is not UTF-8 or JSON, is nested deeper than `DEEPEST`, repeats a key, or contains a number that is
        not finite or too long.
    """
    text = data.decode("utf-8")
    depth = 0
    for match in _JSON_MARK.finditer(text):
        depth += (match[0] in _OPEN) - (match[0] in _CLOSED)
        if depth > DEEPEST:
            raise ValueError(f"is nested more than {DEEPEST} deep")
    return json.loads(text, object_pairs_hook=_unique, parse_float=_finite, parse_int=_int, parse_constant=_finite)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("repeats a key")
    return found


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:_MOST_DIGITS]} is not a finite number")
    return value


def _int(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


def parse_toml(text: str, path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML text; `path` is used in messages.

    Raises
    ------
    FileError
        If the text is not TOML, is nested deeper than `DEEPEST`, or has a number with underscores or too many digits;
        with the line.
    """
    _check_toml(text, path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # an integer of too many digits is a plain ValueError
        match = re.fullmatch(r"(.*) \(at line (\d+), column \d+\)", str(error), re.DOTALL)
        what, line = (match[1], int(match[2])) if match else (str(error), None)
        raise FileError(path, f"is not TOML: {what}", line=line) from None


def _check_toml(text: str, path: str | Path) -> None:
    """Refuse text that tomllib reads differently than people do, or in unbounded time."""
    depth, dots, line = 0, 0, 1
    for match in _TOML_TOKEN.finditer(text):
        token = match[0]
        depth = max(0, depth + (token in _OPEN) - (token in _CLOSED))
        dots = 0 if token in "[]{},=\n" else dots + (token.count(".") if token[0] not in "\"'#" else 0)
        if depth > DEEPEST or dots > DEEPEST:
            raise FileError(path, f"is nested more than {DEEPEST} deep; simplify the TOML", line=line)
        if _UNDERSCORED.fullmatch(token) and not re.match(r"[ \t]*+=", text[match.end() : match.end() + 80]):
            raise FileError(path, f"{token[:_MOST_DIGITS]} is not a number; write it without underscores", line=line)
        if len(token) > _MOST_DIGITS and _NUMBER.fullmatch(token):
            raise FileError(path, f"a number has {len(token)} characters, expected at most {_MOST_DIGITS}", line=line)
        line += token.count("\n")
