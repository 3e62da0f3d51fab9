"""KUKA's machine data: the robot's type, and the external axes that carry the robot or move its bases."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from truepose.programs.core.source import Source
from truepose.programs.krl.controller import text
from truepose.programs.krl.lexer import statements

_SETTING: Final = re.compile(rb"(?:CHAR\s+|INT\s+|BOOL\s+|DECL\s+\w+\s+)?(\$\w+)\s*(?:\[\s*\])?\s*=(?!=)\s*", re.I)
_TEXT: Final = re.compile(rb"\"([^\"]*)\"")
_CHOICES: Final = re.compile(rb"\b(\w+)\s*#\s*(\w+)")
_NUMBER: Final = re.compile(rb"\d{1,3}")
_TRANSFORMATION: Final = re.compile(r"\$ET([1-6])_AX")
_NONE: Final = "NONE"


@dataclass(frozen=True, eq=False)
class MachineDat:
    """What a ``$machine.dat`` states about the robot and its external axes.

    Attributes
    ----------
    texts : dict of str to str
        The texts, such as ``$TRAFONAME`` and ``$V_R1MADA``, by name in upper case.
    axes : int
        The number of external axes.
    kinematics : dict of int to str
        The kinematic systems in use by their numbers 1 to 6, such as ERSYS (it carries the robot) and EASYS (it moves
        bases).
    axes_of : dict of int to tuple of str
        The axes of each kinematic system, such as E1.
    """

    texts: dict[str, str] = field(default_factory=dict)
    axes: int = 0
    kinematics: dict[int, str] = field(default_factory=dict)
    axes_of: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file; everything that is not about the robot's type and external axes is passed over."""
        source, texts, axes = Source.read(path), {}, 0
        kinematics: dict[int, str] = {}
        axes_of: dict[int, tuple[str, ...]] = {}
        for _, _, start, _, end in statements(source):
            if (m := _SETTING.match(source.data, start, end)) is None:
                continue
            name = m[1].decode().upper()
            if found := _TEXT.match(source.data, m.end(), end):
                texts[name] = text(found[1]).strip()
            elif name == "$EX_AX_NUM" and (number := _NUMBER.match(source.data, m.end(), end)):
                axes = int(number[0])
            elif name == "$EX_KIN":
                chosen = [(int(key[2:]), kind) for key, kind in _chosen(source, m.end(), end) if key[2:].isdigit()]
                kinematics = {number: kind for number, kind in chosen if kind != _NONE}
            elif transformation := _TRANSFORMATION.fullmatch(name):
                used = [axis for _, axis in _chosen(source, m.end(), end) if axis != _NONE]
                axes_of[int(transformation[1])] = tuple(used)
        return cls(texts, axes, kinematics, axes_of)

    @property
    def carriers(self) -> tuple[str, ...]:
        """The external axes that carry the robot; empty where it stands."""
        return self._axes({number for number, kind in self.kinematics.items() if kind == "ERSYS"})

    @property
    def positioners(self) -> tuple[str, ...]:
        """The external axes that move bases."""
        return self._axes({number for number, kind in self.kinematics.items() if kind != "ERSYS"})

    def _axes(self, numbers: set[int]) -> tuple[str, ...]:
        return tuple(axis for number in sorted(numbers) for axis in self.axes_of.get(number) or (f"ET{number}",))


def _chosen(source: Source, start: int, end: int) -> list[tuple[str, str]]:
    """Return the components of a structure of enumerations, in upper case."""
    return [(m[1].decode().upper(), m[2].decode().upper()) for m in _CHOICES.finditer(source.data, start, end)]
