"""Runs of alike lines are read to the same targets as line by line, on the whole grammar and at its edges."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, Target, correct_program, read_program
from truepose.programs.krl.runs import FEWEST, Run, find_run

NUMBER = st.one_of(
    st.decimals(-99999, 99999, places=3).map(str),
    st.from_regex(r"\A[+-]?[0-9]{1,7}(\.[0-9]{0,17})?([eE][+-]?[0-9]{1,2})?\Z"),
)
BLANK = st.sampled_from([" ", "  ", "\t", ""])
WORD = st.sampled_from(["LIN", "lin", "PTP", "SLIN", "SPTP", "SPL", "CIRC", "LIN_REL", "XLIN", "LINX"])
TAIL = st.sampled_from(
    ["", "", " C_DIS", " C_PTP C_DIS", " c_vel ", " C_NONE", " ; {X 1", ";x \xe4", ' ; "', "\\", ","]
)
BRANCH = st.sampled_from(
    ["", "", ",S 2,T 10", ",S 18,T 3", ",S 6,T 1234", ",S 'B010',T 2", ",S 2", ",E1 5", ",S 99,T 0"]
)


@st.composite
def line(draw: Any) -> str:
    keys = draw(st.sampled_from(["XYZABC"] * 8 + ["XYZABB", "XYZ", "YXZABC", "xyzabc"]))
    gap, before = draw(BLANK) or " ", draw(BLANK)
    numbers = [f"{before if k else ''}{key}{gap}{draw(NUMBER)}" for k, key in enumerate(keys)]
    return f"{draw(BLANK)}{draw(WORD)}{draw(BLANK)}{{{','.join(numbers)}{draw(BRANCH)}}}{draw(TAIL)}"


@st.composite
def bodies(draw: Any) -> str:
    plain = [f"LIN {{X {k}.25,Y -{k}.5,Z 300,A 0.0,B 9E-3,C -180}} C_DIS" for k in range(12)]
    parts = draw(st.lists(st.one_of(line().map(lambda one: [one]), st.just(plain)), min_size=1, max_size=8))
    lines = [text for part in parts for text in part]
    ends = draw(st.lists(st.sampled_from(["\n", "\r\n", "\r"]), min_size=len(lines), max_size=len(lines)))
    return "".join(text + end for text, end in zip(lines, ends, strict=True))


FRAMES = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)})


def told(folder: Path, body: str, fewest: int) -> list[tuple[Any, ...]] | str:
    path = folder / "a.src"
    path.write_bytes(f"DEF a()\nBAS(#TOOL,1)\nBAS(#BASE,1)\n{body}END\n".encode("latin-1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truepose.programs.krl.runs.FEWEST", fewest)
        try:
            program = read_program(path, FRAMES)
        except FileError as error:
            return str(error)
    names = [f.name for f in fields(Target) if not f.name.startswith("tf_")]
    return [tuple(getattr(target, name) for name in names) for target in program.targets]


@settings(max_examples=examples(80))
@given(body=bodies())
def test_runs_and_single_lines_agree(body: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("runs")
    assert told(folder, body, 1) == told(folder, body, 10**9)


def long_program(folder: Path, n: int, ending: str = "\n", branch: str = "") -> tuple[Path, Program]:
    rng = np.random.default_rng(1)
    lines = [
        "LIN {" + ",".join(f"{k} {v:.3f}" for k, v in zip("XYZABC", row, strict=True)) + f"{branch}}} C_DIS ;{{{ending}"
        for row in rng.uniform(-180, 180, (n, 6))
    ]
    path = folder / "long.src"
    path.write_text(f"DEF a()\nBAS(#TOOL,1)\nBAS(#BASE,1)\n{''.join(lines)}END\n", newline="")
    return path, read_program(path, FRAMES)


@pytest.mark.parametrize(("ending", "branch"), [("\n", ""), ("\r\n", ",S 2,T 35"), ("\r\n", "")])
def test_a_long_program_is_read_in_runs(tmp_path: Path, ending: str, branch: str) -> None:
    path, program = long_program(tmp_path, 10_000, ending, branch)
    runs = [piece for piece, _ in program.targets._pieces]
    assert [type(run) for run in runs] == [Run] * 5
    target = program.targets[9_999]
    assert (target.name, target.line, target.status) == ("LIN:10003", 10_003, 2 if branch else None)
    text = path.read_bytes().splitlines()[10_002].split(b"{")[1].split(b"}")[0]
    numbers = [float(word.split()[1]) for word in text.split(b",")]
    assert [*target.xyz, *target.angles, *(numbers[6:])] == numbers
    assert [path.read_bytes()[a:b] for a, b in target.spans] == [word.split()[1] for word in text.split(b",")[:6]]
    assert program.counts() == {"correct": 10_000, "skip": 0, "refuse": 0}


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("n", "steps"), [(60, [60]), (9_000, [2048, 4096, 6144, 8192, 9000])])
def test_a_long_program_is_corrected_like_a_short_one(tmp_path: Path, make_map: Any, n: int, steps: list[int]) -> None:
    path, _ = long_program(tmp_path, n, "\r\n")
    shift = np.random.default_rng(2).uniform(-1, 1, (n, 3))
    told_: list[tuple[int, int]] = []
    corrected = correct_program(path, make_map(shift), frames=FRAMES, progress=lambda *now: told_.append(now))
    assert told_ == [(done, n) for done in steps]
    lines = zip(path.read_text().splitlines()[3:-1], corrected.files[path].decode().splitlines()[3:-1], strict=True)
    for k, (before, after) in enumerate(lines):
        old, new = ([float(w.split()[1]) for w in text[5:].split("}")[0].split(",")] for text in (before, after))
        np.testing.assert_allclose(np.subtract(new, old)[:3], shift[k], atol=0.5001e-3)
        assert new[3:] == old[3:]
    assert correct_program(path, make_map(), frames=FRAMES).files[path] == path.read_bytes()


def test_short_runs_are_no_runs(tmp_path: Path) -> None:
    line = b"LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\n"
    assert find_run(line * 3 + b"END\n", 0) == (90, 3)
    assert find_run(b"END\n", 0) == (0, 0)
    assert find_run(line * 3, 1) == (1, 0)
    assert FEWEST > 3


@pytest.mark.parametrize("stage", ["correcting", "writing"])
def test_an_interrupt_leaves_nothing_half_written(
    tmp_path: Path, make_map: Any, stage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = long_program(tmp_path, 9_000)

    def interrupt(done: int, _all: int) -> None:
        if done > 5_000 and stage == "correcting":
            raise KeyboardInterrupt

    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        corrected = correct_program(path, make_map([1, 0, 0]), frames=FRAMES, progress=interrupt)
        calls: list[int] = []
        real = np.round

        def rounding(*args: Any) -> Any:
            calls.append(1)
            if len(calls) == 2:
                raise KeyboardInterrupt
            return real(*args)

        monkeypatch.setattr("truepose.programs.record.np.round", rounding)
        corrected.write(tmp_path / "out") if stage == "writing" else None
    monkeypatch.undo()
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []
