"""Held-out accuracy on virtual cells whose truth and noise floor are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.held_out import Figures, Page, held_out, mean
from truepose import Samples, VirtualCell

PAGE = "accuracy-virtual"
CANDIDATES = (
    "ordinary-kriging",
    "ordinary-kriging-joint",
    "calibration",
    "calibration:terms=sin1+cos1",
    "kinematic-kriging",
)
TEST = 300


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page = Page("Accuracy on virtual cells", path)
    seeds = range(2 if quick else 10)
    page.say(
        f"Virtual robots of 210 kg with a tracker; {TEST} held-out poses, means over {len(seeds)} robots (seeds 0 …). "
        "Ratio: mean held-out residual over the noise floor, the mean length of repeatability and reading noise. "
        "Coverage and standardised residuals are those of components, with the noise of a reading included."
    )
    columns = ["cell", "predictor", "mean [mm]", "P95", "ratio", "worst ratio", "in 68 %", "in 95 %", "standardised"]
    page.head(columns)
    whole = study(page, "hard, 200 samples", seeds, lambda cell, seed: measured(cell, 200, seed))
    study(
        page,
        "hard, one orientation, 200",
        seeds,
        lambda cell, seed: measured(cell, 200, seed, 0.0),
        CANDIDATES[2:],
        0.0,
    )
    study(page, "hard, 30 samples", seeds, lambda cell, seed: measured(cell, 30, seed))
    gross = study(page, "hard, 200, 2 % gross", seeds, spoiled, CANDIDATES[-1:])
    study(page, "paper, 100 samples", seeds, lambda cell, seed: measured(cell, 100, seed), preset="paper")
    kriging = gross["kinematic-kriging"]
    change = [g.mean / w.mean - 1 for g, w in zip(kriging, whole["kinematic-kriging"], strict=True)]
    named = [
        len(set(gross_rows(seed)) & {row["row"] for row in one.error_map.excluded}) for seed, one in enumerate(kriging)
    ]
    page.say(
        "2 % gross readings (1 to 5 mm) change the held-out mean of kinematic-kriging by "
        f"{100 * np.mean(change):+.1f} % on average and {100 * max(change):+.1f} % at most; "
        f"{sum(named)} of {4 * len(named)} are found."
    )
    reference = mean(whole["kinematic-kriging"], "mean")
    for other in ("calibration", "ordinary-kriging"):
        page.say(
            "Mean residual of kinematic-kriging: "
            f"{100 * (1 - reference / mean(whole[other], 'mean')):.0f} % below {other}."
        )


def study(
    page: Page,
    title: str,
    seeds: range,
    measure: Callable[[VirtualCell, int], Samples],
    candidates: tuple[str, ...] = CANDIDATES,
    orientation_deg: float | None = None,
    preset: str = "hard",
) -> dict[str, list[Figures]]:
    """Add the rows of one kind of samples, and return the figures of each candidate and seed."""
    cells = [VirtualCell(preset, seed=seed) for seed in seeds]
    fits = [measure(cell, seed) for seed, cell in enumerate(cells)]
    tests = [measured(cell, TEST, seed + 10_000, orientation_deg) for seed, cell in enumerate(cells)]
    out = {}
    for name in candidates:
        found = [held_out(cell.cell, fit, test, name) for cell, fit, test in zip(cells, fits, tests, strict=True)]
        good = [one for one in found if isinstance(one, Figures)]
        if len(good) < len(found):
            page.row(title, name, f"{len(found) - len(good)} failed: {next(f for f in found if isinstance(f, str))}")
            continue
        ratio = [one.mean / cell.noise_floor for one, cell in zip(good, cells, strict=True)]
        page.row(
            title,
            name,
            f"{mean(good, 'mean'):.4f}",
            f"{mean(good, 'p95'):.3f}",
            f"{np.mean(ratio):.2f}",
            f"{max(ratio):.2f}",
            *(f"{100 * mean(good, within):.0f} %" for within in ("within_68", "within_95")),
            f"{mean(good, 'standardised'):.2f}",
        )
        out[name] = good
    return out


def measured(cell: VirtualCell, n: int, seed: int, orientation_deg: float | None = None) -> Samples:
    """Return n readings."""
    return cell.measure(cell.design(n, seed=seed, orientation_deg=orientation_deg), seed=seed)


def gross_rows(seed: int) -> list[int]:
    """Return which 4 of 200 readings are gross."""
    rows: list[int] = np.random.default_rng(seed).choice(200, 4, replace=False).tolist()
    return rows


def spoiled(cell: VirtualCell, seed: int) -> Samples:
    """Return 200 readings of which 4 are off by 1 … 5 mm in random directions."""
    samples, rng = measured(cell, 200, seed), np.random.default_rng(seed + 1)
    direction = rng.normal(size=(4, 3))
    shift = np.zeros((200, 3))
    shift[gross_rows(seed)] = direction / np.linalg.norm(direction, axis=1)[:, None] * rng.uniform(1, 5, (4, 1))
    return replace(samples, p_meas=samples.p_meas + shift)
