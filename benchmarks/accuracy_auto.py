"""Compare the held-out accuracy of auto with the best of its candidates."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks import accuracy
from benchmarks.accuracy_virtual import TEST, measured, spoiled
from benchmarks.held_out import Figures, Page, held_out
from truepose import Cell, Samples, VirtualCell
from truepose.predictors.selection.choice import QUICK

PAGE = "accuracy-auto"


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page = Page("Accuracy of auto", path)
    page.say(
        "Mean length of held-out residuals [mm] of the predictor that auto chooses and of the best of its candidates, "
        "their ratio, and the expected mean that auto reports for random points and for blocks, which are harder than "
        "random held-out poses."
    )
    page.head(["set", "chosen", "auto [mm]", "best", "best [mm]", "ratio", "expected: points", "blocks"])
    ratios = []
    for title, cell, samples, test in sets(quick):
        every = {name: held_out(cell, samples, test, name) for name in QUICK}
        means = {name: one.mean for name, one in every.items() if isinstance(one, Figures)}
        auto = held_out(cell, samples, test, "auto")
        if isinstance(auto, str):
            page.row(title, auto)
            continue
        best = min(means, key=lambda name: means[name])
        ratios.append(auto.mean / means[best])
        expected = auto.error_map.expected["splits"]
        page.row(
            title,
            auto.error_map.predictor_name,
            f"{auto.mean:.4f}",
            best,
            f"{means[best]:.4f}",
            ratios[-1],
            *(expected[split]["mean_mm"] for split in ("points", "blocks")),
        )
    page.say(f"Largest ratio: {max(ratios):.3f}.")


def sets(quick: bool) -> Iterator[tuple[str, Cell, Samples, Samples]]:
    """Yield title, cell, samples to fit and samples to test."""
    for preset, n, seeds in (("hard", 30, 5), ("paper", 30, 5), ("hard", 100, 2), ("paper", 100, 3), ("hard", 200, 1)):
        for seed in range(1 if quick else seeds):
            cell = VirtualCell(preset, seed=seed)
            title = f"{preset}, {n} samples, seed {seed}"
            yield title, cell.cell, measured(cell, n, seed), measured(cell, TEST, seed + 10_000)
    if not quick:
        cell = VirtualCell("hard", seed=0)
        test = measured(cell, TEST, 10_000)
        yield "hard, 200 samples, 2 % gross, seed 0", cell.cell, spoiled(cell, 0), test
        one = measured(cell, 200, 0, 0.0), measured(cell, TEST, 10_000, 0.0)
        yield "hard, 200 samples, one orientation, seed 0", cell.cell, *one
    ur10, samples = accuracy.UR10.cell, accuracy.UR10.samples
    for seed, (fit, test) in enumerate(accuracy.halves(samples, 1 if quick else 2)):
        for n in (60,) if quick else (60, 100, 150):
            yield f"UR10, {n} at random, split {seed}", ur10, fit[:n], test
    if not quick:
        fit, test = next(accuracy.cubes(samples, 1))
        yield "UR10, half of the cubes, split 0", ur10, fit, test
