"""Frozen maps: one pose in a control loop, and predictions per second, beside the full map in the same run.

The samples are those of the virtual cell "hard". Times of one pose are those of single calls from Python, taken in
turns; a busy machine spoils the upper percentiles first.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import REPEATS, clock, duration
from benchmarks.held_out import Page
from truepose import ErrorMap, FrozenMap, VirtualCell, fit_cell
from truepose.numerics.threads import kernel_count
from truepose.samples import Poses

PAGE = "benchmarks-frozen"
CALLS = 5_000
MAPS = (("kinematic-kriging", 150), ("kinematic-kriging", 300), ("kinematic-kriging", 1_000), ("calibration", 150))


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the benchmark."""
    page = Page("Benchmarks: frozen maps", path)
    maps = {(name, n): _fitted(name, n) for name, n in (MAPS[:1] if quick else MAPS)}
    page.say("## One pose")
    page.say(
        f"{CALLS if not quick else 100:,} calls at random poses, in turns; slow sides every 10 or 50. Wanted of "
        "`predict_into`: at most 20 µs (half of the calls) and 50 µs (99 %); of `predict_measured`: at most 1 ms."
    )
    page.head(["map", "n", "by", "minimum", "median", "99 %", "times ours"])
    for (name, n), error_map in maps.items():
        _one_pose(page, name, n, error_map, 100 if quick else CALLS)
    page.say("## Predictions per second")
    page.say(
        f"Fastest of {REPEATS} runs, {kernel_count()} thread(s) of the frozen map; the full map computes 10,000 poses. "
        "Wanted: mean 1,000,000 per second on two cores."
    )
    page.head(["map", "n", "by", "per second", "ours is faster by"])
    for (name, n), error_map in maps.items():
        _per_second(page, name, n, error_map, 10_000 if quick else 1_000_000)
    page.say("## Freezing")
    page.head(["map", "n", "largest difference", "freeze", "load", "file"])
    for (name, n), error_map in maps.items():
        _freezing(page, name, n, error_map)


def _fitted(name: str, n: int) -> ErrorMap:
    virtual = VirtualCell("hard", seed=100)
    return fit_cell(virtual.cell, virtual.measure(virtual.design(n)), name)


def _poses(error_map: ErrorMap, m: int) -> Any:
    low, high = error_map.samples.q.min(axis=0), error_map.samples.q.max(axis=0)  # type: ignore[union-attr]
    return np.random.default_rng(0).uniform(low, high, (m, len(low)))


def _one_pose(page: Page, name: str, n: int, error_map: ErrorMap, calls: int) -> None:
    frozen, out, q = error_map.freeze(), np.empty(3), _poses(error_map, calls)
    tool = error_map.tf_flange_tool
    sides: dict[str, tuple[Callable[[Any], object], int]] = {
        "frozen, predict_into": (lambda pose: frozen.predict_into(pose, out), 1),
        "frozen, predict": (frozen.predict, 1),
        "mean of the map": (lambda pose: error_map.predict_mean_with_tool(pose[None], tool), 10),
        "predict_measured of the map": (lambda pose: error_map.predict_measured(pose[None]), 10),
        "correct of the map": (lambda pose: error_map.correct(pose[None], on_guard="skip", accept_weak_map=True), 50),
    }
    taken: dict[str, list[float]] = {side: [] for side in sides}
    for call, _ in sides.values():
        call(q[0])
    for k, pose in enumerate(q):
        for side, (call, every) in sides.items():
            if k % every == 0:
                start = time.perf_counter()
                call(pose)
                taken[side].append(time.perf_counter() - start)
    ours = float(np.median(taken["frozen, predict_into"]))
    for side, times in taken.items():
        low, half, high = np.quantile(times, [0.0, 0.5, 0.99])
        page.row(name, f"{n:,}", side, duration(low), duration(half), duration(high), f"{half / ours:.3g}")


def _per_second(page: Page, name: str, n: int, error_map: ErrorMap, m: int) -> None:
    frozen, q, few = error_map.freeze(), _poses(error_map, m), _poses(error_map, 10_000)
    frozen.predict(few)
    ours = m / min(clock(lambda: frozen.predict(q)) for _ in range(REPEATS))
    mean = len(few) / min(clock(lambda: error_map.predictor.predict(few)) for _ in range(REPEATS))
    both = len(few) / min(clock(lambda: error_map.predict_errors(Poses(q=few))) for _ in range(REPEATS))
    page.row(name, f"{n:,}", "frozen", f"{ours:,.0f}", "1")
    page.row(name, f"{n:,}", "mean of the map", f"{mean:,.0f}", f"{ours / mean:.3g}")
    page.row(name, f"{n:,}", "mean and standard deviation of the map", f"{both:,.0f}", f"{ours / both:.3g}")


def _freezing(page: Page, name: str, n: int, error_map: ErrorMap) -> None:
    frozen = error_map.freeze()
    took = min(clock(error_map.freeze) for _ in range(REPEATS))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.frozen"
        frozen.save(file)
        load = min(clock(lambda: FrozenMap.load(file, error_map)) for _ in range(REPEATS))
        size = file.stat().st_size
    difference = f"{1e3 * frozen.difference_mm:.2g} µm"
    page.row(name, f"{n:,}", difference, duration(took), duration(load), f"{size / 1000:.0f} kB")
