"""Programs as they are met: sensible verdicts, nothing changed by zero, nothing but digits changed otherwise."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.programs.corpus import CORPUS, Example

from truepose.errors import RefusedError
from truepose.programs import Program, correct_program, read_program

BLANK = re.compile(rb"[0-9.+\-eE ]")


def lay(folder: Path, example: Example) -> Path:
    for name, data in example.data().items():
        (folder / name).write_bytes(data)
    return folder / next(iter(example.files))


def listed(program: Program) -> str:
    return "\n".join(f"{t.line} {t.name} {t.motion}: {t.verdict} {t.reason}" for t in program.targets)


@pytest.mark.sampled(30)
@pytest.mark.parametrize("name", CORPUS)
def test_verdicts(tmp_path: Path, name: str) -> None:
    example = CORPUS[name]
    program = read_program(lay(tmp_path, example), example.frames, example.options)
    wanted = {"correct": example.correct, "skip": example.skip, "refuse": example.refuse}
    assert program.counts() == wanted, listed(program)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", CORPUS)
def test_only_digits_change(tmp_path: Path, make_map: Any, name: str) -> None:
    example = CORPUS[name]
    path = lay(tmp_path, example)

    def attempt(shift: list[float]) -> dict[Path, bytes]:
        more = {"frames": example.frames, "options": example.options, "on_guard": "skip"}
        return correct_program(path, make_map(shift), **more).files

    before = {tmp_path / file: data for file, data in example.data().items()}
    if not example.correct and (example.skip or example.refuse):
        with pytest.raises(RefusedError, match="nothing can be corrected"):
            attempt([1.0, 0.0, 0.0])
        return
    assert attempt([0.0, 0.0, 0.0]) == before
    after = attempt([0.5, -0.25, 0.125])
    assert {p: BLANK.sub(b"", data) for p, data in after.items()} == {p: BLANK.sub(b"", d) for p, d in before.items()}
    assert (after != before) == bool(example.correct)
