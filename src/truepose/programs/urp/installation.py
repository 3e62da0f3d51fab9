"""The installation of a Universal Robots controller (.installation): TCPs, features, mounting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from truepose._typing import FloatArray
from truepose.programs.core.packed import PackedSource
from truepose.programs.urp.markup import Element, parse
from truepose.programs.urp.numbers import pose

_FEATURES: Final = ("GeomFeatures", "Features")
_UPRIGHT: Final = 1e-6


class Placed(NamedTuple):
    """A transform (4, 4) [mm] of an installation, and its line."""

    tf: FloatArray
    line: int


@dataclass(frozen=True, eq=False)
class Installation:
    """The installation that programs name.

    Attributes
    ----------
    path : Path
        The file.
    tcps : mapping of str to Placed
        The tools, flange to TCP, by name.
    active : str
        The TCP that is in force where a program chooses none; empty where the file names none.
    features : mapping of str to Placed
        The features whose pose the file states, base to feature, by name.
    upright : bool
        Whether the robot stands on a level floor.
    problem : str
        Why the file cannot be read; empty where it can.
    """

    path: Path
    tcps: Mapping[str, Placed] = field(default_factory=dict)
    active: str = ""
    features: Mapping[str, Placed] = field(default_factory=dict)
    upright: bool = True
    problem: str = ""


def read_installation(path: Path) -> Installation:
    """Read an installation; a FileError names the line if it is broken."""
    source = PackedSource.read(path)
    root = parse(source)
    tcps: dict[str, Placed] = {}
    features: dict[str, Placed] = {}
    active, upright = "", True
    for element in root.walk():
        if element.tag == "TCPSettings":
            active = element.get("activePose")
        elif element.tag == "tcp" and "offset" in element.attributes:
            _add(source, tcps, element, "offset")
        elif "pose" in element.attributes and element.get("name") and _is_feature(element):
            _add(source, features, element, "pose")
        elif element.tag == "WorldtoMarshal":
            upright = abs(_angle(element, "tiltAngle")) < _UPRIGHT
    return Installation(path, tcps, active, features, upright)


def _is_feature(element: Element) -> bool:
    return any(around.tag in _FEATURES for around in element.around())


def _add(source: PackedSource, table: dict[str, Placed], element: Element, key: str) -> None:
    name = element.get("name")
    if name in table:
        raise source.error(element.line, f"{name} is given twice, first in line {table[name].line}; keep one")
    table[name] = Placed(pose(source, element, key), element.line)


def _angle(element: Element, name: str) -> float:
    try:
        return float(element.get(name) or "0")
    except ValueError:
        return math.nan
