"""Held-out accuracy on a measured UR10 (`truepose.load_example`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.held_out import Figures, Page, held_out, mean
from truepose import Samples, load_example

UR10 = load_example("ur10")
PAGE = "accuracy"
CANDIDATES = (
    "kinematic-kriging",
    "registration",
    "ordinary-kriging",
    "ordinary-kriging-joint",
    "calibration",
    "calibration:terms=sin1+cos1",
)
TERMS = (
    "calibration-network",
    "kinematic-kriging:residual=none",
    "kinematic-kriging:joint_errors=no",
)  # of the smaller set
PER_CUBE = 9  # its centre and its corners


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page = Page("Accuracy on a measured UR10", path)
    page.say(
        "632 poses on the corners and centres of cubes, measured with a laser tracker; base and tool fitted (data: "
        "Fraunhofer IPA, Series_D of ipa-robot-accuracy, MIT). Mean length of held-out residuals [mm] over random "
        "splits; ± is the standard deviation between splits. Coverage and standardised residuals are those of "
        "components, with the noise of a reading included."
    )
    samples, splits = UR10.samples, 1 if quick else 5
    page.head(["set", "predictor", "mean", "P95", "in 68 %", "in 95 %", "standardised"])
    for title, divide, candidates in (
        ("150 / 316 at random", few, (*CANDIDATES, *TERMS)),
        ("316 / 316 at random", halves, CANDIDATES),
        ("half of the cubes", cubes, CANDIDATES),
    ):
        parts = list(divide(samples, splits))
        for name in candidates:
            found = [held_out(UR10.cell, fit, test, name) for fit, test in parts]
            page.row(title, name, *cells(found))


def cells(found: list[Figures | str]) -> list[str]:
    """Return the cells of a row."""
    good = [one for one in found if isinstance(one, Figures)]
    if len(good) < len(found):
        return [next(one for one in found if isinstance(one, str)), *[""] * 4]
    spread = np.std([one.mean for one in good])
    return [
        f"{mean(good, 'mean'):.3f} ± {spread:.3f}",
        f"{mean(good, 'p95'):.3f}",
        f"{100 * mean(good, 'within_68'):.0f} %",
        f"{100 * mean(good, 'within_95'):.0f} %",
        f"{mean(good, 'standardised'):.2f}",
    ]


def halves(samples: Samples, splits: int) -> Iterator[tuple[Samples, Samples]]:
    """Yield random halves."""
    for seed in range(splits):
        order = np.random.default_rng(seed).permutation(len(samples))
        yield samples[order[:316]], samples[order[316:]]


def few(samples: Samples, splits: int) -> Iterator[tuple[Samples, Samples]]:
    """Yield 150 of each random half, and the other half."""
    for fit, test in halves(samples, splits):
        yield fit[:150], test


def cubes(samples: Samples, splits: int) -> Iterator[tuple[Samples, Samples]]:
    """Yield random halves of the cubes: no cube is in both."""
    cube = np.arange(len(samples)) // PER_CUBE
    for seed in range(splits):
        known = np.random.default_rng(seed).permutation(cube[-1] + 1)[: (cube[-1] + 1) // 2]
        yield samples[np.isin(cube, known)], samples[~np.isin(cube, known)]
