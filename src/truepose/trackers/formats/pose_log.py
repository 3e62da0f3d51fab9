"""A log in blocks (layout 9): ``Pos 1``, then samples of that pose as ``Cnt=1  X=…  Y=…  RotX=…``; mm, deg.

Angles are about fixed axes x, y, z (unconfirmed).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.strict import to_float
from truepose.errors import FileError
from truepose.samples import Samples
from truepose.trackers.exporting import row_names
from truepose.trackers.readings import Layout, Readings, check_metres, decode, first_line

_BLOCK: Final = re.compile(r"\s*+Pos(?:e|ition)?+\s*+[:#=]?+\s*+(?P<name>\w++)\s*+:?+\s*+", re.IGNORECASE)
_PAIR: Final = re.compile(r"(?<![A-Za-z])(?P<key>[A-Za-z]++)\s*=\s*(?P<value>[^\s,;=]+)")
_POSITION: Final = ("x", "y", "z")
_ANGLES: Final = ("rotx", "roty", "rotz")


def _matches(text: str) -> bool:
    return _BLOCK.fullmatch(first_line(text)) is not None or first_line(text).startswith("Cnt=")


def read(data: bytes, path: str | Path) -> Readings:
    """Read all samples; those of one pose are averaged when they are matched with the plan.

    Raises
    ------
    FileError
        If a line is neither a block nor a sample, or a value is missing or no number; with the line.
    """
    block, names, lines, values = "", [], [], []
    for number, line in enumerate(decode(data, path).splitlines(), start=1):
        if not line.strip():
            continue
        if header := _BLOCK.fullmatch(line):
            block = header["name"]
            continue
        pairs = {pair["key"].lower(): pair["value"] for pair in _PAIR.finditer(line)}
        if not pairs:
            message = f'expected "Pos 1" or "Cnt=1 X=… Y=… Z=…", found {line.strip()[:60]!r}'
            raise FileError(path, message, line=number)
        values.append(_values(pairs, path, number))
        names.append(block)
        lines.append(number)
    if not values:
        raise FileError(path, "has blocks but no samples in them")
    table = np.array(values)
    turned = np.isfinite(table[:, 3:]).all(axis=1)
    if turned.any() and not turned.all():
        raise FileError(path, "has no RotX=, RotY=, RotZ=, other samples have", line=lines[int(turned.argmin())])
    readings = Readings(
        p=table[:, :3],
        line=np.array(lines, dtype=np.int64),
        layout=LAYOUT.name,
        source=str(path),
        name=np.array(names),
        rotation=Rotation.from_euler("xyz", table[:, 3:], degrees=True) if turned.all() else None,
    )
    return check_metres(readings)


def _values(pairs: dict[str, str], path: str | Path, line: int) -> list[float]:
    if missing := [axis for axis in _POSITION if axis not in pairs]:
        raise FileError(path, f"has no {missing[0].upper()}=", line=line)
    try:
        return [to_float(pairs.get(key, "nan")) for key in (*_POSITION, *_ANGLES)]
    except ValueError:
        key = next(key for key in (*_POSITION, *_ANGLES) if not _is_number(pairs.get(key, "nan")))
        raise FileError(path, f"{key} is {pairs[key]!r}, which is not a number", line=line) from None


def _is_number(text: str) -> bool:
    try:
        to_float(text)
    except ValueError:
        return False
    return True


def write(samples: Samples) -> bytes:
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


LAYOUT: Final = Layout("log", "log in blocks (Pos 1, Cnt=1 X= Y= Z=)", _matches, read, write)
