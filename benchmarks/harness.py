"""Timing of jobs that several packages can do: warmed up, taken in turns, the median of the repeats."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import resource
import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

REPEATS = 5

Call = Callable[[], object]


@dataclass(frozen=True)
class Job:
    """One task, done by several sides.

    Parameters
    ----------
    task : str
        What is done, with its size: "forward kinematics, 100,000 poses".
    sides : dict of name to call without arguments
        The first is ours, the others are compared with it. A text in place of a call says why that side is absent.
    items : int
        How many things one call of a side handles; the table gives the time per item.
    counts : dict of name to int
        Items of the sides that handle fewer (a peer that takes one pose at a time).
    memory : bool
        Also take the peak of memory of one call, in a forked process.
    target : str
        What the ratio should be, for the reader.
    """

    task: str
    sides: dict[str, Call | str]
    items: int = 1
    counts: dict[str, int] = field(default_factory=dict)
    memory: bool = False
    target: str = ""


@dataclass(frozen=True)
class Timing:
    """Median and spread of one side [s per item], and its peak of memory [MB]."""

    side: str
    median: float
    spread: float
    peak: float | None = None
    absent: str = ""


def measure(job: Job, repeats: int = REPEATS) -> list[Timing]:
    """Run every side once to warm up, then all of them in turns; the first is ours."""
    calls = {side: call for side, call in job.sides.items() if not isinstance(call, str)}
    times: dict[str, list[float]] = {side: [] for side in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for side, call in calls.items():
            start = time.perf_counter()
            call()
            times[side].append((time.perf_counter() - start) / job.counts.get(side, job.items))
    timings = []
    for side, given in job.sides.items():
        if isinstance(given, str):
            timings.append(Timing(side, float("nan"), float("nan"), absent=given))
            continue
        peak = peak_memory(given) if job.memory else None
        timings.append(Timing(side, statistics.median(times[side]), max(times[side]) - min(times[side]), peak))
    return timings


def peak_memory(call: Call) -> float:
    """Return by how much one call raises the resident memory at its highest [MB], measured in a forked process."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        try:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            call()
            grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
            os.write(writer, str(grown).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        grown_kb = pipe.read()
    os.waitpid(child, 0)
    return float(grown_kb) / 1024 if grown_kb else float("nan")


def table(title: str, packages: Iterable[str], results: Iterable[tuple[Job, list[Timing]]]) -> str:
    """Return the results of a topic as Markdown: time per item, ratio to ours, machine and versions."""
    results = list(results)
    with_peak = any(timing.peak is not None for _, timings in results for timing in timings)
    heads = ["task", "by", "time per item", "spread", "times ours", *(["peak MB"] if with_peak else []), "wanted"]
    lines = [f"# {title}", "", about(packages), "", _row(heads), _row(["---"] * len(heads))]
    for job, timings in results:
        ours = timings[0].median
        for i, timing in enumerate(timings):
            cells = [job.task if i == 0 else "", timing.side]
            if timing.absent:
                cells += [timing.absent, "", "", *([""] if with_peak else [])]
            else:
                cells += [duration(timing.median), duration(timing.spread), f"{timing.median / ours:.2f}"]
                cells += ["" if timing.peak is None else f"{timing.peak:.0f}"] if with_peak else []
            lines.append(_row([*cells, job.target if i == 0 else ""]))
    return "\n".join(lines) + "\n"


def about(packages: Iterable[str]) -> str:
    """Return one paragraph on machine, Python and versions of packages."""
    versions = [f"{name} {version}" for name in packages if (version := version_of(name))]
    return (
        f"Median of at least {REPEATS} runs after a warm-up, all sides in turns in one process. "
        f"{cpu()}; {os.environ.get('OMP_NUM_THREADS', 'all')} thread(s); Python {platform.python_version()}; "
        f"{', '.join(versions)}."
    )


def version_of(distribution: str) -> str | None:
    """Return the installed version of a distribution, or None when it is absent."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def cpu() -> str:
    """Return the processor's name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text("utf-8").splitlines() if info.exists() else []
    named = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def duration(seconds: float) -> str:
    """Return a time with three digits and a fitting unit."""
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= factor:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
