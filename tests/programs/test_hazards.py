"""Every hazard in every language that has it: no target that the hazard touches is corrected."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest
from tests.programs.example import FRAMES
from tests.programs.hazards import HAZARDS, LANGUAGES, Cell

from truepose.programs import read_program

TABLE = {language: import_module(f"tests.programs.hazards.{language}") for language in LANGUAGES}
CELLS = [
    pytest.param(
        cell, id=f"{language}-{hazard}-{i}", marks=[pytest.mark.xfail(reason=cell.fault)] if cell.fault else []
    )
    for language, module in TABLE.items()
    for hazard, cells in module.CELLS.items()
    for i, cell in enumerate(cells)
]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_table_is_full(language: str) -> None:
    module = TABLE[language]
    assert set(module.CELLS) | set(module.ABSENT) == set(HAZARDS)
    assert not set(module.CELLS) & set(module.ABSENT)
    assert all(module.CELLS.values())


@pytest.mark.parametrize("cell", CELLS)
def test_verdicts(tmp_path: Path, cell: Cell) -> None:
    for name, text in cell.files.items():
        (tmp_path / name).write_bytes(text.encode("utf-8"))
    program = read_program(tmp_path / next(iter(cell.files)), cell.frames or FRAMES, cell.options)
    found: dict[str, set[str]] = {}
    for target in program.targets:
        for key in (target.name, f"line {target.line}"):
            found.setdefault(key, set()).add(target.verdict)
    listed = "\n".join(f"{t.line} {t.name} {t.motion}: {t.verdict} {t.reason}" for t in program.targets)
    assert {key: found.get(key, {"not read"}) for key in cell.wanted} == {
        key: {verdict} for key, verdict in cell.wanted.items()
    }, listed
