"""Timing of jobs that several packages can do: warmed up, taken in turns, the median of the repeats."""

from __future__ import annotations

import importlib.metadata
import multiprocessing
import os
import platform
import resource
import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import truepose

REPEATS = 5

HEADS = ("task", "by", "time per item", "minimum", "spread", "times ours", "peak MB", "wanted")

Call = Callable[[], object]


@dataclass(frozen=True)
class Slow:
    """A side that would take too long: it does parts of the items, and all of them follow on a straight line.

    Parameters
    ----------
    call : callable
        Takes the number of items.
    sizes : tuple of int
        One number of items, for a time in proportion; or two, for a line with what does not depend on the number.
    factor : float
        How often the whole is needed (a peer that takes one of three components).
    repeats : int
        Of each; 1 for what takes minutes, without a warm-up then.
    """

    call: Callable[[int], object]
    sizes: tuple[int, ...]
    factor: float = 1
    repeats: int = REPEATS

    def seconds(self, items: int) -> float:
        """Return how long all items would take [s]."""
        times = [clock(lambda size=size: self.call(size)) for size in self.sizes]  # type: ignore[misc]
        if len(times) == 1:
            return self.factor * times[0] * items / self.sizes[0]
        slope = (times[1] - times[0]) / (self.sizes[1] - self.sizes[0])
        return self.factor * (times[0] + slope * (items - self.sizes[0]))


@dataclass(frozen=True)
class Memory:
    """What a fresh process does to find a peak of memory; both can be pickled.

    Parameters
    ----------
    first : callable
        Loads code and compiled kernels with a small problem; what it takes does not count.
    call : callable
    """

    first: Call
    call: Call


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
    memory : Memory, optional
        Our call once more, in a process of its own.
    target : str
        What the ratio should be, for the reader.
    """

    task: str
    sides: Mapping[str, Call | Slow | str]
    items: int = 1
    counts: dict[str, int] = field(default_factory=dict)
    memory: Memory | None = None
    target: str = ""


@dataclass(frozen=True)
class Timing:
    """Median, minimum and spread of one side [s per item], and its peak of memory [MB]; no spread of a single run."""

    side: str
    median: float
    minimum: float
    spread: float | None
    peak: float | None = None
    absent: str = ""


def measure(job: Job, repeats: int = REPEATS) -> list[Timing]:
    """Run every side once to warm up, then all of them in turns; the first is ours."""
    calls = {side: call for side, call in job.sides.items() if not isinstance(call, str)}
    times: dict[str, list[float]] = {side: [] for side in calls}
    for call in calls.values():
        if not isinstance(call, Slow):
            call()
        elif call.repeats > 1:
            call.call(call.sizes[0])
    for turn in range(repeats):
        for side, call in calls.items():
            if isinstance(call, Slow):
                if turn < call.repeats:
                    times[side].append(call.seconds(job.items) / job.items)
            else:
                times[side].append(clock(call) / job.counts.get(side, job.items))
    timings = []
    for side, given in job.sides.items():
        if isinstance(given, str):
            timings.append(Timing(side, float("nan"), float("nan"), None, absent=given))
            continue
        peak = peak_memory(job.memory) if job.memory and not timings else None
        spread = max(times[side]) - min(times[side]) if len(times[side]) > 1 else None
        timings.append(Timing(side, statistics.median(times[side]), min(times[side]), spread, peak))
    return timings


def clock(call: Call) -> float:
    """Return how long a call takes [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def peak_memory(memory: Memory) -> float:
    """Return by how much a call raises the resident memory of a fresh process at its highest [MB]."""
    context = multiprocessing.get_context("spawn")  # a fork would share pages with this process, and lose its threads
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_report_peak, args=(memory, sender))
    process.start()
    sender.close()
    try:
        grown_kb: float = receiver.recv()
    except EOFError:
        raise RuntimeError(
            "the process that measures memory ended without an answer; its message stands above"
        ) from None
    finally:
        process.join()
    return grown_kb / 1024


def _report_peak(memory: Memory, sender: Any) -> None:
    memory.first()
    before = _peak_kb()
    memory.call()
    sender.send(_peak_kb() - before)


def _peak_kb() -> int:
    """Return the highest resident memory of this process [kB]; getrusage's counts the parent's before the start."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM")))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def table(title: str, packages: Iterable[str], results: Iterable[tuple[Job, list[Timing]]]) -> str:
    """Return the results of a topic as Markdown: time per item, ratio to ours, machine and versions."""
    lines = [f"# {title}", "", about(packages), "", _row(HEADS), _row(["---"] * len(HEADS))]
    return "\n".join([*lines, *(row for result in results for row in rows(*result))]) + "\n"


def rows(job: Job, timings: list[Timing]) -> list[str]:
    """Return the rows of one job, a side in each."""
    lines = []
    for i, timing in enumerate(timings):
        first = i == 0
        cells = [timing.absent, "", "", ""]
        if not timing.absent:
            spread = "one run" if timing.spread is None else duration(timing.spread)
            cells = [
                duration(timing.median),
                duration(timing.minimum),
                spread,
                f"{timing.median / timings[0].median:.2f}",
            ]
        peak = "" if timing.peak is None else f"{timing.peak:.0f}"
        lines.append(_row([job.task if first else "", timing.side, *cells, peak, job.target if first else ""]))
    return lines


def about(packages: Iterable[str]) -> str:
    """Return one paragraph on machine, Python and versions of packages."""
    versions = [f"{name} {version}" for name in packages if (version := version_of(name))]
    return (
        f"Median of at least {REPEATS} runs after a warm-up, or one run where a row says so; all sides in turns in one "
        "process. "
        f"{cpu()}; {os.environ.get('OMP_NUM_THREADS', 'all')} thread(s); Python {platform.python_version()}; "
        f"{', '.join(versions)}."
    )


def version_of(distribution: str) -> str | None:
    """Return the installed version of a distribution, or None when it is absent; for truepose that of the sources."""
    if distribution == "truepose":
        return truepose.__version__
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


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
