"""The load data of programs, compared with the payload that a map corrects for.

They are what the controller reckons with: KUKA's ``LOAD_DATA[n]`` (in a module or ``$config.dat``) and ``$LOAD``, the
load in RAPID's ``tooldata``, to which ``GripLoad`` adds a piece, and ``set_payload`` of URScript. FANUC's
``PAYLOAD[n]`` names a table of the controller, whose masses no program states.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from truepose.cell import Cell
from truepose.errors import RefusedError
from truepose.programs.core.program import Key, Program, frame_key
from truepose.programs.core.source import NUMBER, Source
from truepose.programs.languages import language_of
from truepose.programs.payloads import tool_key

LEAST_KG: Final = 1.0
"""Smaller differences of a mass are not named."""
SHARE: Final = 0.1
"""The same, as a share of the payload of the correction."""
_UNSET_KG: Final = 0.01  # ABB's load0 has 0.001 kg, KUKA's load of a tool that nobody stated -1 kg

_NAME: Final = rb"(?P<name>[A-Za-z_][\w.]*)"
_MASS: Final = rb"(?P<mass>" + NUMBER + rb")"
_FORMS: Final = {
    "krl": (
        rb"^[^;\r\n]*?\bLOAD_DATA\s*\[\s*(?P<name>\d+)\s*\]\s*=\s*\{[^}]*?\bM\s+" + _MASS,
        rb"^[^;\r\n]*?\$LOAD\s*=\s*\{[^}]*?\bM\s+" + _MASS,
    ),
    "rapid": (
        rb"^[^!\r\n]*?\btooldata\s+"
        + _NAME
        + rb"\s*:=\s*\[\s*\w+\s*,\s*\[\s*\[[^\]]*\]\s*,\s*\[[^\]]*\]\s*\]\s*,\s*\[\s*"
        + _MASS,
    ),
    "urscript": (rb"^[^#\r\n]*?\bset_(?:target_)?payload(?:_mass)?\s*\(\s*" + _MASS,),
}
_PATTERNS: Final = {language: [re.compile(form, re.I | re.M) for form in forms] for language, forms in _FORMS.items()}
_GRIPPED: Final = re.compile(rb"^[^!\r\n]*?\bGripLoad\s+" + _NAME, re.I | re.M)
_PIECE: Final = re.compile(rb"^[^!\r\n]*?\bloaddata\s+" + _NAME + rb"\s*:=\s*\[\s*" + _MASS, re.I | re.M)
_TABLE: Final = re.compile(rb"^[ \t]*\d*:[ \t]*PAYLOAD[ \t]*\[[ \t]*(?:GP\d+[ \t]*:[ \t]*)?(\d+)", re.I | re.M)
_WORDS: Final = {"krl": (b"LOAD",), "rapid": (b"TOOLDATA",), "urscript": (b"PAYLOAD",)}


class StatedLoad(NamedTuple):
    """A load that a program states.

    Attributes
    ----------
    tool : int or str, optional
        The tool of the controller with which it is stated; None where it is stated for no tool.
    mass_kg : float
        The mass.
    where : str
        The file and the line.
    """

    tool: Key | None
    mass_kg: float
    where: str


def stated_loads(program: Program, cell: Cell | None = None) -> list[StatedLoad]:
    """Return the loads that a program and the ``$config.dat`` of its cell state; those that nobody set are left out."""
    sources = list(program.sources)
    if cell is not None and cell.config_dat is not None and language_of(sources[0].path) == "krl":
        sources.append(Source.read(cell.config_dat))
    loads = [load for source in sources for load in _of(source) if load.mass_kg > _UNSET_KG]
    pieces = _pieces(program.sources)
    return loads + [one._replace(mass_kg=one.mass_kg + kg, where=where) for one in loads for kg, where in pieces]


def _pieces(sources: Sequence[Source]) -> list[tuple[float, str]]:
    """Return the masses that ``GripLoad`` adds to those of the tools, and where."""
    masses = {
        found["name"].lower(): float(found["mass"]) for source in sources for found in _PIECE.finditer(source.data)
    }
    return [
        (masses[name], f"{source.path}, line {source.line(found.start('name'))}")
        for source in sources
        for found in _GRIPPED.finditer(source.data)
        if masses.get(name := found["name"].lower(), 0.0) > _UNSET_KG
    ]


def _of(source: Source) -> Iterator[StatedLoad]:
    language = language_of(source.path)
    if not any(word in source.data.upper() for word in _WORDS.get(language, ())):
        return
    for pattern in _PATTERNS[language]:
        for found in pattern.finditer(source.data):
            name = found.groupdict().get("name")
            key = None if name is None else frame_key(name.decode("latin-1"))
            yield StatedLoad(key, float(found["mass"]), f"{source.path}, line {source.line(found.start('mass'))}")


def check_loads(program: Program, cell: Cell, payload: tuple[float, float] | None) -> list[str]:
    """Refuse a program whose load is another one than that of the correction; return warnings.

    Compared are the loads with tools that targets to correct use, and those without a tool. Masses are alike within
    10 %, or 1 kg. A payload with a tool that the cell states counts, whatever the program says, which is told.

    Parameters
    ----------
    program : Program
        The program.
    cell : Cell
        The cell, with the payloads with tools, and the ``$config.dat`` of KUKA.
    payload : tuple of 2 float [kg], optional
        The payload at work, or the range of the samples'; None where nothing is known.

    Raises
    ------
    RefusedError
        If a load differs from it.
    """
    loads = stated_loads(program, cell)
    warnings = _tables(program)
    known = {frame_key(key): (one.mass_kg, one.mass_kg) for key, one in cell.conditions.payloads.items()}
    used = _used(program) if loads else set()
    for load in loads:
        expected = payload if load.tool is None else known.get(load.tool, payload)
        if expected is None or (load.tool is not None and load.tool not in used) or _alike(load.mass_kg, expected):
            continue
        tool = "" if load.tool is None else f" with tool {load.tool}"
        low, high = expected
        ours = f"{low:g} kg" if low == high else f"{low:g} to {high:g} kg"
        what = f"{load.where}: states a load of {load.mass_kg:g} kg{tool}, the correction is for {ours}"
        if load.tool in known:
            warnings.append(f"{what}, as [conditions.payloads] states")
            continue
        key = "N" if load.tool is None else load.tool
        raise RefusedError(
            f"{what}; state what is on the flange: [conditions.payloads.{key}] mass_kg in the cell file for a tool, or "
            "[conditions] payload_kg"
        )
    return warnings


def _tables(program: Program) -> list[str]:
    """Return the warning of a FANUC program that changes the payload: no program states the masses."""
    numbers = sorted({int(found[1]) for source in program.sources for found in _TABLE.finditer(source.data)})
    if len(numbers) < 2 or language_of(program.sources[0].path) != "tp":
        return []
    named = ", ".join(f"PAYLOAD[{number}]" for number in numbers)
    remedy = "state what is on the flange with each tool: [conditions.payloads] in the cell file"
    return [f"{program.path}: selects {named}, whose masses no program states; {remedy}"]


def _alike(mass: float, expected: tuple[float, float]) -> bool:
    low, high = expected
    return low - max(LEAST_KG, SHARE * low) <= mass <= high + max(LEAST_KG, SHARE * high)


def _used(program: Program) -> set[Key]:
    """Return the tools of targets that are to be corrected."""
    return {
        tool_key(target)
        for _, columns in program.targets.chunks()
        for target in columns.shared()[0]
        if target.verdict == "correct"
    }
