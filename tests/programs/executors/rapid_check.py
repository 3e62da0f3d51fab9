"""What a corrected RAPID program may do otherwise than the original, and the reduction of a program that breaks it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from tests.programs.executors.rapid import Invalid, Module, Motion, Seen, trace_of, transform

from truepose.programs import FrameTable, Program, ReadOptions, Target, read_program

Files = Mapping[str, str]
_TOLERANCE = 1e-6  # [mm]


class Corrected(NamedTuple):
    """A target that is corrected, with the shift [mm] that it gets in its frame."""

    target: Target
    shift: np.ndarray


class Found(NamedTuple):
    """What is wrong, empty if nothing is; the number of corrected targets, and of motions that they shifted."""

    wrong: str
    corrected: int = 0
    moved: int = 0


def read(folder: Path, files: Files, options: ReadOptions) -> Program:
    """Read the modules of a task."""
    for name, text in files.items():
        (folder / name).write_text(text)
    path = folder if len(files) > 1 else folder / next(iter(files))
    return read_program(path, FrameTable(), options)


def check(folder: Path, files: Files, options: ReadOptions, seed: int, runs: int = 8) -> Found:
    """Run a program with its own numbers, and with those of each target that is corrected moved by a shift.

    Raises
    ------
    Invalid
        If no controller would accept the program.
    """
    for old in list(folder.iterdir()):
        old.unlink()
    return executed(files, read(folder, files, options), seed, runs)


def executed(files: Files, program: Program, seed: int, runs: int = 8) -> Found:
    """Run a program as it is and as it was corrected, by the targets that were read; see `check`."""
    dice = Random(seed)
    corrected = [
        Corrected(target, np.array([round(dice.uniform(0.5, 9.5), 4) for _ in range(3)]))
        for target in program.targets
        if target.verdict == "correct"
    ]
    after = {name: _shifted(text, [c for c in corrected if c.target.path.name == name]) for name, text in files.items()}
    moved = 0
    before, behind = ([Module(text, k) for k, text in enumerate(texts.values())] for texts in (files, after))
    for k in range(runs):
        old, new = (trace_of(modules, seed * runs + k) for modules in (before, behind))
        for a, b in zip(old, new, strict=False):
            wrong, shifted = _compared(a, b, corrected)
            if wrong:
                return Found(f"run {k}: {wrong}", len(corrected), moved)
            moved += shifted
        if len(old) != len(new):
            return Found(f"run {k}: the ways of the two runs differ", len(corrected), moved)
    return Found("", len(corrected), moved)


def _shifted(text: str, corrected: list[Corrected]) -> str:
    for target, shift in sorted(corrected, key=lambda one: -one.target.spans[0][0]):
        assert target.xyz is not None
        for (start, end), value in reversed(list(zip(target.spans, np.add(target.xyz, shift), strict=False))):
            text = f"{text[:start]}{value:.4f}{text[end:]}"
    return text


def _compared(a: Motion | Seen, b: Motion | Seen, corrected: list[Corrected]) -> tuple[str, bool]:
    """Return what is wrong with a step of two runs, and whether it is a motion that a correction shifted."""
    if type(a) is not type(b) or a.line != b.line:
        return f"line {a.line} and line {b.line}", False
    if isinstance(a, Seen) or isinstance(b, Seen):
        same = a == b or np.allclose(_numbers(a[1]), _numbers(b[1]), atol=1e-9)
        return ("" if same else f"line {a.line}: {a[1]} became {b[1]}"), False
    here = f"line {a.line} to {np.round(a.goal[0], 3).tolist()}"
    if not (_same(a.tf_frame, b.tf_frame) and _same(a.tf_tool, b.tf_tool)):
        return f"{here}: the frame or tool has other numbers", False
    if _same(a.tf, b.tf):
        return "", False
    if not np.allclose(a.tf[:3, :3], b.tf[:3, :3]):
        return f"{here}: the orientation differs", False
    by = b.tf[:3, 3] - a.tf[:3, 3]
    for target, shift in corrected:
        assert target.tf_base_frame is not None
        assert target.tf_flange_tool is not None
        if not _same(target.tf_base_frame[:3, :3] @ shift, by):
            continue
        if a.displaced:
            return f"{here}: displaced", False
        if (a.frame, a.tool) != (target.frame.lower(), target.tool.lower()):
            return f"{here}: {target.name} was judged under {target.frame} and {target.tool}", False
        if not (np.allclose(a.tf_frame, target.tf_base_frame) and np.allclose(a.tf_tool, target.tf_flange_tool)):
            return f"{here}: {target.name} was judged under other numbers of {target.frame} and {target.tool}", False
        if not any(np.allclose(place, a.goal[0], atol=1e-6) for place in _places(target)):
            return f"{here}: this is not a position of {target.name}", False
        if not np.allclose(transform(a.goal)[:3, :3], target.rotation.as_matrix() if target.rotation else np.eye(3)):
            return f"{here}: {target.name} has another orientation", False
        return "", True
    return f"{here} is shifted by {np.round(by, 4).tolist()}, which is the shift of no target in its frame", False


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.abs(a - b).max() < _TOLERANCE)


def _places(target: Target) -> list[np.ndarray]:
    """Return the positions in its frame that a correction of the target was judged for."""
    rotation = target.rotation if target.rotation is not None else Rotation.identity()
    found = [np.array(target.xyz)]
    for one in target.derived:
        found += [np.array(target.xyz) + shift for shift in one.vectors(rotation)[0]]
    return found


def _numbers(value: object) -> np.ndarray:
    """Return the numbers of a nested list; a text counts as its hash."""
    if isinstance(value, list):
        return np.concatenate([np.zeros(0), *map(_numbers, value)])
    return np.array([float(value) if isinstance(value, int | float) else float(hash(value) % 1000)])


# programs as trees, which shrink


class Block(NamedTuple):
    """Heads with their statements, and the end: ``IF … ELSE … ENDIF``."""

    arms: list[tuple[str, list[Line]]]
    end: str


Line = str | Block


def text_of(lines: list[Line]) -> str:
    """Return the text of lines and blocks."""
    found = []
    for line in lines:
        if isinstance(line, str):
            found.append(line)
            continue
        for head, body in line.arms:
            found += [head, text_of(body)]
        found.append(line.end)
    return "\n".join(one for one in found if one)


def smaller(lines: list[Line]) -> list[list[Line]]:
    """Return the programs with one thing less."""
    found: list[list[Line]] = []
    for k, line in enumerate(lines):
        rest = lines[:k], lines[k + 1 :]
        found.append([*rest[0], *rest[1]])
        if isinstance(line, Block):
            found += [[*rest[0], *body, *rest[1]] for _, body in line.arms]
            for i, (head, body) in enumerate(line.arms):
                arms = line.arms
                if i:
                    found.append([*rest[0], Block([*arms[:i], *arms[i + 1 :]], line.end), *rest[1]])
                found += [
                    [*rest[0], Block([*arms[:i], (head, one), *arms[i + 1 :]], line.end), *rest[1]]
                    for one in smaller(body)
                ]
    return found


def reduced(modules: dict[str, list[Line]], fails: Callable[[Files], bool]) -> Files:
    """Return a smallest program that still fails."""
    again = True
    while again:
        again = False
        for name in modules:
            done = False
            while not done:
                done = True
                for one in smaller(modules[name]):
                    tried = {**modules, name: one}
                    if fails({key: text_of(lines) for key, lines in tried.items()}):
                        modules, done, again = tried, False, True
                        break
    return {key: text_of(lines) for key, lines in modules.items()}


def still_wrong(folder: Path, options: ReadOptions, seed: int) -> Callable[[Files], bool]:
    """Return whether a program is valid, and corrected wrongly."""

    def fails(files: Files) -> bool:
        try:
            return bool(check(folder, files, options, seed, runs=30).wrong)
        except Exception:  # it is not valid, for the executor or for the reader
            return False

    return fails


__all__ = ["Block", "Invalid", "Line", "check", "reduced", "smaller", "still_wrong", "text_of"]
