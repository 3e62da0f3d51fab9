"""Random URScript programs run with their own numbers and with corrected ones: only what was corrected may differ.

``TRUEPOSE_FUZZ_SECONDS`` says how long the second tier tries further programs.
"""

from __future__ import annotations

import itertools
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from tests.programs.executors.urscript import STORED, Motion, Syntax, execute, transform
from tests.programs.executors.urscript_programs import write

from truepose.errors import FileError
from truepose.programs import FrameTable, ReadOptions, Target, read_program

RUNS = 4
OPTIONS = [ReadOptions(joint_targets=True), ReadOptions(joint_targets=True, derived=True)]


def millimetres(tf: np.ndarray) -> np.ndarray:
    return np.block([[tf[:3, :3], 1000.0 * tf[:3, 3:]], [tf[3:]]])


FRAMES = FrameTable(bases={name: millimetres(transform(pose)) for name, pose in STORED.items()}, tool="map")


def corrected(text: str, targets: list[Target], random: Random) -> tuple[str, list[np.ndarray]]:
    """Return a program with other numbers, and the shift of each target: of a pose in the base [m], or of joints."""
    shifts, patches = [], []
    for target in targets:
        n = 3 if target.joints is None else 6
        shift = own = np.array([random.uniform(-0.2, 0.2) for _ in range(n)])
        if target.tf_base_frame is not None and target.joints is None:
            own = target.tf_base_frame[:3, :3].T @ shift
        shifts.append(shift)
        patches += [(a, b, float(text[a:b]) + more) for (a, b), more in zip(target.spans, own, strict=False)]
    for a, b, value in sorted(patches, reverse=True):
        text = f"{text[:a]}{value:.15f}{text[b:]}"
    return text, shifts


def differing(old: Motion, new: Motion, targets: list[Target], shifts: list[np.ndarray]) -> str:
    """Return what is wrong with two motions that should differ in the shift of a target alone; empty if nothing is."""
    if old._replace(goal=new.goal) != new:
        return "goes on in another way"
    if old.kind == "joints":
        moved = np.subtract(new.goal, old.goal)
    else:
        moved = np.subtract(new.goal, old.goal)[:3]
        if np.abs(transform(old.goal)[:3, :3] - transform(new.goal)[:3, :3]).max() > 1e-9:
            return "is turned"
    if np.abs(moved).max() < 1e-12:
        return ""
    alike = [len(shift) == len(moved) and np.abs(shift - moved).max() < 1e-9 for shift in shifts]
    if not any(alike):
        return f"moves by {moved}, which is the shift of no target"
    target = targets[alike.index(True)]
    tool = None if target.tf_flange_tool is None else target.tf_flange_tool
    in_force = None if old.tcp is None else millimetres(transform(old.tcp))
    if (tool is None) != (in_force is None) or (tool is not None and np.abs(tool - in_force).max() > 1e-6):
        return f"goes to {target.name} with TCP {old.tcp}, stated is {target.tool}"
    if old.kind not in ("pose", "joints"):
        return f"{old.kind}: {target.name}"
    return f"goes to {target.name} shifted by {sorted(old.shifts)}" if old.shifts else ""


def fault(path: Path, text: str, options: ReadOptions, seed: int) -> tuple[str, int]:
    """Return what a correction would do wrong, or an empty text; and the number of corrected targets."""
    path.write_text(text)
    try:
        program = read_program(path, FRAMES, options)
    except FileError:
        return "", 0
    targets = [target for target in program.targets if target.verdict == "correct"]
    if not targets:
        return "", 0
    other, shifts = corrected(text, targets, Random(seed))
    for run in range(RUNS):
        for old, new in itertools.zip_longest(execute(text, seed + run), execute(other, seed + run)):
            if isinstance(old, Motion) and isinstance(new, Motion):
                why = differing(old, new, targets, shifts)
            else:
                why = "" if old == new else f"{old} becomes {new}"
            if why:
                return f"line {getattr(old, 'line', 0)}, seed {seed + run}: {why}", len(targets)
    return "", len(targets)


def smaller(lines: list[str]) -> Iterator[list[str]]:
    """Yield programs with a line, a block, or the lines around a block left out."""
    for k, line in enumerate(lines):
        if re.match(r"\s*(?:if|while|def|thread)\b.*:\s*$", line):
            depth = len(line) - len(line.lstrip())
            last = next(i for i in range(k + 1, len(lines)) if lines[i].rstrip() == " " * depth + "end")
            yield [*lines[:k], *lines[last + 1 :]]
            if not re.match(r"\s*(?:def|thread)\b", line):
                yield [*lines[:k], *lines[k + 1 : last], *lines[last + 1 :]]
        yield [*lines[:k], *lines[k + 1 :]]


def reduced(path: Path, text: str, options: ReadOptions, seed: int) -> str:
    """Return a small program with the fault of a larger one."""
    lines, done = text.splitlines(), False
    while not done:
        done = True
        for fewer in smaller(lines):
            try:
                if any(fault(path, "\n".join(fewer) + "\n", options, seed + 10 * k)[0] for k in range(3)):
                    lines, done = fewer, False
                    break
            except (Syntax, StopIteration):
                continue
    return "\n".join(lines) + "\n"


def try_programs(path: Path, seeds: Any) -> tuple[int, int]:
    """Try random programs; return their number and that of the corrected targets."""
    programs = count = 0
    for seed in seeds:
        text, options = write(Random(seed)), OPTIONS[seed % len(OPTIONS)]
        why, n = fault(path, text, options, seed)
        if why:
            small = reduced(path, text, options, seed)
            whys = [fault(path, small, options, seed + 10 * k)[0] for k in range(3)]
            pytest.fail(f"program {seed}, derived={options.derived}: {next(filter(None, whys), why)}\n{small}")
        programs, count = programs + 1, count + n
    return programs, count


def test_nothing_but_corrected_targets_moves(tmp_path: Path) -> None:
    _, count = try_programs(tmp_path / "a.script", range(60))
    assert count > 60


@pytest.mark.exhaustive
def test_further_programs(tmp_path: Path) -> None:
    end = time.monotonic() + float(os.environ.get("TRUEPOSE_FUZZ_SECONDS", "60"))
    seeds = itertools.takewhile(lambda _: time.monotonic() < end, itertools.count(1000))
    programs, count = try_programs(tmp_path / "a.script", seeds)
    assert count > programs
