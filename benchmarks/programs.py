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

_READ = (
    "import numpy as np\n"
    "from truepose.programs import FrameTable, read_program\n"
    "read_program(sys.argv[1], FrameTable(tools={0: np.eye(4), 1: np.eye(4)}))\n"
)
_CAM = {
    "RAPID": (
        ".mod",
        "MODULE Cam\nPROC main()\n",
        "  MoveL [[{:.3f},{:.3f},{:.3f}],[0.5,0.5,0.5,0.5],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n",
        *("", "", "ENDPROC\nENDMODULE\n"),
    ),
    "RAPID, targets by name": (
        ".mod",
        "MODULE Cam\n",
        "  LOCAL CONST robtarget p{k}:=[[{:.3f},{:.3f},{:.3f}],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n",
        *("PROC main()\n", "  MoveL p{k},v100,fine,tool0;\n", "ENDPROC\nENDMODULE\n"),
    ),
    "FANUC": (
        ".ls",
        "/PROG CAM\n/MN\n",
        "{k:4d}:L P[{k}] 100mm/sec FINE    ;\n",
        "/POS\n",
        (
            "P[{k}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX = {:9.3f}  mm,\tY = {:9.3f}  mm,\t"
            "Z = {:9.3f}  mm,\n\tW =   180.000 deg,\tP =     0.000 deg,\tR =     0.000 deg\n}};\n"
        ),
        "/END\n",
    ),
    "URScript": (
        ".script",
        "def prog():\n  set_tcp(p[0,0,0.1,0,0,0])\n",
        "  movel(p[{:.6f}, {:.6f}, {:.6f}, 0.0, 3.141593, 0.0], a=1.2, v=0.25, r=0.001)\n",
        *("", "", "end\n"),
    ),
    "KRL": (
        ".src",
        "DEF CAM( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n",
        "LIN {{X {:.3f},Y {:.3f},Z {:.3f},A 0.000,B 90.000,C 0.000}} C_DIS\n",
        *("", "", "END\n"),
    ),
    "INFORM": (
        ".jbi",
        "/JOB\n//NAME CAM\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n///RCONF 0,0,0,0,0,0,0,0\n",
        "C{before:06d}={:.3f},{:.3f},{:.3f},180.0000,0.0000,-90.0000\n",
        "//INST\n///DATE 2024/01/01 10:00\n///GROUP1 RB1\nNOP\n",
        "MOVL C{before:06d} V=100.0 PL=1\n",
        "END\n",
    ),
    "VAL3": (
        ".dtx",
        '<Database><Datas>\n<Data name="pPath" access="private" type="pointRx" size="1000000">\n',
        (
            '<Value key="{before}" x="{:.3f}" y="{:.3f}" z="{:.3f}" rx="180.000" ry="0.000" rz="90.000" '
            'shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="world[0]" />\n'
        ),
        *("", "", "</Data>\n</Datas></Database>\n"),
    ),
}
"""Of each language: ending, head, a motion, text between motions and positions, a position, end; or the reverse.

The number of a target is `k`, counted from 1, and `before`, counted from 0.
"""


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n, samples = (1_000, 60) if quick else (1_000_000, 500)
    virtual = VirtualCell("paper", seed=1)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(samples, seed=1)), "ordinary-kriging")
    yield from _reading(n)
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


def _reading(n: int) -> Iterator[Job]:
    """Yield the jobs that read a program of a CAM system in each language; the peaks are those of fresh processes."""
    for language, (ending, head, line, between, position, end) in _CAM.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"cam{ending}"
            rows = np.random.default_rng(0).uniform(-900.0, 900.0, (n, 3)) / (1000.0 if ending == ".script" else 1.0)
            with path.open("w") as file:
                file.write(head)
                file.writelines(line.format(*row, k=k, before=k - 1) for k, row in enumerate(rows, 1))
                file.write(between)
                file.writelines(position.format(*row, k=k, before=k - 1) for k, row in enumerate(rows, 1))
                file.write(end)
            frames = FrameTable(tools={0: np.eye(4), 1: np.eye(4)})

            def bare(path: Path = path) -> int:
                return sum(1 for _ in _NUMBER.finditer(path.read_bytes()))

            def ours(path: Path = path, frames: FrameTable = frames) -> None:
                assert read_program(path, frames).counts()["correct"] == n

            yield Job(
                f"read {n:,} targets in {language}, {path.stat().st_size / 1e6:.0f} MB; peak of memory of a fresh "
                f"process {_fresh_peak(_READ, path):.0f} MB",
                {"truepose": ours, "regular expression over the numbers": bare},
                items=n,
                target="at most 4 times the bare pass, below 600 MB",
            )


def fresh_peak(path: Path, map_path: Path, out: Path) -> float:
    """Return the largest resident memory of a process that corrects a program, its imports included [MB]."""
    code = (
        "from truepose.error_map import load_map\n"
        "from truepose.programs import FrameTable, correct_program\n"
        "m = load_map(sys.argv[2])\n"
        "frames = FrameTable(tools={1: m.tf_flange_tool})\n"
        "correct_program(sys.argv[1], m, frames=frames, on_guard='skip').write(sys.argv[3], force=True)\n"
    )
    return _fresh_peak(code, path, map_path, out)


def _fresh_peak(code: str, *arguments: Path) -> float:
    """Return the largest resident memory of a process that runs code [MB]."""
    # not ru_maxrss, which a new process takes over from the one that started it
    code = f"import re, sys\n{code}print(re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1])\n"
    command = [sys.executable, "-c", code, *map(str, arguments)]
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
