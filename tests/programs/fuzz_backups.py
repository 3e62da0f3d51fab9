"""Injured backups of every maker, read and corrected with the options that open more of them."""

from __future__ import annotations

import gzip
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from tests.programs.backups import abb, fanuc, kuka, staubli, universal_robots, yaskawa
from tests.programs.conftest import FakeMap
from tests.programs.numbers import check_numbers

from truepose.errors import TrueposeError
from truepose.programs import CorrectedBatch, ReadOptions, correct_programs
from truepose.programs.core.program import FrameTolerance
from truepose.robots import Robot, load_robot

PROGRAMS: Final = (".src", ".dat", ".mod", ".ls", ".jbi", ".script", ".urp", ".pgx")
PACKED: Final = (".urp", ".installation")
KEPT: Final = 5
"""Programs of a backup that are tried together."""


class OfArm(FakeMap):
    """Knows an arm, so that joint targets, words of configuration and segments are judged."""

    robot: Robot
    tf_flange_tool = np.eye(4)


@cache
def backups() -> dict[str, tuple[dict[str, bytes], str]]:
    """Return the files of each maker's backup, and an arm of the maker."""
    with tempfile.TemporaryDirectory() as folder:
        root = fanuc.write_backup(Path(folder) / "all")
        of_fanuc = {str(file.relative_to(root)): file.read_bytes() for file in root.rglob("*") if file.is_file()}
    return {
        "KUKA": (kuka.backup(), "kuka-kr16-2"),
        "ABB": (abb.backup(), "abb-irb4600-40-255"),
        "FANUC": (of_fanuc, "fanuc-m20ia"),
        "Yaskawa": (yaskawa.backup(), "yaskawa-gp25"),
        "Universal Robots": (universal_robots.backup(), "universal-robots-ur10e"),
        "Stäubli": (staubli.backup(), "staubli-tx2-90"),
    }


arm = cache(load_robot)


def some(rng: np.random.Generator, files: dict[str, bytes]) -> dict[str, bytes]:
    """Return a few programs of a backup, with all data that are no programs of one file."""
    stems = sorted({str(Path(name).with_suffix("")) for name in files if name.lower().endswith(PROGRAMS)})
    kept = set(rng.choice(stems, min(KEPT, len(stems)), replace=False).tolist())
    shared = ("$config", "$machine", "global")
    return {
        name: data
        for name, data in files.items()
        if not name.lower().endswith(PROGRAMS)
        or str(Path(name).with_suffix("")) in kept
        or any(word in name.lower() for word in shared)
    }


def options_of(rng: np.random.Generator) -> ReadOptions:
    """Return options that allow much, now and then."""
    tolerance = FrameTolerance(3.0, 0.2) if rng.random() < 0.4 else None
    allowed = (rng.random(6) < 0.6).tolist()
    names = ("derived", "joint_targets", "external_axes", "whole_task", "calls_keep_frames", "controller_kinematics")
    chosen: dict[str, Any] = dict(zip(names, allowed, strict=True))
    return ReadOptions(frame_tolerance=tolerance, ambiguous="skip" if rng.random() < 0.5 else "refuse", **chosen)


def text(path: Path, data: bytes) -> bytes:
    """Return the content of a file, unpacked where it is packed."""
    return gzip.decompress(data) if path.suffix.lower() in PACKED else data


def injured(rng: np.random.Generator, mutate: Callable[..., bytes], name: str, data: bytes) -> bytes:
    """Return an injured file; a packed one is injured inside."""
    if name.lower().endswith(PACKED):
        return gzip.compress(mutate(rng, gzip.decompress(data)), mtime=0)
    return mutate(rng, data)


def injure_backup(
    rng: np.random.Generator, folder: Path, mutate: Callable[..., bytes], blank: Callable[[bytes], bytes]
) -> bool:
    """Try one injured backup; return whether any program was corrected."""
    maker = list(backups())[rng.integers(len(backups()))]
    files, arm_name = backups()[maker]
    files = some(rng, files)
    hurt = set(rng.choice(sorted(files), rng.integers(0, min(len(files), 4) + 1), replace=False).tolist())
    shutil.rmtree(folder, ignore_errors=True)
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(injured(rng, mutate, name, data) if name in hurt else data)
    options, robot = options_of(rng), arm(arm_name) if rng.random() < 0.5 else None
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    def attempt(shift: list[float]) -> CorrectedBatch | str:
        error_map: Any = FakeMap(shift)
        if robot is not None:
            error_map = OfArm(shift)
            error_map.robot = robot
        try:
            return correct_programs(
                [folder], error_map, options=options, keep_going=True, on_guard="skip", other_maker=True
            )
        except TrueposeError as error:
            return str(error)

    zero, moved = attempt([0.0, 0.0, 0.0]), attempt([0.5, -0.25, 0.125])
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    if isinstance(zero, str) or isinstance(moved, str):
        assert "\n" not in str(zero), str(zero)
        return False
    for one in zero.corrected:
        assert all(data == before[path] for path, data in one.files.items()), (maker, sorted(hurt))
    for one in moved.corrected:
        for path, data in one.files.items():
            assert blank(text(path, data)) == blank(text(path, before[path])), (maker, sorted(hurt), path)
        if robot is None:
            check_numbers(one, {path: before[path] for path in one.files if path.suffix != ".urp"})
    return bool(moved.n_corrected)
