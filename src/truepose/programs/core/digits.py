"""Read, move and write the numbers of a program in arrays.

The plain style (``-40.25``, also with blanks in front or without the zero before the point) is handled here. Any other
number (an exponent, a plus) goes through `truepose.programs.core.source.format_number`, which defines the result for
both.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.programs.core.source import decimals_of, format_number, moved_token

_WIDEST: Final = 17  # characters of a plain number: sign, point and 15 digits, which a double holds
_WHOLE: Final = 10 ** np.arange(16)
_POWERS: Final = np.array([float(f"1e{k}") for k in range(16)])
_STEPS: Final = np.array([float(f"1e-{k}") for k in range(16)])
_EXACT: Final = 1 << 52


class Digits(NamedTuple):
    """Numbers as whole numbers of their last decimal.

    Attributes
    ----------
    mantissa, decimals : (n,) arrays of int
        The value is mantissa / 10^decimals.
    plain : (n,) array of bool
        Whether a number is written plainly; the others have no meaning here.
    bare : (n,) array of bool
        Whether a plain number has no digit before its point.
    start : (n,) array of int
        The first byte behind the blanks in front.
    """

    mantissa: IntArray
    decimals: IntArray
    plain: BoolArray
    bare: BoolArray
    start: IntArray


def without_blanks(data: bytes, spans: IntArray) -> IntArray:
    """Return spans (…, 2) without the blanks in front."""
    text, found = np.frombuffer(data, np.uint8), spans.copy()
    start, end = found[..., 0], found[..., 1]
    while True:
        first = text[np.minimum(start, len(text) - 1)] if len(text) else np.zeros(start.shape, np.uint8)
        blank = ((first == ord(" ")) | (first == ord("\t"))) & (start < end)
        if not blank.any():
            return found
        start += blank


def read_digits(data: bytes, spans: IntArray) -> Digits:
    """Read the numbers at spans (n, 2).

    Examples
    --------
    >>> read_digits(b"X -40.25", np.array([[2, 8]])).mantissa
    array([-4025])
    """
    characters, spans = np.frombuffer(data, np.uint8), without_blanks(data, spans)
    start, length = spans[:, 0], spans[:, 1] - spans[:, 0]
    plain = (length > 0) & (length <= _WIDEST)
    mantissa, decimals = np.zeros(len(spans), np.int64), np.zeros(len(spans), np.int64)
    behind_point, negative, whole = (np.zeros(len(spans), bool) for _ in range(3))
    for k in range(min(int(length.max(initial=0)), _WIDEST)):
        inside = k < length
        c = np.where(inside, characters[np.minimum(start + k, len(data) - 1)], 0)
        digit, point = (c >= ord("0")) & (c <= ord("9")), c == ord(".")
        if k == 0:
            negative = c == ord("-")
        mantissa = np.where(digit, mantissa * 10 + (c - ord("0")), mantissa)
        decimals += digit & behind_point
        whole |= digit & ~behind_point
        plain &= digit | (point & ~behind_point) | ~inside | ((k == 0) & negative)
        behind_point |= point
    plain &= (whole | (decimals > 0)) & (mantissa < _EXACT)
    return Digits(np.where(negative, -mantissa, mantissa), decimals, plain, plain & ~whole, start)


def values_at(data: bytes, spans: IntArray) -> FloatArray:
    """Return the values of number tokens at spans (n, 2), each as ``float`` reads it, (n,)."""
    digits = read_digits(data, spans)
    values: FloatArray = np.abs(digits.mantissa) / _POWERS[digits.decimals]  # both exact: rounded once
    first = np.frombuffer(data, np.uint8)[digits.start] if len(spans) else np.empty(0, np.uint8)
    values[first == ord("-")] *= -1.0
    for i in np.flatnonzero(~digits.plain).tolist():
        values[i] = float(data[spans[i, 0] : spans[i, 1]])
    return values


def moved(data: bytes, spans: IntArray, values: FloatArray, delta: FloatArray, resolution: float) -> FloatArray:
    """Return the values of number tokens after they are written moved by `delta`, (n,); see `format_number`."""
    after = values.copy()
    changed = np.rint(delta / resolution) != 0
    gained = decimals_of(resolution)
    digits = read_digits(data, spans)
    fast = changed & digits.plain & (gained is not None)
    if gained is not None:
        kept = np.maximum(digits.decimals, gained)
        steps = digits.mantissa * _WHOLE[kept - digits.decimals] + np.rint(delta / _STEPS[kept]).astype(np.int64)
        fast &= np.abs(steps) < _EXACT
        after[fast] = (steps / _POWERS[kept])[fast]
    for i in np.flatnonzero(changed & ~fast).tolist():
        after[i] = float(format_number(data[spans[i, 0] : spans[i, 1]], float(delta[i]), resolution))
    return after


def written(data: bytes, spans: IntArray, values: FloatArray, after: FloatArray, resolution: float) -> list[bytes]:
    """Return the tokens of numbers with new values from `moved`, in the style of the old tokens; see `format_number`.

    The sixteenth digit of a number that has so many is that of a difference of doubles.
    """
    digits = read_digits(data, spans)
    gained = decimals_of(resolution)
    if gained is None:
        gained, digits = 0, digits._replace(plain=np.zeros(len(spans), bool))
    kept = np.maximum(digits.decimals, gained)
    plain = digits.plain & (np.abs(after) * _POWERS[np.minimum(kept, 15)] < _EXACT)
    spare = np.where(plain, kept - digits.decimals, -1)
    texts = []
    blanks = np.where(digits.start > spans[:, 0], spans[:, 1] - spans[:, 0], 0)
    rows = zip(
        spans.tolist(), values.tolist(), (after + 0.0).tolist(), kept.tolist(), spare.tolist(), digits.bare.tolist(),
        blanks.tolist(), strict=True,
    )  # fmt: skip
    for (start, end), value, new, k, more, bare, width in rows:
        if more < 0:
            texts.append(moved_token(data[start:end], new - value, resolution))
            continue
        text = b"%.*f" % (k, new)
        if more:
            text = text[:-more] + text[-more:].rstrip(b"0") if more < k else text.rstrip(b"0").rstrip(b".")
        if bare and -1.0 < new < 1.0:
            text = text.replace(b"0.", b".", 1)
        texts.append(b" " + text.rjust(width - 1) if width else text)
    return texts
