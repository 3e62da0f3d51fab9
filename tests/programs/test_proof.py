"""The corrected program is read again, in full, before anything is written."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus import CORPUS
from tests.programs.test_corpus import lay

from truepose.errors import DataError, RefusedError, TrueposeError
from truepose.programs import FrameTable, Program, correct_program, proof, read_program
from truepose.programs.core import outcomes
from truepose.programs.core.digits import written
from truepose.programs.core.source import Source, replaced
from truepose.programs.krl import reader as krl

BODY = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
LINE = "LIN {{X {},Y 2.25,Z 3,A 0,B 0,C 0}}\n"


def long_program(pair: Any, n: int = 40) -> Path:
    """A run of alike lines between others, which are read in another way."""
    inline = "".join(LINE.format(f"{k}.5") for k in range(n))
    return pair(
        f"DEF cell( )\n{BODY}PTP {{A1 0}}\n{inline}LIN XP1\n{LINE.format(7)}END\n",
        "DEFDAT CELL\nDECL E6POS XP1={X 1,Y 2,Z 3,A 0,B 0,C 0,S 2,T 10}\nENDDAT\n",
    )


@pytest.mark.promise("every corrected program is read again in full, and every target compared with what was meant")
@pytest.mark.parametrize("axis", range(3))
def test_a_patch_that_writes_another_number_is_refused(
    pair: Any, make_map: Any, monkeypatch: pytest.MonkeyPatch, axis: int
) -> None:
    path = long_program(pair)

    def wrong(data: bytes, spans: Any, values: Any, after: Any, resolution: float) -> list[bytes]:
        texts = written(data, spans, values, after, resolution)
        for k, (start, _) in enumerate(spans.tolist()):
            if data[start - 2 : start] == b"%c " % b"XYZ"[axis] and texts[k].startswith(b"2"):
                texts[k] = b"9" + texts[k][1:]  # a word of its own still, which is what the first proof asks for
        return texts

    shift = [2.0 if axis == 0 else 0.25] * 3
    shift[axis] = [2.0, 0.25, -0.25][axis]
    correct_program(path, make_map(shift))
    monkeypatch.setattr(outcomes, "written", wrong)
    with pytest.raises(
        RefusedError, match=r"cell\.\w+:\d+: \w+(:\d+)?: the corrected program reads otherwise: .* meant"
    ):
        correct_program(path, make_map(shift))


@pytest.mark.promise("a corrected program whose targets are others in number, name, frame or verdict is refused")
def test_another_program_is_refused(pair: Any, frames: FrameTable, make_map: Any, record_property: Any) -> None:
    path = long_program(pair)
    corrected = correct_program(path, make_map([0.25, 0.5, -0.125]))
    files = corrected.files
    proof.prove_meaning(corrected.targets, files)
    src, dat = path, path.with_suffix(".dat")
    injuries = {
        src: [
            (b"LIN {X 3.75", b"PTP {X 3.75"),
            (b"LIN {X 3.75", b"LIN {X 3.76"),
            (b"LIN {X 3.75,Y 2.75", b"LIN {X 3.75,Y 2.7500001"),
            (b"A 0,B 0,C 0}\nLIN XP1", b"A 0,B 0,C 0.1}\nLIN XP1"),
            (b"PTP {A1 0}\n", b""),
            (b"PTP {A1 0}\n", b"PTP {A1 0}\n\n"),
            (b"$TOOL=$NULLFRAME", b"$TOOL={X 1,Y 0,Z 0,A 0,B 0,C 0}"),
            (b"$BASE=$NULLFRAME\n", b"$BASE=BASE_DATA[1]\n"),
            (b"LIN XP1", b"LIN_REL {X 1}"),
            (b"END\n", b""),
        ],
        dat: [(b"S 2", b"S 3"), (b"T 10", b"T 11"), (b"X 1.25", b"X 1.5"), (b"X 1.25", b"X 1.2.5")],
    }  # fmt: skip
    record_property("cases", sum(map(len, injuries.values())))
    for file, replacements in injuries.items():
        for old, new in replacements:
            assert old in files[file]
            with pytest.raises(RefusedError, match="corrected program"):
                proof.prove_meaning(corrected.targets, {**files, file: files[file].replace(old, new, 1)})


@pytest.mark.promise("the proof reads every language of the corpus again, and finds one changed digit of any target")
def test_one_digit_in_every_language(tmp_path: Path, make_map: Any, record_property: Any) -> None:
    cases = 0
    for name, example in CORPUS.items():
        if not example.correct:
            continue
        folder = tmp_path / name
        folder.mkdir()
        path = lay(folder, example)
        more = {"frames": example.frames, "options": example.options, "on_guard": "skip"}
        corrected = correct_program(path, make_map([0.5, -0.25, 0.125]), **more)
        files = corrected.files
        for outcome in corrected.targets:
            if outcome.verdict != "correct":
                continue
            file = outcome.target.path
            old = read_program(path, example.frames, example.options)
            with replaced(files):
                again = read_program(path, example.frames, example.options)
            assert [t.verdict for t in again.targets] == [t.verdict for t in old.targets]
            start, end = next(t for t in again.targets if (t.name, t.line) == (outcome.name, outcome.line)).spans[0]
            k = next(k for k in range(end - 1, start - 1, -1) if files[file][k : k + 1].isdigit())
            digit = b"%d" % ((int(files[file][k : k + 1]) + 1) % 10)
            hurt = {**files, file: files[file][:k] + digit + files[file][k + 1 :]}
            with pytest.raises(RefusedError, match=re.escape(f"{outcome.name}: the corrected program reads otherwise")):
                proof.prove_meaning(corrected.targets, hurt)
            cases += 1
            break
    record_property("cases", cases)
    assert cases > 20


def test_targets_that_are_not_corrected_keep_every_digit(pair: Any, make_map: Any) -> None:
    path = long_program(pair)
    corrected = correct_program(path, make_map([0.25, 0.0, 0.0], {3: "far away"}), on_guard="skip")
    assert corrected.targets[4].verdict == "skip"
    hurt = {**corrected.files, path: corrected.files[path].replace(b"LIN {X 3.5,", b"LIN {X 3.500000001,")}
    with pytest.raises(RefusedError, match=r"LIN:8: the corrected program reads otherwise: its 1\. number"):
        proof.prove_meaning(corrected.targets, hurt)


def test_every_correction_is_within_half_a_digit(pair: Any, make_map: Any) -> None:
    rng = np.random.default_rng(5)
    path, shift = long_program(pair), rng.uniform(-1, 1, (42, 3))
    for resolution in (1e-3, 0.05, 1.0):
        corrected = correct_program(path, make_map(shift), resolution=resolution)
        moved = np.array([t.correction for t in corrected.targets if t.verdict == "correct"])
        assert np.abs(moved - shift).max() <= resolution / 2 + 1e-9


def test_a_program_that_cannot_be_read_again_is_refused(pair: Any, frames: FrameTable, make_map: Any) -> None:
    program: Program = read_program(long_program(pair), frames)
    with pytest.raises(DataError, match="cannot be read again for the proof; read it with read_program"):
        correct_program(replace(program, again=None), make_map())
    bare = krl.read(program.path, frames, program.again.args[2])  # type: ignore[union-attr]
    with pytest.raises(TrueposeError):
        correct_program(bare, make_map())


def test_other_bytes_in_place_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.src"
    path.write_bytes(b"old")
    with replaced({path: b"new"}):
        assert Source.read(path).data == b"new"
    assert Source.read(path).data == b"old"
