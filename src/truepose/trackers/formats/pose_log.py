"""A log in blocks (layout 9): ``Pos 1``, then samples of that pose as ``Cnt=1  X=…  Y=…  RotX=…``; mm, deg.

Angles are about the fixed axes x, y, z (not confirmed by the maker).
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.strict import to_float
from truepose.errors import FileError
from truepose.samples import Samples
from truepose.trackers.layout import Layout, row_names
from truepose.trackers.readings import Readings, first_line

_BLOCK: Final = re.compile(r"\s*+Pos(?:e|ition)?+\s*+[:#=]?+\s*+(?P<name>\w++)\s*+:?+\s*+", re.IGNORECASE)
_PAIR: Final = re.compile(r"(?<![A-Za-z])(?P<key>[A-Za-z]++)\s*=\s*(?P<value>[^\s,;=]+)")
_POSITION: Final = ("x", "y", "z")
_ANGLES: Final = ("rotx", "roty", "rotz")


def _matches(text: str) -> bool:
    return _BLOCK.fullmatch(first_line(text)) is not None or first_line(text).startswith("Cnt=")


def _read(text: str, path: str | Path) -> Readings:
    """Read all samples; those of one pose are averaged when they are matched with the plan."""
    block, names, lines, values = "", [], [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        if header := _BLOCK.fullmatch(line):
            block = header["name"]
            continue
        pairs = {pair["key"].lower(): pair["value"] for pair in _PAIR.finditer(line)}
        if not pairs:
            message = f'expected "Pos 1" or "Cnt=1 X=… Y=… Z=…", got {line.strip()[:60]!r}'
            raise FileError(path, message, line=number)
        values.append(_values(pairs, path, number))
        names.append(block)
        lines.append(number)
    if not values:
        raise FileError(path, "has blocks but no samples in them")
    table = np.array(values)
    turned = np.isfinite(table[:, 3:]).all(axis=1)
    if turned.any() and not turned.all():
        raise FileError(path, "has no RotX=, RotY=, RotZ=, unlike other samples", line=lines[int(turned.argmin())])
    readings = Readings(
        p=table[:, :3],
        line=np.array(lines, dtype=np.int64),
        source=str(path),
        name=np.array(names),
        rotation=Rotation.from_euler("xyz", table[:, 3:], degrees=True) if turned.all() else None,
    )
    return replace(readings, unit_stated=False)


def _values(pairs: dict[str, str], path: str | Path, line: int) -> list[float]:
    if missing := [axis for axis in _POSITION if axis not in pairs]:
        raise FileError(path, f"has no {missing[0].upper()}=", line=line)
    texts = {key: pairs.get(key, "nan") for key in (*_POSITION, *_ANGLES)}
    try:
        return [to_float(key_text := text) for text in texts.values()]
    except ValueError:
        key = next(key for key, text in texts.items() if text == key_text)
        raise FileError(path, f"{key} is {key_text!r}, which is not a number", line=line) from None


def _write(samples: Samples) -> bytes:
    """Write to 1 µm and 0.001°; a block for each run of samples of one pose."""
    angles = None if samples.rotation_meas is None else samples.rotation_meas.as_euler("xyz", degrees=True)
    lines, before, count = [], None, 0
    for i, (name, (x, y, z)) in enumerate(zip(row_names(samples), samples.p_meas, strict=True)):
        if name != before:
            lines.append(f"Pos {name}")
            before, count = name, 0
        count += 1
        turned = (
            ""
            if angles is None
            else "  " + "  ".join(f"Rot{axis}={value: .3f}" for axis, value in zip("XYZ", angles[i], strict=True))
        )
        lines.append(f"Cnt={count}  X={x:.3f}  Y={y:.3f}  Z={z:.3f}{turned}")
    return ("\n".join(lines) + "\n").encode()


LAYOUT: Final = Layout("log", "log in blocks (Pos 1, Cnt=1 X= Y= Z=)", _matches, _read, _write)
