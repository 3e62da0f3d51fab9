"""Reading, correcting and writing programs, beside a bare pass over their numbers and the prediction itself."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.harness import Job, Slow
from truepose.error_map.fit import fit_cell
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, correct_program, read_program
from truepose.simulation import VirtualCell

TITLE = "Benchmarks: programs"
PACKAGES = ("truepose", "numpy", "scipy")
_ROWS = 2048
_NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?")


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n, samples = (1_000, 60) if quick else (1_000_000, 500)
    virtual = VirtualCell("paper", seed=1)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(samples, seed=1)), "ordinary-kriging")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TRUEPOSE_STATE"] = folder  # what is corrected here is not remembered
        path, out, map_path = Path(folder) / "long.src", Path(folder) / "out", Path(folder) / "map.tpmap"
        _write_program(path, virtual, n)
        error_map.save(map_path)
        frames = FrameTable(tools={1: virtual.tf_flange_tool})

        def once(call: Callable[[], object]) -> Slow:
            return Slow(lambda _: call(), (n,), repeats=1)

        def ours() -> None:
            correct_program(path, error_map, frames=frames, on_guard="skip").write(out, force=True)

        def bare() -> np.ndarray:
            values = np.array([float(token) for token in _NUMBER.findall(path.read_bytes())])
            return values[1:].reshape(n, 6)[:, :3]  # behind the number of the tool

        def predicted() -> None:
            p = bare()
            for start in range(0, n, _ROWS):
                error_map.predictor.predict(p[start : start + _ROWS], return_std=True)

        def answered() -> None:
            p = bare()
            poses = make_transform(euler("kuka", np.tile(virtual.preset.abc_deg, (_ROWS, 1))), np.zeros((_ROWS, 3)))
            for start in range(0, n, _ROWS):
                rows = p[start : start + _ROWS]
                poses[: len(rows), :3, 3] = rows
                error_map.correct(poses[: len(rows)], on_guard="skip")

        yield Job(
            f"read, correct, prove and write {n:,} inline LIN with its records, map of {samples}",
            {
                "truepose": once(ours),
                "regular expression over the numbers, and one prediction with its deviation": once(predicted),
                "regular expression over the numbers, and the map's answer (solved, guarded)": once(answered),
            },
            items=n,
            target="at most 4 times the bare pass",
        )
        yield Job(
            f"peak of memory of a fresh process that does this ({fresh_peak(path, map_path, out):.0f} MB), read alone",
            {"truepose": once(lambda: read_program(path, frames)), "regular expression over the numbers": once(bare)},
            items=n,
            target="below 600 MB, of which the proof holds the corrected text",
        )


def fresh_peak(path: Path, map_path: Path, out: Path) -> float:
    """Return the largest resident memory of a process that corrects a program, its imports included [MB]."""
    # not ru_maxrss, which a new process takes over from the one that started it
    code = (
        "import re, sys\n"
        "from truepose.error_map import load_map\n"
        "from truepose.programs import FrameTable, correct_program\n"
        "m = load_map(sys.argv[2])\n"
        "frames = FrameTable(tools={1: m.tf_flange_tool})\n"
        "correct_program(sys.argv[1], m, frames=frames, on_guard='skip').write(sys.argv[3], force=True)\n"
        "print(re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1])\n"
    )
    command = [sys.executable, "-c", code, str(path), str(map_path), str(out)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout) * 1024 / 1e6


def _write_program(path: Path, virtual: VirtualCell, n: int) -> None:
    """Write a program of inline targets, as offline systems do."""
    rng, (a, b, c) = np.random.default_rng(0), virtual.preset.abc_deg
    with path.open("w") as file:
        file.write("DEF LONG( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n")
        for start in range(0, n, _ROWS):
            rows = rng.uniform(-0.4, 0.4, (min(_ROWS, n - start), 3)) * virtual.preset.size_mm
            for x, y, z in np.asarray(virtual.preset.centre_mm) + rows:
                file.write(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f}}} C_DIS\n")
        file.write("END\n")
