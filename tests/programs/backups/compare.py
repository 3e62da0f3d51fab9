"""What the tests of makers' backups share: a map, and what the library reads and writes against readers of their own.

Nothing here reads a program: each test gives what its own reader found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from tests.programs.conftest import Answer, FakeMap
from tests.programs.joint_arms import rotation

from truepose.programs import Program, Target, correct_program

_CONSTANT: Final = np.array([0.41, -0.33, 0.27])
_GRADIENT: Final = 1e-4 * np.array([[1.0, -0.5, 0.0], [0.25, 0.75, -1.0], [0.5, 0.0, 0.6]])


class Gradient:
    """A map whose correction [mm, base frame] changes with the position: each target gets another one."""

    hash = "1" * 64

    def __init__(self, scale: float = 1.0) -> None:
        self._scale = scale

    def shift(self, p: np.ndarray) -> np.ndarray:
        """Return the corrections at positions, (3,) or (n, 3) [mm]."""
        return self._scale * (_CONSTANT + p @ _GRADIENT.T)

    def correct(self, poses: np.ndarray, **_: Any) -> Answer:
        p, n = poses[:, :3, 3], len(poses)
        shift = self.shift(p)
        return Answer(p, p + shift, -shift, np.full((n, 3), 2.0), np.full(n, "correct", "<U7"), [""] * n)


class Own(NamedTuple):
    """A target as a test's own reader found it."""

    tf_base_frame: np.ndarray
    tf_frame_tool: np.ndarray
    spans: tuple[tuple[int, int], ...]
    """The bytes of its numbers; those of the position first."""

    @property
    def p_base(self) -> np.ndarray:
        """Its position in the base frame, (3,) [mm]."""
        return np.asarray((self.tf_base_frame @ self.tf_frame_tool)[:3, 3])


def listing(folder: Path) -> list[Path]:
    """Return all files below a folder."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


def transform(values: Iterable[float], axes: str) -> np.ndarray:
    """Return the transform of a position and three angles [deg], of turns about its own axes in turn: "zyx"."""
    x, y, z, *angles = values
    tf = np.eye(4)
    for axis, angle in zip(axes, angles, strict=True):
        tf = tf @ rotation("xyz".index(axis), np.deg2rad(angle))
    tf[:3, 3] = x, y, z
    return tf


def zero_changes_no_byte(programs: Iterable[Program]) -> int:
    """Assert that a correction of zero leaves every file as it was; return the number of programs."""
    corrected = [program for program in programs if program.counts()["correct"]]
    for program in corrected:
        for path, data in correct_program(program, FakeMap(), on_guard="skip").files.items():
            assert data == path.read_bytes(), path
    return len(corrected)


def places_agree(program: Program, own: Callable[[Target], Own]) -> int:
    """Assert that every correctable target stands where the test's reader finds it; return their number."""
    rows, found = program.correctable(), program.positions_base()
    for target, p in zip((program.targets[int(i)] for i in rows), found, strict=True):
        known = own(target)
        assert target.spans[:3] == known.spans[:3]
        np.testing.assert_allclose(p, known.p_base, atol=1e-9)
    return len(rows)


def digits_agree(program: Program, own: Callable[[Target], Own]) -> int:
    """Assert that a program of one file, corrected, has the digits that are computed here, and no other change.

    Positions have three decimals. The number of corrected targets is returned.
    """
    if not program.counts()["correct"]:
        return 0
    original, texts = program.path.read_bytes(), []
    result = correct_program(program, Gradient(), on_guard="skip")
    corrected = [outcome.target for outcome in result.targets if outcome.verdict == "correct"]
    for known in map(own, corrected):
        tf = known.tf_base_frame
        after = known.tf_frame_tool[:3, 3] + tf[:3, :3].T @ Gradient().shift(known.p_base)
        texts += [(span, f"{value:.3f}".encode()) for span, value in zip(known.spans[:3], after, strict=True)]
    pieces, done = [], 0
    for (start, end), text in sorted(texts):
        pieces += [original[done:start], text]
        done = end
    assert result.files.get(program.path, original) == b"".join([*pieces, original[done:]])
    return len(corrected)
