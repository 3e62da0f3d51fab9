"""Compare the accuracy of the poses of each planning method with the expected one, on virtual and measured cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import UR10, halves
from benchmarks.held_out import Page
from truepose import Samples, VirtualCell, fit_cell, plan
from truepose.cell import Cell
from truepose.errors import TrueposeError
from truepose.planning import Plan

PAGE = "accuracy-plans"
METHODS = ("posterior-largest", "d-optimal", "grid", "latin-hypercube", "sobol")
_NUMBERS = (20, 40, 60, 100, 150)  # of the method posterior
_COMPARED = 40
_HELD_OUT = 300


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page, seeds = Page("Accuracy of plans", path), 1 if quick else 10
    page.say(
        f"The poses of a plan are measured, kinematic Kriging is fitted to them and tried on held-out poses: mean "
        "difference from their readings [mm], noise included; median and range over the runs. What was expected, and "
        "the interval for 80 %, are known before any reading. Virtual cells: "
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


def _row(page: Page, cell: str, method: str, n: int, runs: list[tuple[Plan, float | None]]) -> None:
    left = [found for _, found in runs if found is not None]
    mean, low, high = np.median([[_of_plan(made)[f"{k}_mm"] for k in ("mean", "low", "high")] for made, _ in runs], 0)
    found, spread, ratio = "–", "–", "–"
    if left:
        middle = float(np.median(left))
        found, spread, ratio = f"{middle:.4f}", f"{min(left):.3f}–{max(left):.3f}", f"{middle / mean:.2f}"
    refused = len(runs) - len(left)
    page.row(cell, method, n, found, spread, f"{mean:.4f}", f"{low:.3f}–{high:.3f}", ratio, refused)


def _of_plan(made: Plan) -> dict[str, float]:
    return next(row for row in made.expected if row["n"] == len(made.q))


def _virtual(preset: str, seed: int, n: int, method: str) -> tuple[Plan, float | None]:
    virtual = VirtualCell(preset, seed=seed)
    made = plan(virtual.cell, n, method, rng=seed)
    held_out = virtual.measure(virtual.design(_HELD_OUT, seed=1_000), seed=1)
    return made, _left(virtual.cell, virtual.measure(made.q, seed=2), held_out)


def _measured(fit: Samples, test: Samples, n: int, seed: int) -> tuple[Plan, float | None]:
    assert fit.q is not None
    made = plan(UR10.cell, n, candidates=fit.q, rng=seed)
    rows = np.array([np.abs(fit.q - q).max(axis=1).argmin() for q in made.q])
    return made, _left(UR10.cell, fit[rows], test)


def _left(cell: Cell, samples: Samples, held_out: Samples) -> float | None:
    """Return the mean difference at held-out poses [mm], or None if the fit is refused."""
    try:
        figures: dict[str, Any] = fit_cell(cell, samples, "kinematic-kriging").validate(held_out, rivals=False)
    except TrueposeError:
        return None
    return float(figures["after"]["mean_mm"])
