"""Scaling over workers: a correction, whole commands, a long program; and the plant computed from them."""

from __future__ import annotations

import hashlib
import os
import resource
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from tests.jobs.clusters import local_cluster

from benchmarks.held_out import Page
from benchmarks.scale_commands import report_commands
from truepose.error_map import ErrorMap, load_map
from truepose.error_map.fit import fit_cell
from truepose.jobs.executor import Cluster
from truepose.numerics import processes
from truepose.numerics.executor import Executor, Inputs, Serial, Task
from truepose.numerics.processes import Processes
from truepose.programs import CorrectedBatch, FrameTable, Program, read_program
from truepose.programs.batch import correct_read
from truepose.simulation import VirtualCell

PAGE: Final = "scale"
PACKAGES: Final = ("distributed", "numpy", "scipy", "numba")
WORKERS: Final = (1, 2)
LONG: Final = 1_000_000  # targets of the long program
TARGETS: Final = 500  # of each program
ROBOTS, PROGRAMS = 500, 10_000  # of the plant


@dataclass(frozen=True)
class Run:
    """One correction of all programs: wall time, processor time of this process, peak of a worker's memory."""

    seconds: float
    own: float
    digest: str
    megabytes: float


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the benchmark."""
    count = 6 if quick else 20
    page = Page("Scaling over workers", path)
    with tempfile.TemporaryDirectory() as place:
        os.environ["TRUEPOSE_STATE"] = place  # what is corrected here is not remembered
        folder = Path(place)
        virtual = VirtualCell("paper", seed=1)
        fit_cell(virtual.cell, virtual.measure(virtual.design(200, seed=1)), "ordinary-kriging").save(folder / "m")
        error_map = load_map(folder / "m")
        _programs(folder, virtual, 1)
        started = time.process_time()
        programs = _programs(folder, virtual, count)
        reading = (time.process_time() - started) / count
        load = os.getloadavg()[0]
        page.say(
            f"{count} programs of {TARGETS} KRL targets, map of 200 samples (ordinary Kriging): correction, proof, "
            f"records and writing; {1 if quick else 2} runs, the faster one. {os.cpu_count()} processors, load "
            f"{load:.1f} at the start; with 2 workers, the process that asked shares them. The outputs of all rows "
            "have the same SHA-256."
        )
        page.head(["form", "workers", "wall time", "programs per s", "speed-up", "own CPU a program", "worker's peak"])
        base, digests, costs = 0.0, set(), []
        for name, workers, run in _runs(folder, error_map, programs, 1 if quick else 2):
            base = base or run.seconds
            digests.add(run.digest)
            own = run.own / count
            costs.append((name, own))
            memory = f"{run.megabytes:.0f} MB" if run.megabytes else "–"
            rate, gain = f"{count / run.seconds:.1f}", f"{base / run.seconds:.2f}"
            page.row(name, str(workers), f"{run.seconds:.2f} s", rate, gain, f"{1e3 * own:.1f} ms", memory)
        assert len(digests) == 1, "the forms give different outputs"
        page.say(f"SHA-256 of all outputs: `{digests.pop()}`.")
        _overheads(page, folder, 100 if quick else 500)
        _long(page, folder, virtual, error_map, LONG // 100 if quick else LONG)
        report_commands(page, folder, virtual, quick=quick)
    alone = next(own for name, own in costs if name == "serial")
    asking = statistics.median(own for name, own in costs if name == "cluster") + reading
    _plant(page, alone, asking)


def _programs(folder: Path, virtual: VirtualCell, count: int, targets: int = TARGETS) -> list[Program]:
    rng, (a, b, c) = np.random.default_rng(0), virtual.preset.abc_deg
    frames, found = FrameTable(tools={1: virtual.tf_flange_tool}), []
    for k in range(count):
        rows = rng.uniform(-0.4, 0.4, (targets, 3)) * virtual.preset.size_mm + np.asarray(virtual.preset.centre_mm)
        lines = "".join(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a},B {b},C {c}}}\n" for x, y, z in rows)
        file = folder / f"p{k}.src"
        file.write_text(f"DEF P{k}()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n{lines}END\n", "utf-8")
        found.append(read_program(file, frames))
    return found


def _runs(folder: Path, error_map: ErrorMap, programs: list[Program], repeats: int) -> Iterator[tuple[str, int, Run]]:
    for name, workers, executor in _forms(folder):
        for warm in programs[: 2 * workers], programs[: 2 * workers]:
            _correct(error_map, warm, executor, folder)
        runs = [_correct(error_map, programs, executor, folder) for _ in range(repeats)]
        yield name, workers, min(runs, key=lambda run: run.seconds)


def _forms(folder: Path, counts: Sequence[int] = WORKERS) -> Iterator[tuple[str, int, Executor]]:
    with Serial() as serial:
        yield "serial", 1, serial
    processes.cores = lambda: max(WORKERS)  # also more processes than processors
    for workers in counts:
        with Processes(workers) as local:
            yield "processes", workers, local
    for workers in counts:
        with _cluster(folder, workers) as cluster:
            yield "cluster", workers, cluster


@contextmanager
def _cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    with local_cluster(folder, workers) as running, Cluster(running.address) as cluster:
        yield cluster


def _correct(error_map: ErrorMap, programs: list[Program], executor: Executor, folder: Path) -> Run:
    out = Path(tempfile.mkdtemp(dir=folder))
    wall, own = time.perf_counter(), time.process_time()
    corrected, refused = correct_read(
        programs, error_map, None, keep_going=True, executor=executor, on_guard="skip", accept_weak_map=True
    )
    CorrectedBatch(tuple(corrected), tuple(refused)).write(out)
    wall, own = time.perf_counter() - wall, time.process_time() - own
    digest = hashlib.sha256()
    for file in sorted(out.rglob("*")):
        digest.update(file.read_bytes())
    peaks = executor.run(peak_memory, (Task((), (0.02,)) for _ in range(4 * executor.workers)))
    megabytes = 0.0 if isinstance(executor, Serial) else max(peak for _, peak in peaks)
    return Run(wall, own, digest.hexdigest(), megabytes)


def peak_memory(inputs: Inputs, task: Task) -> float:
    """Return the peak of this worker's memory [MB]."""
    time.sleep(task.values[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def nothing(inputs: Inputs, task: Task) -> None:
    """Do nothing: what remains is the overhead of a task."""


def _overheads(page: Page, folder: Path, count: int) -> None:
    page.head(["form", "overhead of a task that does nothing, 2 workers, 90 kB of values"])
    for name, _, executor in _forms(folder, (2,)):
        tasks = [Task((), (os.urandom(90_000),)) for _ in range(count)]
        list(executor.run(nothing, tasks[:20]))
        started = time.perf_counter()
        list(executor.run(nothing, tasks))
        page.row(name, f"{1e3 * (time.perf_counter() - started) / count:.2f} ms")


def _long(page: Page, folder: Path, virtual: VirtualCell, error_map: ErrorMap, targets: int) -> None:
    program = _programs(folder, virtual, 1, targets)
    with Processes(1) as executor:
        run = _correct(error_map, program, executor, folder)
    page.say(
        f"One program of {targets:,} targets, in one worker: {run.seconds:.0f} s, {run.own:.0f} s of them in the "
        f"process that asked; the peak of the worker's memory is {run.megabytes:.0f} MB."
    )


def _plant(page: Page, alone: float, asking: float) -> None:
    total = ROBOTS * PROGRAMS
    page.say(
        f"A plant of {ROBOTS} robots with {PROGRAMS:,} programs each has P = {total:,} programs for an update of all "
        f"maps. One program takes t = {1e3 * alone:.0f} ms of a processor in one worker (the serial row), and a = "
        f"{1e3 * asking:.1f} ms in the process that asked (reading, sending, receiving, writing). With W workers and C "
        "commands at a time, each for one robot, the update takes max(P t / W, P a / C): workers beyond C t / a wait "
        "for the commands. Network and disks are not in this model."
    )
    page.head(["workers W", "commands C", "hours by workers", "hours by commands", "hours in all"])
    for workers, commands in ((1, 1), (12, 1), (12, 2), (48, 4), (96, 8), (192, 16)):
        by_workers, by_commands = total * alone / workers / 3600, total * asking / commands / 3600
        hours = f"{by_workers:.1f}", f"{by_commands:.1f}", f"{max(by_workers, by_commands):.1f}"
        page.row(str(workers), str(commands), *hours)
