"""Accuracy with distances from fixed points beside positions, on virtual cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.conditions import PREDICTOR, TARGETS, Case, left
from benchmarks.held_out import Page
from truepose import VirtualCell, fit_cell
from truepose._typing import FloatArray
from truepose.geometry import apply_transform, invert_transform
from truepose.samples import Distances, Poses, Samples

PAGE = "distances"
POSES, MORE, NOISE = 40, 60, 0.01
POINTS = np.array([[2500.0, -1500.0, 200.0], [2500.0, 1500.0, 800.0], [900.0, 0.0, 1500.0]])  # mm, robot base
GROUPS = (("geometry alone", "paper"), ("joint errors, compliance", "hard"))


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    seeds = range(2 if quick else 20)
    page = Page("Distances from fixed points", path)
    page.say(
        f"Virtual robots of 210 kg (presets paper and hard, see docs/virtual-cell.md), {POSES} measured positions and "
        f"{MORE} further poses, {TARGETS} other poses; means over {len(seeds)} robots (seeds 0 …). Errors are those of "
        "the prediction against the truth without noise. At the further poses nothing is measured, the distance from "
        f"one fixed point or from one of three ({NOISE:g} mm), or the position. Each further pose is one motion with "
        "the robot's repeatability. The ratio is to positions alone, robot by robot: of the means, and the largest."
    )
    page.head(["errors of the robot", "further poses", "mean [mm]", "std [mm]", "in 95 %", "ratio", "worst ratio"])
    found = [case for seed in seeds for case in cases(seed)]
    for group, name in dict.fromkeys((case.group, case.name) for case in found):
        rows = [case.left for case in found if (case.group, case.name) == (group, name)]
        alone = np.array([case.left.mean for case in found if (case.group, case.name) == (group, "nothing")])
        means = np.array([row.mean for row in rows])
        page.row(
            group,
            name,
            f"{means.mean():.4f}",
            f"{np.mean([row.std for row in rows]):.4f}",
            f"{100 * np.mean([row.inside for row in rows]):.0f} %",
            f"{means.mean() / alone.mean():.2f}",
            f"{(means / alone).max():.2f}",
        )


def cases(seed: int) -> Iterator[Case]:
    """Return the rows of one robot."""
    for group, preset in GROUPS:
        cell = VirtualCell(preset, seed=seed)
        targets = Poses(q=cell.design(TARGETS, seed=seed + 999))
        samples = cell.measure(cell.design(POSES, seed=seed), seed=seed)
        q = cell.design(MORE, seed=seed + 500)
        points = apply_transform(invert_transform(cell.truth.tf_base_tracker), POINTS)
        p = _positions(cell, q, seed)
        measured = {
            "nothing": samples,
            "distance from one point": _with(samples, q, p, points[:1], seed),
            "distance from one of three points": _with(samples, q, p, points, seed),
            "position": cell.measure(np.concatenate([samples.q, q]), seed=seed),
        }
        assert samples.q is not None
        for name, some in measured.items():
            error_map = fit_cell(cell.cell, some, PREDICTOR, accept_campaign=True)
            yield Case(group, name, left(cell, error_map, targets))


def _positions(cell: VirtualCell, q: FloatArray, seed: int) -> FloatArray:
    """Return where the tool came to, with the robot's repeatability and without noise of the tracker, tracker frame."""
    exact = VirtualCell(cell.preset, seed=seed, effects=cell.effects - {"tracker"})
    return exact.measure(q, seed=seed + 500).p_meas


def _with(samples: Samples, q: FloatArray, p: FloatArray, points: FloatArray, seed: int) -> Samples:
    """Return samples with distances from points (k, 3) [mm] in turn, tracker frame."""
    origin = points[np.arange(len(q)) % len(points)]
    noise = np.random.default_rng([seed, 7]).normal(0.0, NOISE, len(q))
    distance = np.linalg.norm(p - origin, axis=1) + noise
    distances = Distances(q=q, distance=distance, distance_std=np.full(len(q), NOISE), p_origin=origin)
    return replace(samples, distances=distances)
