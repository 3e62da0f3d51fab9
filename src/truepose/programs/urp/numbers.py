"""Lists of numbers in attributes: joints, poses, and parameters of the arm."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source, Span, parse_number
from truepose.programs.urp.markup import Element

_PART: Final = re.compile(rb"[^,]+")
COUNT: Final = 6
"""The number of joints, and of the numbers of a pose."""


def numbers(source: Source, element: Element, name: str) -> tuple[tuple[float, ...], tuple[Span, ...]]:
    """Return the six numbers of an attribute and their spans; a FileError names the line if it has others."""
    value = element.attributes.get(name)
    if value is None:
        raise source.error(element.line, f"<{element.tag}> has no {name}; save the program on the controller again")
    parts = list(_PART.finditer(value.data))
    if len(parts) != COUNT:
        raise source.error(element.line, f"{name} of <{element.tag}> has {len(parts)} numbers, expected {COUNT}")
    values, spans = [], []
    for m in parts:
        token = m[0].strip()
        first = value.start + m.start() + m[0].index(token)
        try:
            values.append(parse_number(token))
        except ValueError as error:
            raise source.error(element.line, f"{name} of <{element.tag}>: {error}; correct the file") from None
        spans.append((first, first + len(token)))
    return tuple(values), tuple(spans)


def pose(source: Source, element: Element, name: str = "pose") -> FloatArray:
    """Return the transform (4, 4) [mm] of a pose [m, rad] in an attribute."""
    values, _ = numbers(source, element, name)
    try:
        return make_transform(euler("ur", values[3:]), 1000.0 * np.array(values[:3]))
    except DataError as error:
        raise source.error(element.line, f"{name} of <{element.tag}>: {error}") from None
