"""Whole commands with one and two processes: time, memory of the process that asked, and hash of what it wrote."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.held_out import Page
from truepose.samples import write_samples
from truepose.simulation import VirtualCell

_MEASURED: Final = 200  # samples of the map
_HELD_OUT: Final = 100
_MEASURE: Final = """
import resource, subprocess, sys, time
started = time.perf_counter()
code = subprocess.call(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - started, used.ru_utime + used.ru_stime, used.ru_maxrss, file=sys.stderr)
sys.exit(code)
"""
"""A small process that runs the command: a child's peak of memory is never below that of the process that forked it."""
_AT_ONCE: Final = 1_000_000  # rows of the table of poses that are made at once


@dataclass(frozen=True)
class Command:
    """A command, with the names of its options.

    Attributes
    ----------
    name : str
        What it does, and to how much.
    words : sequence of str
        Its words, without ``--workers``.
    n : int
        The number of its items.
    unit : str
        The name of an item.
    out : str
        The file that it writes; empty if only its output counts.
    divides : bool
        Whether it takes ``--workers``.
    """

    name: str
    words: Sequence[str]
    n: int
    unit: str
    out: str = ""
    divides: bool = True


@dataclass(frozen=True)
class Ran:
    """A run of a command: wall time [s], processor time [s] and peak of memory [MB] of its process, SHA-256."""

    seconds: float
    own: float
    megabytes: float
    digest: str


def run(folder: Path, words: Sequence[str], out: str = "") -> Ran:
    """Run a command in a folder.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    command = [sys.executable, "-c", _MEASURE, sys.executable, "-m", "truepose", *words]
    with (folder / "stdout").open("wb") as stdout:
        done = subprocess.run(command, cwd=folder, stdout=stdout, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    seconds, own, kilobytes = map(float, done.stderr.splitlines()[-1].split())
    with (folder / (out or "stdout")).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Ran(seconds, own, kilobytes / 1024, digest)


def report_commands(page: Page, folder: Path, virtual: VirtualCell, *, quick: bool) -> None:
    """Add the table of commands to a page."""
    commands = [make(folder, virtual, quick) for make in (_check, _fit, _predict, _validate, _plan)]
    page.say(
        "Whole commands, start and end included, each in a process of its own, in the order in which they ran. The "
        "processor time and the memory are those of the process that asked; its workers are not in them. The outputs "
        "of both rows of a command have the same SHA-256."
    )
    page.head(["command", "workers", "wall time", "items per s", "own CPU", "peak memory", "SHA-256"])
    for command in commands:
        digests = set()
        for workers in (1, 2) if command.divides else (1,):
            given = ["--workers", str(workers)] if command.divides else []
            ran = run(folder, [*command.words, *given], command.out)
            digests.add(ran.digest)
            rate, memory = f"{command.n / ran.seconds:,.0f} {command.unit}", f"{ran.megabytes:.0f} MB"
            times = f"{ran.seconds:.2f} s", rate, f"{ran.own:.2f} s", memory
            page.row(command.name, str(workers) if command.divides else "–", *times, f"`{ran.digest[:12]}`")
        assert len(digests) == 1, f"{command.name}: the outputs differ"


def _check(folder: Path, virtual: VirtualCell, quick: bool) -> Command:
    count, targets = (20, 100) if quick else (1000, 500)
    (folder / "scripts").mkdir()
    rng = np.random.default_rng(0)
    for k in range(count):
        rows = rng.uniform(-0.4, 0.4, (targets, 3)) + np.asarray(virtual.preset.centre_mm) / 1e3
        moves = "".join(f"  movel(p[{x:.5f},{y:.5f},{z:.5f},0,3.14,0],a=1,v=0.1)\n" for x, y, z in rows)
        text = f"def p{k}():\n  set_tcp(p[0,0,0,0,0,0])\n{moves}end\n"
        (folder / "scripts" / f"p{k}.script").write_text(text, "utf-8")
    words = ["check", "scripts", "--json", "--no-targets"]
    return Command(f"check, {count:,} URScript programs of {targets} targets", words, count, "programs")


def _fit(folder: Path, virtual: VirtualCell, quick: bool) -> Command:
    (folder / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
    write_samples(folder / "samples.csv", virtual.measure(virtual.design(60 if quick else _MEASURED, seed=1)))
    write_samples(folder / "test.csv", virtual.measure(virtual.design(_HELD_OUT, seed=2)))
    names = ["registration", "idw"] if quick else ["idw", "ordinary-kriging", "universal-kriging", "kinematic-kriging"]
    words = ["fit", "cell.toml", "samples.csv", "--candidates", ",".join(names), "--out", "fitted.truepose", "--force"]
    return Command(f"fit, {len(names)} candidates", words, 10 * len(names), "fits", "fitted.truepose")


def _predict(folder: Path, virtual: VirtualCell, quick: bool) -> Command:
    n = 100_000 if quick else 10_000_000
    _poses(folder / "poses.parquet", virtual, n)
    words = ["predict", "m", "poses.parquet", "--out", "predicted.parquet", "--force", "--json"]
    return Command(f"predict, {n:,} rows of Parquet", words, n, "rows", "predicted.parquet")


def _validate(folder: Path, virtual: VirtualCell, quick: bool) -> Command:
    words = ["validate", "m", "test.csv", "--json"]
    return Command(f"validate, {_HELD_OUT} samples", words, _HELD_OUT, "samples", divides=False)


def _plan(folder: Path, virtual: VirtualCell, quick: bool) -> Command:
    n = 10 if quick else 60
    words = ["plan", "cell.toml", "--n", str(n), "--out", "plan", "--force"]
    return Command(f"plan, {n} poses", words, n, "poses", "plan/plan.csv", divides=False)


def _poses(path: Path, virtual: VirtualCell, n: int) -> None:
    """Write a table of joints between those of a plan."""
    import pyarrow
    import pyarrow.parquet

    q, rng, writer = np.rad2deg(virtual.design(2000, seed=5)), np.random.default_rng(0), None
    for start in range(0, n, _AT_ONCE):
        rows = min(_AT_ONCE, n - start)
        first, second = q[rng.integers(0, len(q), (2, rows))]
        share = rng.random((rows, 1))
        joints = share * first + (1.0 - share) * second
        table = pyarrow.table({f"q{k + 1}_deg": joints[:, k] for k in range(q.shape[1])})
        writer = writer or pyarrow.parquet.ParquetWriter(path, table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()
