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
TURNS = 10
MAPS = (("kinematic-kriging", 150), ("kinematic-kriging", 300), ("kinematic-kriging", 1_000), ("calibration", 150))


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the benchmark."""
    page = Page("Benchmarks: frozen maps", path)
    maps = {(name, n): _fitted(name, n) for name, n in (MAPS[:1] if quick else MAPS)}
    page.say("## One pose")
    page.say(
        f"{CALLS if not quick else 100:,} calls at random poses in {TURNS} turns; a tenth or less of slow sides. "
        "Wanted of `predict_into`: at most 20 µs (half of the calls) and 50 µs (99 %); of `predict_measured`: at most "
        "1 ms."
    )
    page.head(["map", "n", "by", "minimum", "median", "99 %", "times ours"])
    for (name, n), error_map in maps.items():
        _one_pose(page, name, n, error_map, 100 if quick else CALLS)
    page.say("## Predictions per second")
    page.say(
        f"Fastest of {REPEATS} runs, {kernel_count()} thread(s) of the frozen map; the full map computes 10,000 poses. "
        "Wanted on two cores: mean 1,000,000 per second (2 µs of CPU each), with standard deviation 100,000 (20 µs). "
        "The ratio is that of CPU times, which other work on the machine changes least."
    )
    page.head(
        ["map", "n", "result", "frozen, per second", "map, per second", "frozen, CPU each", "map, CPU each", "ratio"]
    )
    for (name, n), error_map in maps.items():
        _per_second(page, name, n, error_map, 10_000 if quick else 1_000_000)
    page.say("## Freezing")
    page.say(
        "Difference of the mean: largest of 2,000 poses within the limits. Deviation over that of the map: half, and "
        "99 %, of 10,000 poses within the samples' range of each joint; never below 1."
    )
    page.head(["map", "n", "difference of the mean", "deviation over the map's", "freeze", "load", "file"])
    for (name, n), error_map in maps.items():
        for std in (False, True) if name == "kinematic-kriging" else (False,):
            _freezing(page, name, n, error_map, std)


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
        **_with_std(error_map),
        "mean of the map": (lambda pose: error_map.predict_mean_with_tool(pose[None], tool), 10),
        "predict_measured of the map": (lambda pose: error_map.predict_measured(pose[None]), 10),
        "correct of the map": (lambda pose: error_map.correct(pose[None], on_guard="skip", accept_weak_map=True), 50),
    }
    taken: dict[str, list[float]] = {side: [] for side in sides}
    for call, _ in sides.values():
        call(q[0])
    for turn in range(TURNS):
        for side, (call, share) in sides.items():
            for pose in q[turn::TURNS][: -(-calls // TURNS // share)]:
                start = time.perf_counter()
                call(pose)
                taken[side].append(time.perf_counter() - start)
    ours = float(np.median(taken["frozen, predict_into"]))
    for side, times in taken.items():
        low, half, high = np.quantile(times, [0.0, 0.5, 0.99])
        page.row(name, f"{n:,}", side, duration(low), duration(half), duration(high), f"{half / ours:.3g}")


def _with_std(error_map: ErrorMap) -> dict[str, tuple[Callable[[Any], object], int]]:
    """Return the side that predicts with standard deviation, where that can be frozen."""
    if error_map.predictor_name != "kinematic-kriging":
        return {}
    frozen = error_map.freeze(std=True)
    return {"frozen, predict with standard deviation": (lambda pose: frozen.predict(pose, return_std=True), 10)}


def _per_second(page: Page, name: str, n: int, error_map: ErrorMap, m: int) -> None:
    q, few = _poses(error_map, m), _poses(error_map, 10_000)
    rows: list[tuple[str, Callable[[], object], int, Callable[[], object]]] = []
    frozen = error_map.freeze(std=name == "kinematic-kriging")
    rows.append(("mean", lambda: frozen.predict(q), m, lambda: error_map.predictor.predict(few)))
    if frozen.deviation is not None:
        part = q[: m // 10]
        both = lambda: frozen.predict(part, return_std=True)  # noqa: E731
        rows.append(("with standard deviation", both, len(part), lambda: error_map.predict_errors(Poses(q=few))))
    for result, ours, count, theirs in rows:
        ours(), theirs()
        fast, cpu = (least / count for least in _least(ours))
        slow, their_cpu = (least / len(few) for least in _least(theirs))
        ratio = f"{their_cpu / cpu:.3g}"
        page.row(
            name, f"{n:,}", result, f"{1 / fast:,.0f}", f"{1 / slow:,.0f}", duration(cpu), duration(their_cpu), ratio
        )


def _least(call: Callable[[], object]) -> tuple[float, float]:
    """Return the least time on the clock and of the processor [s] of some runs."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        times.append((clock(call), time.process_time() - start))
    return min(wall for wall, _ in times), min(cpu for _, cpu in times)


def _freezing(page: Page, name: str, n: int, error_map: ErrorMap, std: bool) -> None:
    frozen, ratio = error_map.freeze(std=std), "–"
    took = min(clock(lambda: error_map.freeze(std=std)) for _ in range(REPEATS))
    if std:
        q = _poses(error_map, 10_000)
        over = frozen.predict(q, return_std=True)[1] / error_map.predict_errors(Poses(q=q))[1]
        assert over.min() > 1.0 - 1e-9
        ratio = " / ".join(f"{value:.4f}" for value in np.quantile(over, [0.5, 0.99]))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.frozen"
        frozen.save(file)
        load = min(clock(lambda: FrozenMap.load(file, error_map)) for _ in range(REPEATS))
        size = file.stat().st_size
    difference = f"{1e3 * frozen.difference_mm:.2g} µm"
    page.row(name, f"{n:,}", difference, ratio, duration(took), duration(load), f"{size / 1000:.0f} kB")
