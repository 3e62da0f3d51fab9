"""Programs run with their own numbers and with corrected ones: what the direct executors of languages have in common.

A fault is a difference between both runs that is not the shift of a target which is corrected, in the frame and with
the tool that its verdict states.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import NamedTuple

import numpy as np
import pytest

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, Target, read_programs

Files = dict[str, str]
RUNS = 3
MORE_RUNS = 200
_SAME = 1e-6  # [mm]


class Motion(NamedTuple):
    """A motion: to a point in the base [mm], with a tool, while something shifts it by an unknown amount or not."""

    line: str
    goal: tuple[float, ...]
    tool: object
    lost: frozenset[str] = frozenset()


Event = Motion | tuple[object, ...]
Execute = Callable[[Files, int], Sequence[Event]]


class Syntax(Exception):  # noqa: N818 - of programs, not of tests
    """The program is none of the language."""


class Language(NamedTuple):
    """A language under test.

    Attributes
    ----------
    write : callable
        A function that returns a random program.
    execute : callable
        A function that returns what a program does, given a number that decides all inputs.
    frames : FrameTable
        The frames and tools.
    options : sequence of ReadOptions
        The options to read with, in turn.
    tool_of : callable
        A function that returns the tool of a motion as it is in the frame table, (4, 4) [mm]; None for none.
    """

    write: Callable[[Random], Files]
    execute: Execute
    frames: FrameTable
    options: Sequence[ReadOptions]
    tool_of: Callable[[object], FloatArray | None]


class Moved(NamedTuple):
    """A corrected target and its shift in the base, (3,) [mm]."""

    target: Target
    shift: FloatArray


def corrected(files: Files, programs: Sequence[Program], random: Random) -> tuple[Files, list[Moved]]:
    """Return a program with a shift of its own for each target that may be corrected, and these targets."""
    patches: dict[str, list[tuple[int, int, str]]] = {}
    moved: list[Moved] = []
    for program in programs:
        for target in program.targets:
            if target.verdict != "correct":
                continue
            shift = np.array([random.randrange(1000, 9000) / 1000 for _ in range(3)])
            frame = np.eye(4) if target.tf_base_frame is None else target.tf_base_frame
            moved.append(Moved(target, frame[:3, :3] @ shift))
            name = target.path.name
            for (a, b), more in zip(target.spans[:3], shift, strict=True):
                patches.setdefault(name, []).append((a, b, f"{float(files[name][a:b]) + more:.3f}"))
    new = dict(files)
    for name, some in patches.items():
        text = new[name]
        for a, b, digits in sorted(some, reverse=True):
            text = text[:a] + digits + text[b:]
        new[name] = text
    return new, moved


def differing(old: Motion, new: Motion, moved: Sequence[Moved], tool_of: Callable[[object], FloatArray | None]) -> str:
    """Return what is wrong with two motions that may differ by the shift of one target; empty if nothing is."""
    if old._replace(goal=new.goal) != new:
        return "goes on in another way"
    by = np.subtract(new.goal, old.goal)
    if np.abs(by).max() < _SAME:
        return ""
    one = next((one for one in moved if np.abs(one.shift - by).max() < _SAME), None)
    if one is None:
        return f"moves by {by.round(3)}, which is the shift of no target"
    target = one.target
    tool = tool_of(old.tool)
    if tool is not None and (target.tf_flange_tool is None or np.abs(tool - target.tf_flange_tool).max() > _SAME):
        return f"goes to {target.name} with tool {old.tool}, stated is {target.tool}"
    if old.lost:
        return f"goes to {target.name} while {sorted(old.lost)} shifts it"
    if not any(np.abs(goal - old.goal).max() < _SAME for goal in _goals(target)):
        return f"goes to {old.goal}, which is not where {target.name} is stated to be"
    return ""


def _goals(target: Target) -> Iterator[FloatArray]:
    """Yield the places of a target and of the positions that are derived from it, in the base."""
    assert target.rotation is not None
    frame = np.eye(4) if target.tf_base_frame is None else target.tf_base_frame
    shifts = [np.zeros(3)] if target.motions else []
    for one in target.derived:
        shifts += list(one.vectors(target.rotation)[0])
    for shift in shifts:
        yield frame[:3, :3] @ (target.p + shift) + frame[:3, 3]


def fault(folder: Path, language: Language, files: Files, options: ReadOptions, seed: int) -> tuple[str, int]:
    """Return what a correction would do wrong, empty if nothing; and the number of corrected targets."""
    for old_file in folder.iterdir():
        old_file.unlink()
    for name, text in files.items():
        (folder / name).write_text(text)
    try:
        programs = read_programs([folder], language.frames, options).programs
    except FileError:
        return "", 0
    other, moved = corrected(files, programs, Random(seed))
    stopped, reached = set[str](), set[str]()
    for run in range(RUNS if moved else 0):
        before, after = language.execute(files, seed + run), language.execute(other, seed + run)
        stopped |= stops_in(before)
        reached |= reached_in(before)
        for old, new in itertools.zip_longest(before, after):
            if isinstance(old, Motion) and isinstance(new, Motion):
                why = differing(old, new, moved, language.tool_of)
            else:
                why = "" if old == new else f"{old} becomes {new}"
            if why:
                return f"{getattr(old, 'line', '')}: {why}", len(moved)
    for one in moved:
        label = f"{one.target.path.name} {one.target.name}"
        more = (reached_in(language.execute(files, seed + run)) for run in range(RUNS, MORE_RUNS))
        if label in stopped - reached and not any(label in some for some in more):
            return f"the controller stops at every motion to {label}", len(moved)
    return "", len(moved)


def stops_in(events: Sequence[Event]) -> set[str]:
    """Return the targets at which the controller stops because other frames are in force."""
    return {str(event[1]) for event in events if not isinstance(event, Motion) and event[0] == "mismatch"}


def reached_in(events: Sequence[Event]) -> set[str]:
    """Return the targets that are reached: what stands before the colon in the line of a motion."""
    return {event.line.partition(": ")[0] for event in events if isinstance(event, Motion)}


def reduced(folder: Path, language: Language, files: Files, options: ReadOptions, seed: int) -> Files:
    """Return a small program with a fault of a larger one: lines are left out, alone, in pairs and in blocks."""

    def fails(lines: Sequence[tuple[str, str]]) -> bool:
        try:
            return any(fault(folder, language, _joined(lines), options, seed + 10 * k)[0] for k in range(3))
        except (Syntax, LookupError, ValueError, TypeError, AttributeError, AssertionError):  # cut in the middle
            return False

    lines = [(name, line) for name, text in files.items() for line in text.splitlines()]
    size = len(lines) // 2
    while size:
        k = 0
        while k < len(lines):
            fewer = lines[:k] + lines[k + size :]
            if fewer and fails(fewer):
                lines = fewer
            else:
                k += size
        size //= 2
    for a, b in itertools.combinations(range(len(lines) - 1, -1, -1), 2):
        if a < len(lines) and fails(fewer := [line for k, line in enumerate(lines) if k not in (a, b)]):
            lines = fewer
    return _joined(lines)


def _joined(lines: Sequence[tuple[str, str]]) -> Files:
    found: Files = {}
    for name, line in lines:
        found[name] = found.get(name, "") + line + "\n"
    return found


def try_programs(folder: Path, language: Language, seeds: Iterator[int] | range) -> tuple[int, int]:
    """Try random programs; return their number, and that of their corrected targets."""
    programs = count = 0
    for seed in seeds:
        files, options = language.write(Random(seed)), language.options[seed % len(language.options)]
        why, n = fault(folder, language, files, options, seed)
        if why:
            small = reduced(folder, language, files, options, seed)
            pytest.fail(f"program {seed}, {options}: {why}\n{shown(small)}")
        programs, count = programs + 1, count + n
    return programs, count


def shown(files: Mapping[str, str]) -> str:
    """Return a program for a message."""
    return "\n".join(f"--- {name}\n{text}" for name, text in files.items())


def for_a_while() -> Iterator[int]:
    """Yield seeds for as many seconds as ``TRUEPOSE_FUZZ_SECONDS`` says, by default a minute."""
    end = time.monotonic() + float(os.environ.get("TRUEPOSE_FUZZ_SECONDS", "60"))
    return itertools.takewhile(lambda _: time.monotonic() < end, itertools.count(1000))
