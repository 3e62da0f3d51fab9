"""Accuracy of the next robot of a fleet with maps of the earlier ones as a prior, on virtual fleets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.conditions import Left, left
from benchmarks.held_out import Page
from truepose import ErrorMap, VirtualCell, fit_cell
from truepose.samples import Poses
from truepose.simulation import VirtualFleet

PAGE = "fleet"
PREDICTOR = "kinematic-kriging"
EARLIER, TARGETS = 100, 200
SHARES, COUNTS, ROBOTS = (0.0, 0.5, 0.9), (20, 30, 40, 60, 80, 120), (1, 3, 8)


class Row(NamedTuple):
    """One fit to one robot: the share, the poses, the earlier robots, what is left, and what was taken."""

    share: float
    n: int
    k: int
    left: Left
    taken: str


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    seeds = range(2 if quick else 20)
    page = Page("Accuracy of the next robot of a fleet", path)
    page.say(
        "Virtual robots of 210 kg (preset hard, see docs/virtual-cell.md). Geometry and joint errors have a common "
        f"part, of the stated share of the variance. Maps of k earlier robots ({EARLIER} poses each) are a prior of "
        f"the next one, with n poses. Means over {len(seeds)} fleets; errors are those of the prediction at {TARGETS} "
        "other poses against the truth without noise; the ratio is that to the fit without earlier maps, fleet by "
        "fleet: mean and largest. 'Worth' is the number of poses with which a fit without earlier maps has the same "
        "mean error, interpolated, over n."
    )
    page.head(["share", "n", "k", "mean [mm]", "std [mm]", "in 95 %", "ratio", "worst ratio", "worth", "mean taken"])
    rows = [row for share in SHARES for seed in seeds for row in fleet(share, seed)]
    for share in SHARES:
        alone = [_mean(rows, share, n, 0) for n in COUNTS]
        for n in COUNTS[:4]:
            for k in (0, *ROBOTS):
                here = [row for row in rows if (row.share, row.n, row.k) == (share, n, k)]
                plain = np.array([row.left.mean for row in rows if (row.share, row.n, row.k) == (share, n, 0)])
                ratio = np.array([row.left.mean for row in here]) / plain
                worth = float(np.interp(-np.log(_mean(rows, share, n, k)), -np.log(alone), COUNTS))
                taken = Counter(row.taken for row in here)["mean"]
                page.row(
                    share,
                    n,
                    k,
                    f"{np.mean([row.left.mean for row in here]):.4f}",
                    f"{np.mean([row.left.std for row in here]):.4f}",
                    f"{100 * np.mean([row.left.inside for row in here]):.0f} %",
                    f"{ratio.mean():.2f}",
                    f"{ratio.max():.2f}",
                    f"{worth / n:.1f}",
                    f"{taken} of {len(here)}" if k else "",
                )


def fleet(share: float, seed: int) -> Iterator[Row]:
    """Yield the rows of one fleet: the next robot is number 0."""
    robots = VirtualFleet("hard", share=share, seed=seed)
    earlier = [_fitted(robots.cell(number), EARLIER, number) for number in range(1, ROBOTS[-1] + 1)]
    following = robots.cell(0)
    poses = Poses(q=following.design(TARGETS, seed=seed + 999))
    for n in COUNTS:
        for k in (0, *ROBOTS) if n <= COUNTS[3] else (0,):
            found = _fitted(following, n, seed, earlier[:k])
            taken = found.predictor.fleet_.get("taken", "")  # type: ignore[attr-defined]  # of kinematic Kriging
            yield Row(share, n, k, left(following, found, poses), taken)


def _fitted(cell: VirtualCell, n: int, seed: int, like: list[ErrorMap] | None = None) -> ErrorMap:
    return fit_cell(cell.cell, cell.measure(cell.design(n, seed=seed), seed=seed), PREDICTOR, like=like or [])


def _mean(rows: list[Row], share: float, n: int, k: int) -> float:
    return float(np.mean([row.left.mean for row in rows if (row.share, row.n, row.k) == (share, n, k)]))
