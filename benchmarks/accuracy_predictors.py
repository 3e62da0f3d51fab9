"""Held-out accuracy of every predictor name and of the options that were names before (docs/choosing.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks import accuracy
from benchmarks.accuracy_virtual import TEST, measured
from benchmarks.held_out import Figures, Page, held_out, mean
from truepose import Cell, Samples, VirtualCell
from truepose.predictors import FORMER_NAMES, PREDICTORS

PAGE = "accuracy-predictors"
_SAMPLES = 100  # of a virtual cell
Part = tuple[Cell, Samples, Samples]


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    seeds = 1 if quick else 5
    page = Page("Accuracy of all predictors", path)
    page.say(
        f"Mean length of held-out residuals, noise included. Presets `paper` and `hard`: {_SAMPLES} samples, {TEST} "
        "held-out poses. Measured UR10: 150 samples, 316 held-out poses; ± is the standard deviation between splits. "
        f"Seeds and splits 0 to {seeds - 1}."
    )
    sets = [*(virtual(preset, seeds) for preset in ("paper", "hard")), ur10(seeds)]
    page.head(["predictor", "paper [mm]", "hard [mm]", "UR10 [mm]", "UR10 P95 [mm]", "UR10 in 95 %"])
    for name in (*PREDICTORS, *FORMER_NAMES.values()):
        found = [[held_out(*part, name) for part in parts] for parts in sets]
        failed = [one for each in found for one in each if isinstance(one, str)]
        if failed:
            page.row(f"`{name}`", failed[0])
            continue
        good = [[one for one in each if isinstance(one, Figures)] for each in found]
        spread = float(np.std([one.mean for one in good[-1]]))
        means = [f"{mean(each, 'mean'):.4f}" for each in good]
        in_95 = f"{100 * mean(good[-1], 'within_95'):.0f} %"
        page.row(f"`{name}`", *means[:2], f"{means[2]} ± {spread:.4f}", f"{mean(good[-1], 'p95'):.3f}", in_95)


def virtual(preset: str, seeds: int) -> list[Part]:
    """Return cell, samples to fit and samples to test of each seed."""
    cells = [VirtualCell(preset, seed=seed) for seed in range(seeds)]
    return [
        (cell.cell, measured(cell, _SAMPLES, seed), measured(cell, TEST, seed + 10_000))
        for seed, cell in enumerate(cells)
    ]


def ur10(splits: int) -> list[Part]:
    """Return cell, samples to fit and samples to test of each random split."""
    return [(accuracy.UR10.cell, *part) for part in accuracy.few(accuracy.UR10.samples, splits)]
