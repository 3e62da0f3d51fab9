"""Every hazard in every language that has it: no target that the hazard touches is corrected."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from tests.programs.example import FRAMES
from tests.programs.hazards import HAZARDS, LANGUAGES, Cell

from truepose.programs import read_program

WITHOUT_TOOL = replace(FRAMES, tool="map")  # scripts that set no TCP
TABLE = {language: import_module(f"tests.programs.hazards.{language}") for language in LANGUAGES}
CELLS = [
    pytest.param(
        language,
        cell,
        id=f"{language}-{hazard}-{i}",
        marks=[pytest.mark.xfail(reason=cell.fault)] if cell.fault else [],
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


@pytest.mark.parametrize(("language", "cell"), CELLS)
def test_verdicts(tmp_path: Path, language: str, cell: Cell) -> None:
    for name, text in cell.files.items():
        (tmp_path / name).write_bytes(text.encode("utf-8"))
    frames = cell.frames or (WITHOUT_TOOL if language == "urscript" else FRAMES)
    program = read_program(tmp_path / next(iter(cell.files)), frames, cell.options)
    found: dict[str, set[str]] = {}
    for target in program.targets:
        for key in (target.name, f"line {target.line}"):
            found.setdefault(key, set()).add(target.verdict)
    listed = "\n".join(f"{t.line} {t.name} {t.motion}: {t.verdict} {t.reason}" for t in program.targets)
    assert {key: found.get(key, {"not read"}) for key in cell.wanted} == {
        key: {verdict} for key, verdict in cell.wanted.items()
    }, listed
