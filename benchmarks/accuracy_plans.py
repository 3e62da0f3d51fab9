"""Compare the accuracy of the poses of each planning method with the expected one, on virtual and measured cells."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import UR10, halves
from benchmarks.held_out import Page
from truepose import Samples, VirtualCell, fit_cell, plan
from truepose._typing import IntArray
from truepose.cell import Cell
from truepose.errors import TrueposeError
from truepose.planning import Plan

PAGE = "accuracy-plans"
METHODS = ("posterior-largest", "d-optimal", "grid", "latin-hypercube", "sobol")
_NUMBERS = (20, 40, 60, 100, 150)  # of the method posterior
_SERIES = (20, 40)  # of a first series, and again of the second
_COMPARED = 40
_HELD_OUT = 300


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page, seeds = Page("Accuracy of plans", path), 1 if quick else 10
    page.say(
        f"The poses of a plan are measured, kinematic Kriging is fitted to them and tried on held-out poses: mean "
        "difference from their readings [mm], noise included; median and range over the runs. What was expected, and "
        "the interval for 80 %, are known before any reading of the poses that are added. Virtual cells: "
        f"seeds 0–{seeds - 1}, {_HELD_OUT} held-out poses. Measured UR10: poses chosen among a random half of 632, "
        "tried on the other half. A run whose fit is refused is counted and left out."
    )
    page.head(["cell", "method", "poses", "found", "range", "expected", "80 %", "found / expected", "refused"])
    for preset in ("hard", "paper"):
        for n in _NUMBERS:
            _row(page, preset, "posterior", n, [_virtual(preset, seed, n, "posterior") for seed in range(seeds)])
    for method in METHODS:
        _row(page, "hard", method, _COMPARED, [_virtual("hard", s, _COMPARED, method) for s in range(seeds)])
    splits = list(enumerate(halves(UR10.samples, 1 if quick else 5)))
    for n in _NUMBERS:
        _row(page, "UR10", "posterior", n, [_measured(fit, test, n, seed) for seed, (fit, test) in splits])
    for n in _SERIES:
        for part, title in enumerate((f"{n} known, expected from them", f"{n} known, then {n} chosen after them")):
            count = n * (1 + part)
            _row(page, "hard", title, count, [_virtual_series("hard", s, n)[part] for s in range(seeds)])
            _row(page, "UR10", title, count, [_measured_series(seed, n)[part] for seed, _ in splits])


def _row(page: Page, cell: str, method: str, n: int, runs: list[Run]) -> None:
    left = [found for _, found in runs if found is not None]
    mean, low, high = np.median([[made[f"{k}_mm"] for k in ("mean", "low", "high")] for made, _ in runs], 0)
    found, spread, ratio = "–", "–", "–"
    if left:
        middle = float(np.median(left))
        found, spread, ratio = f"{middle:.4f}", f"{min(left):.3f}–{max(left):.3f}", f"{middle / mean:.2f}"
    refused = len(runs) - len(left)
    page.row(cell, method, n, found, spread, f"{mean:.4f}", f"{low:.3f}–{high:.3f}", ratio, refused)


Run = tuple[dict[str, float], float | None]
"""What was expected, and the mean difference that was found, or None."""


def _of_plan(made: Plan, n: int) -> dict[str, float]:
    return next(row for row in made.expected if row["n"] == n)


def _virtual(preset: str, seed: int, n: int, method: str) -> Run:
    virtual = VirtualCell(preset, seed=seed)
    made = plan(virtual.cell, n, method, rng=seed)
    return _of_plan(made, n), _left(virtual.cell, virtual.measure(made.q, seed=2), _held_out(virtual))


def _held_out(virtual: VirtualCell) -> Samples:
    return virtual.measure(virtual.design(_HELD_OUT, seed=1_000), seed=1)


@cache
def _virtual_series(preset: str, seed: int, n: int) -> list[Run]:
    """Return the run of n poses, as expected from their readings, and that of n more poses after them."""
    virtual = VirtualCell(preset, seed=seed)
    first = plan(virtual.cell, n, rng=seed).q
    known = virtual.measure(first, seed=2)
    then = plan(virtual.cell, n, rng=seed, after=known)
    every = virtual.measure(np.concatenate([first, then.q]), seed=2)
    held_out = _held_out(virtual)
    return [
        (_of_plan(then, count), _left(virtual.cell, samples, held_out)) for count, samples in ((0, known), (n, every))
    ]


def _measured(fit: Samples, test: Samples, n: int, seed: int) -> Run:
    made = plan(UR10.cell, n, candidates=fit.q, rng=seed)
    return _of_plan(made, n), _left(UR10.cell, fit[_rows(fit, made)], test)


@cache
def _measured_series(seed: int, n: int) -> list[Run]:
    """As `_virtual_series`, with poses of a random half of the measured robot."""
    fit, test = list(halves(UR10.samples, seed + 1))[seed]
    known = _rows(fit, plan(UR10.cell, n, candidates=fit.q, rng=seed))
    then = plan(UR10.cell, n, candidates=fit.q, rng=seed, after=fit[known])
    every = np.concatenate([known, _rows(fit, then)])
    return [(_of_plan(then, count), _left(UR10.cell, fit[rows], test)) for count, rows in ((0, known), (n, every))]


def _rows(fit: Samples, made: Plan) -> IntArray:
    assert fit.q is not None
    return np.array([np.abs(fit.q - q).max(axis=1).argmin() for q in made.q])


def _left(cell: Cell, samples: Samples, held_out: Samples) -> float | None:
    """Return the mean difference at held-out poses [mm], or None if the fit is refused."""
    try:
        figures: dict[str, Any] = fit_cell(cell, samples, "kinematic-kriging").validate(held_out, rivals=False)
    except TrueposeError:
        return None
    return float(figures["after"]["mean_mm"])
