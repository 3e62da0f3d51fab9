"""Reading, correcting and writing programs, beside a bare pass over their numbers and the prediction itself."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.harness import Job, Memory
from truepose.error_map import ErrorMap, fit_cell
from truepose.programs import FrameTable, correct_program, read_program
from truepose.simulation import VirtualCell

TITLE = "Benchmarks: programs"
PACKAGES = ("truepose", "numpy", "scipy")
_NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?")


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n, samples = (1_000, 60) if quick else (50_000, 500)
    virtual = VirtualCell("paper", seed=1)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(samples, seed=1)), "ordinary-kriging")
    with tempfile.TemporaryDirectory() as folder:
        path, short, out = Path(folder) / "long.src", Path(folder) / "short.src", Path(folder) / "out"
        path.write_text(_program(virtual, n))
        short.write_text(_program(virtual, 10))
        frames = FrameTable(tools={1: virtual.tf_flange_tool})
        poses = read_program(path, frames).poses_base()

        def ours() -> None:
            correct_program(path, error_map, frames=frames, on_guard="skip").write(out)

        def bare() -> None:
            data = path.read_bytes()
            np.array([float(token) for token in _NUMBER.findall(data)])
            _predict(error_map, poses)

        yield Job(
            f"read, correct and write {n:,} inline LIN, map of {samples}",
            {"truepose": ours, "regular expression over the numbers, and the prediction": bare},
            items=n,
            target="at most 4 times the bare pass",
        )
        memory = Memory(partial(read_program, short, frames), partial(read_program, path, frames))
        yield Job(f"read {n:,} inline LIN", {"truepose": lambda: read_program(path, frames)}, items=n, memory=memory)


def _predict(error_map: ErrorMap, poses: np.ndarray) -> None:
    error_map.correct(poses, tf_flange_tool=error_map.tf_flange_tool, on_guard="skip")


def _program(virtual: VirtualCell, n: int) -> str:
    p = (
        np.asarray(virtual.preset.centre_mm)
        + np.random.default_rng(0).uniform(-0.4, 0.4, (n, 3)) * virtual.preset.size_mm
    )
    a, b, c = virtual.preset.abc_deg
    lines = "".join(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f}}} C_DIS\n" for x, y, z in p)
    return f"DEF LONG( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n{lines}END\n"
