"""Random KRL programs run with their own numbers and with those of corrected targets shifted.

Nothing but motions to a corrected target may differ, each by just that target's shift, and in the tool and base that
are stated. ``TRUEPOSE_EXECUTED_PROGRAMS`` is the number of programs of the second tier.
"""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from random import Random

import numpy as np
import pytest
from tests.programs.executors.krl import BASES, TOOLS, Event, Machine, Program, Writer, transform
from tests.programs.executors.krl_programs import Generator, smaller

from truepose.programs import FrameTable, ReadOptions, Target, read_program

FRAMES = FrameTable(
    tools={n: transform(np.array(values)) for n, values in TOOLS.items()},
    bases={0: np.eye(4), **{n: transform(np.array(values)) for n, values in BASES.items()}},
)
OPTIONS = (
    ReadOptions(),
    ReadOptions(derived=True),
    ReadOptions(whole_task=True),
    ReadOptions(whole_task=True, derived=True, ambiguous="skip"),
)
RUNS = 6


def fault_of(program: Program, folder: Path, seed: int) -> tuple[str, int]:
    """Return what a corrected program does wrong (empty: nothing), and how many motions to corrected targets ran."""
    options, split = OPTIONS[seed % len(OPTIONS)], seed % 5 == 4 and len(program.routines) > 1
    text = Writer(program, split=split)
    for name, data in text.files.items():
        (folder / name).write_text(data)
    if not split:
        (folder / "other.src").unlink(missing_ok=True)
    read = read_program(folder if split else folder / "cell.src", FRAMES, options)
    literals = {one.place: one for one in program.literals()}
    dice = Random(seed)
    shifts: dict[int, np.ndarray] = {}
    targets: list[tuple[Target, np.ndarray]] = []
    for target in read.targets:
        if target.verdict == "correct" and not target.follows:
            literal = literals[target.path.name, target.spans[0][0]]
            by = [dice.choice((-1, 1)) * dice.uniform(0.1, 0.9) for _ in range(3)]
            shifts[id(literal)] = np.array([*by, 0.0, 0.0, 0.0])
            targets.append((target, shifts[id(literal)]))
    moved = 0
    for run in range(RUNS):
        old, new = Machine(program), Machine(program, shifts)
        for again in range(2):
            for machine in (old, new):
                machine.run(Random(f"{seed} {run} {again}"))
        if len(old.events) != len(new.events):
            return "another course", moved
        for a, b in zip(old.events, new.events, strict=True):
            fault, n = difference(a, b, targets)
            moved += n
            if fault:
                return fault, moved
    return "", moved


def difference(a: Event, b: Event, targets: list[tuple[Target, np.ndarray]]) -> tuple[str, int]:
    """Return what differs wrongly between an event and the same one with shifted targets, and the shifted motions."""
    where = f"line {a.line} {a.word}"
    if (a.line, a.word, len(a.values), a.plain) != (b.line, b.word, len(b.values), b.plain):
        return f"{where}: another event", 0
    for one, other in ((a.tool, b.tool), (a.base, b.base)):
        if (one is None) != (other is None) or (one is not None and np.abs(one - other).max() > 1e-9):
            return f"{where}: another tool or base", 0
    moved = 0
    for one, other in zip(a.values, b.values, strict=True):
        by = np.asarray(other) - np.asarray(one)
        if np.abs(by).max() <= 1e-9:
            continue
        target = next((t for t, shift in targets if by.shape == (6,) and np.abs(by - shift).max() < 1e-7), None)
        if target is None:
            return f"{where}: differs by {by}", 0
        moved += 1
        frames = (a.tool, target.tf_flange_tool, "tool"), (a.base, target.tf_base_frame, "base")
        for real, stated, name in frames:
            if real is None or stated is None or not is_frame(tuple(real.tolist()), stated.tobytes()):
                return f"{where}: {target.name} is stated in another {name}", moved
        if not a.plain:
            return f"{where}: {target.name} in another mode, or shifted by a sensor", moved
    return "", moved


@lru_cache(maxsize=4096)
def is_frame(values: tuple[float, ...], stated: bytes) -> bool:
    """Return whether six coordinates are a stated frame."""
    return np.allclose(transform(values), np.frombuffer(stated).reshape(4, 4), atol=1e-6)


def reduced(program: Program, folder: Path, seed: int) -> Program:
    """Return a smaller program with a fault."""
    while less := next((one for one in smaller(program) if fault_of(one, folder, seed)[0]), None):
        program = less
    return program


def check(folder: Path, seeds: range) -> int:
    """Run programs; return how many motions to corrected targets ran."""
    moved = 0
    for seed in seeds:
        program = Generator(Random(seed)).program()
        fault, n = fault_of(program, folder, seed)
        moved += n
        if fault:
            program = reduced(program, folder, seed)
            fault, _ = fault_of(program, folder, seed)
            text = "\n".join(file.read_text() for file in sorted(folder.iterdir()))
            pytest.fail(f"seed {seed}: {fault}\n{text}")
    return moved


def test_corrected_programs_move_only_what_is_corrected(tmp_path: Path) -> None:
    assert check(tmp_path, range(40)) > 100


@pytest.mark.exhaustive
def test_many_corrected_programs_move_only_what_is_corrected(tmp_path: Path) -> None:
    check(tmp_path, range(1000, 1000 + int(os.environ.get("TRUEPOSE_EXECUTED_PROGRAMS", "2000"))))
