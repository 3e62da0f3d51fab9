"""Frames and tools of VAL3 data, followed to world or flange, also into libraries."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs.core.points import Frame
from truepose.programs.core.source import Source
from truepose.programs.val3.values import Value

_ROOTS: Final = {"frame": "world", "tool": "flange"}
_REFERENCE: Final = re.compile(r"\s*(?:(\w+):)?(\w+)\s*(?:\[\s*(\w+)\s*\])?\s*")
Place = tuple[Path, str]
"""The application of a frame, and its name in lower case."""


class Table(NamedTuple):
    """The frames, or the tools, of one application.

    Attributes
    ----------
    kind : {"frame", "tool"}
        Which of both.
    application : Path
        The application.
    values : mapping of str to (Source, Value)
        The values by their names in lower case, each with its file.
    library : callable
        A function that returns the table of a library by its alias; None where it is not known.
    """

    kind: str
    application: Path
    values: Mapping[str, tuple[Source, Value]]
    library: Callable[[str], Table | None]

    def named(self, text: str) -> Frame | None:
        """Return the frame that a fatherId or a program names; None if it names none."""
        m = _REFERENCE.fullmatch(text)
        if m is None:
            return None
        name = _name(m)
        if name.lower() == _ROOTS[self.kind]:
            return Frame(name, 0)
        tf = self._transform(self.chain(text))
        return Frame(name, name, None if tf is None else tf.tobytes())

    def chain(self, text: str) -> list[tuple[Place, FloatArray | None]]:
        """Return the frames from a named one up to world or flange, each with its transform, (4, 4) [mm].

        The last one has no transform where the way ends elsewhere.
        """
        found: list[tuple[Place, FloatArray | None]] = []
        table: Table | None = self
        while (m := _REFERENCE.fullmatch(text)) is not None:
            name = _name(m).lower()
            if name == _ROOTS[self.kind]:
                return found
            if m[1]:
                table, name = (None if table is None else table.library(m[1])), name.split(":", 1)[1]
            place = (table.application if table is not None else Path(), name)
            if table is None or name not in table.values or any(place == before for before, _ in found):
                break
            source, value = table.values[name]
            numbers, _ = value.numbers(source)
            found.append((place, make_transform(euler("staubli", numbers[3:]), numbers[:3])))
            text = value.text("fatherId")
        return [*found, ((Path(), text), None)]

    @staticmethod
    def _transform(chain: list[tuple[Place, FloatArray | None]]) -> FloatArray | None:
        whole: FloatArray = np.eye(4)
        for _, tf in chain:
            if tf is None:
                return None
            whole = tf @ whole
        return whole


def _name(m: re.Match[str]) -> str:
    """Return a name as `Value.name` writes it, with the alias of its library."""
    name = m[2] if m[3] in (None, "0") else f"{m[2]}[{m[3]}]"
    return f"{m[1]}:{name}" if m[1] else name
