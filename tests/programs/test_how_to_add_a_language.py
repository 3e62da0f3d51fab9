"""The worked example of docs/how-to/add-a-language.md reads, corrects and refuses as the page says."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from truepose.errors import FileError, RefusedError
from truepose.programs import FrameTable, correct_program, read_program
from truepose.programs.languages import LANGUAGES, Language

FOLDER = Path(__file__).parents[2] / "docs" / "how-to" / "files" / "language"


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.setitem(LANGUAGES, "step", Language("", ()))  # removed again after the test
    # [name]
    LANGUAGES["step"] = Language("step", endings=(".step",))
    # [/name]
    return Path(shutil.copy(FOLDER / "weld.step", tmp_path))


def test_the_verdicts(path: Path, frames: FrameTable) -> None:
    program = read_program(path, frames)
    assert [(target.name, target.verdict) for target in program.targets] == [
        ("p1", "correct"),
        ("p2", "skip"),
        ("AXES:6", "skip"),
        ("LINE:8", "correct"),
        ("SWEEP:10", "refuse"),
    ]
    assert [target.tool for target in program.targets if target.verdict == "correct"] == ["TOOL 1", "TOOL 1"]
    assert program.targets[4].reason == "looks like a motion that is not known: SWEEP p1"


def test_only_digits_of_corrected_targets_change(path: Path, frames: FrameTable, make_map: Any) -> None:
    before = path.read_bytes().splitlines()
    with pytest.raises(RefusedError, match="SWEEP"):
        correct_program(path, make_map([0.5, 0.0, 0.0]), frames=frames)
    corrected = correct_program(path, make_map([0.5, 0.0, 0.0]), frames=frames, on_guard="skip")
    after = corrected.files[path].splitlines()
    assert [k for k, pair in enumerate(zip(before, after, strict=True), 1) if pair[0] != pair[1]] == [4, 8]
    assert correct_program(path, make_map(), frames=frames, on_guard="skip").files[path].splitlines() == before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("STEP weld", "weld", "does not start with STEP"),
        ("812.5", "812.5.1", r"weld\.step:4: x: 812\.5\.1 is not a number"),
        ("TOOL 1", "TOOL one", r"weld\.step:2: TOOL: expected a number"),
    ],
)
def test_broken_files(path: Path, frames: FrameTable, old: str, new: str, message: str) -> None:
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileError, match=message):
        read_program(path, frames)
