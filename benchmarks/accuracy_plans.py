"""Compare the accuracy of the poses of each planning method with the expected one, on virtual cells."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks.held_out import Page
from truepose import VirtualCell, fit_cell, plan

PAGE = "accuracy-plans"
METHODS = ("posterior", "posterior-largest", "d-optimal", "grid", "latin-hypercube", "sobol")
_NUMBERS = (20, 40, 80)  # of the method posterior
_COMPARED = 40
_HELD_OUT = 300


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page, seeds = Page("Accuracy of plans", path), 1 if quick else 10
    page.say(
        f"Preset `hard`, seeds 0–{seeds - 1}. Each method's poses are measured, kinematic Kriging is fitted to them "
        f"and tried on {_HELD_OUT} held-out poses: mean difference from their readings [mm], noise included; median "
        "and range over the seeds. What was expected is known before any reading."
    )
    page.head(["method", "poses", "found", "range", "expected", "found / expected"])
    for method in METHODS:
        for n in _NUMBERS if method == "posterior" else (_COMPARED,):
            found: dict[str, list[float]] = defaultdict(list)
            for seed in range(seeds):
                virtual = VirtualCell("hard", seed=seed)
                chosen = plan(virtual.cell, n, method, rng=seed)
                error_map = fit_cell(virtual.cell, virtual.measure(chosen.q, seed=2), "kinematic-kriging")
                held_out = virtual.measure(virtual.design(_HELD_OUT, seed=1_000), seed=1)
                found["left"].append(error_map.validate(held_out, rivals=False)["after"]["mean_mm"])
                found["expected"].append(chosen.expected_mm)
            left, expected = (float(np.median(found[key])) for key in ("left", "expected"))
            spread = f"{min(found['left']):.3f}–{max(found['left']):.3f}"
            page.row(method, n, f"{left:.4f}", spread, f"{expected:.4f}", f"{left / expected:.2f}")
