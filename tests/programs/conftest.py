"""Programs in a folder, frames whose values are known, and a map whose answer is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, Program, ReadOptions, read_program

Pair = Callable[..., Path]
Read = Callable[..., Program]


@dataclass
class Answer:
    """What a map says, with the attributes that `Corrections` has."""

    p_target: np.ndarray
    p_command: np.ndarray
    e: np.ndarray
    std: np.ndarray
    verdict: np.ndarray
    reason: list[str]


@dataclass
class FakeMap:
    """Asks for the same shift [mm], base frame, at every target; guards the targets whose number is in `guarded`.

    Its standard deviation [mm] is so large that no path counts as bent; tests of paths state another.
    """

    shift: Any = (0.0, 0.0, 0.0)
    guarded: dict[int, str] = field(default_factory=dict)
    hash: str = "0" * 64
    std: float = 2.0
    calls: list[dict[str, Any]] = field(default_factory=list)

    def correct(self, poses: np.ndarray, **more: Any) -> Answer:
        before = sum(len(call["poses"]) for call in self.calls)  # a long program comes in parts
        self.calls.append({"poses": poses, **more})
        n = len(poses)
        p = poses[:, :3, 3]
        shift = np.asarray(self.shift, float)
        shift = np.broadcast_to(shift if shift.ndim == 1 else shift[before : before + n], (n, 3)).copy()
        verdict = np.full(n, "correct", dtype="<U7")
        reason = [""] * n
        for i, why in self.guarded.items():
            if before <= i < before + n:
                verdict[i - before] = "refuse" if more["on_guard"] == "refuse" else "skip"
                reason[i - before], shift[i - before] = why, 0.0
        return Answer(p, p + shift, -shift, np.full((n, 3), self.std), verdict, reason)


@pytest.fixture
def make_map() -> type[FakeMap]:
    return FakeMap


@pytest.fixture(scope="session")
def frames() -> FrameTable:
    """Tools 1 to 3 and bases 1 and 2, none of them trivial; no tool or base in force by default."""
    return FrameTable(
        tools={n: make_transform(euler("kuka", [10.0 * n, 20.0, -30.0]), [5.0 * n, -3.0, 150.0]) for n in (1, 2, 3)},
        bases={n: make_transform(euler("kuka", [30.0 * n, -15.0, 5.0]), [900.0, 100.0 * n, 40.0]) for n in (1, 2)},
    )


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    """Write cell.src, and cell.dat if there is one; text becomes latin-1."""

    def write(src: str | bytes | None, dat: str | bytes | None = None, name: str = "cell") -> Path:
        for ending, content in ((".src", src), (".dat", dat)):
            file = tmp_path / f"{name}{ending}"
            file.unlink(missing_ok=True)
            if content is not None:
                file.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
        return tmp_path / f"{name}{'.dat' if src is None else '.src'}"

    return write


@pytest.fixture
def read(pair: Pair, frames: FrameTable) -> Read:
    """Read a program given by the statements of its only routine and of its data list."""

    def reading(body: str, points: str | None = None, *, table: FrameTable | None = None, **options: Any) -> Program:
        src = body if "DEF " in body else f"DEF cell( )\n{body}\nEND\n"
        dat = None if points is None else f"DEFDAT CELL\n{points}\nENDDAT\n"
        return read_program(pair(src, dat), table or frames, ReadOptions(**options))

    return reading
