"""Injured programs of every language: our errors or nothing, and no change outside the digits of targets.

``python -m tests.programs.fuzz --seconds 3600`` injures programs for as long as one likes; the seed is told, and
``--seed`` repeats a run. Programs are those of the corpus, of the dialects' grammars, a KRL project in a folder, and
the makers' backups with some of their programs.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tests.programs.backups import kuka
from tests.programs.conftest import FakeMap
from tests.programs.corpus import CORPUS, FRAMES, Example
from tests.programs.fuzz_backups import injure_backup
from tests.programs.numbers import check_numbers
from tests.programs.test_dialects import DIALECTS, whole
from tests.programs.test_folders import FILES as PROJECT
from tests.programs.test_krl_grammar import REALISTIC_DAT, REALISTIC_SRC

from truepose.errors import TrueposeError
from truepose.programs import CorrectedProgram, FrameTable, ReadOptions, correct_program

Files = dict[str, bytes]
BACKUPS = 0.2
"""Share of backups among what is injured."""
BLANK = re.compile(rb"[0-9.+\-eE ]")
NASTY = [
    *(bytes([c]) for c in b"{}[](\"';\\\r\n=,:.-E\x00\xff#&<>/!$%"),
    *(b"9" * 400, b"1.2.3", b"--5", b"1e999", b"nan", b"inf", b"********", b"\xef\xbb\xbf", b"\r", b"\n\n"),
    *(b" LIN ", b"PTP ", b"XP1", b"WITH $TOOL=", b"$BASE=x\n", b"DEF y()\n", b"'B010'", b"{X 1,Y 2,Z 3,A 0,B 0,C 0}"),
    *(b"MoveL ", b"P[1]", b"p[", b"END\n", b"ENDIF", b"IF a THEN\n", b"GOTO x\n", b"GOTO/", b"C00001=", b"<Value "),
    *(b"[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]", b"set_tcp(p[0,0,1,0,0,0])", b"X1 Y2 Z3", b"/POS\n"),
    *(b"LIN {X 1.5,Y 2.5,Z 3.5,A 0,B 90,C 0} C_DIS\n" * 20, b"G2 ", b"G91 ", b"Offs(p1,0,0,1)", b"UFRAME_NUM=9 ;\n"),
    *(
        b"E+02",
        b"e5",
        b"D3",
        b"1D3",
        b"+.5",
        b"    :L P[2] 9% FINE;\n",
        b"Track TAST[1] ;\n",
        b"force_mode(a,b)\n",
        b"RSI_ON()\n",
    ),
    *(b"SYSTART CV#(1)\n", b"WaitWObj w;\n", b"local ", b"J PAL_1[A_1] 9% FINE ;\n", b"my_move(p[0,0,0,0,0,0])\n"),
    *(
        b" COORD ",
        b" Offset,PR[2] ",
        b"PR[1,3]=",
        b"LPOS",
        b"GP2:\n",
        b"  CALL X ;\n",
        b"UF : F",
        b"FOR R[1]=0 TO 3 ;\n",
    ),
    *(b"SFTON P010 UF#(3)\r\n", b"SETE P020 (3) 5\r\n", b"CALL JOB:DIP UF#(2)\r\n", b"ENDSWITCH\r\n"),
    *(b"appro(", b"pUp=pPart1\n", b"geo:fCell.trsf.z=3\n", b"[nI]", b"<Field name=", b"endFor\n", b"taskCreate "),
]


def mutate(rng: np.random.Generator, data: bytes) -> bytes:
    """Return the bytes with one to three injuries."""
    for _ in range(rng.integers(1, 4)):
        a, b = sorted(rng.integers(0, len(data) + 1, 2).tolist())
        b = min(b, a + 40)
        middle = [
            b"",
            bytes(rng.integers(0, 256, 3).tolist()),
            data[a:b] * 2,
            data[a:b] + NASTY[rng.integers(len(NASTY))],
            NASTY[rng.integers(len(NASTY))],
            data[a:b].swapcase(),
        ][rng.integers(6)]
        data = data[:a] + middle + data[b:]
        if rng.random() < 0.05:
            data = data[: rng.integers(0, len(data) + 1)]
    return data


def programs() -> Iterator[tuple[str, Files, FrameTable, ReadOptions]]:
    """Yield names, files (the first is given; none: their folder), frames and options."""
    for name, example in CORPUS.items():
        yield f"corpus {name}", example.data(), example.frames, example.options
    for name, dialect in DIALECTS.items():
        frames = FrameTable(FRAMES.tools, FRAMES.bases, tool="map", base=0)
        yield f"grammar {name}", {f"a{dialect.ending}": whole(dialect)}, frames, dialect.options
    yield "realistic", {"a.src": REALISTIC_SRC, "a.dat": REALISTIC_DAT}, FRAMES, ReadOptions()
    project = Example(PROJECT, 0)
    yield "project", {"": b"", **project.data()}, FRAMES, ReadOptions()
    yield "backup of KUKA", {"": b"", **kuka.few()}, FrameTable(), ReadOptions(derived=True)


class Turning(FakeMap):
    """Turns every target a little, too, where orientation is asked for."""

    def correct(self, poses: np.ndarray, **more: Any) -> Any:
        """Return the answer."""
        answer = super().correct(poses, **more)
        turn = np.full((len(poses), 3), 1e-3 if np.any(self.shift) else 0.0)
        answer.rotation = turn if more["orientation"] else None
        return answer


def attempt(path: Path, shift: Any, frames: FrameTable, options: ReadOptions, **more: Any) -> CorrectedProgram | str:
    """Correct a program; return it, or why not."""
    try:
        return correct_program(path, Turning(shift), frames=frames, options=options, **more)
    except TrueposeError as error:
        return str(error)


def injure(rng: np.random.Generator, folder: Path, files: Files, frames: FrameTable, options: ReadOptions) -> bool:
    """Try one injured program; return whether it was corrected."""
    shutil.rmtree(folder, ignore_errors=True)
    whole_folder = "" in files
    names = [name for name in files if name]
    hurt = set(rng.choice(names, rng.integers(1, min(len(names), 4) + 1), replace=False).tolist())
    original = {folder / name: mutate(rng, files[name]) if name in hurt else files[name] for name in names}
    for path, data in original.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    path = folder if whole_folder else folder / names[0]
    more = {"on_guard": ["refuse", "skip", "clip"][rng.integers(3)], "orientation": bool(rng.random() < 0.3)}
    zero = attempt(path, [0.0, 0.0, 0.0], frames, options, **more)
    moved = attempt(path, [0.5, -0.25, 0.125], frames, options, **more)
    if isinstance(zero, str) or isinstance(moved, str):
        assert zero == moved, (original, zero, moved)
        assert "\n" not in str(zero), original
        return False
    assert all(data == original[file] for file, data in zero.files.items()), original
    assert all(BLANK.sub(b"", data) == BLANK.sub(b"", original[file]) for file, data in moved.files.items()), original
    check_numbers(moved, {file: original[file] for file in moved.files})
    return True


def run(seconds: float, seed: int) -> tuple[int, int]:
    """Injure programs for a time; return how many were tried, and how many corrected."""
    rng, end = np.random.default_rng(seed), time.monotonic() + seconds
    known = list(programs())
    tried = corrected = 0
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < end:
            name, *program = known[rng.integers(len(known))]
            try:
                if rng.random() < BACKUPS:
                    name = "backup"
                    corrected += injure_backup(rng, Path(folder) / "a", mutate, partial(BLANK.sub, b""))
                else:
                    corrected += injure(rng, Path(folder) / "a", *program)
            except Exception as error:
                error.add_note(f"{name}, seed {seed}, program {tried}")
                raise
            tried += 1
    return tried, corrected


def main() -> None:
    """Injure programs for a time."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # robots and frames that backups name otherwise
    tried, corrected = run(arguments.seconds, arguments.seed)
    sys.stdout.write(
        f"seed {arguments.seed}: {tried} programs, {corrected} corrected, no crash, no change outside digits\n"
    )


if __name__ == "__main__":
    main()
