"""Accuracy under conditions that change and with ripple of gears: backlash, temperature, station, payload, motors."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.held_out import Page
from truepose import ErrorMap, Samples, VirtualCell, fit_cell
from truepose.cell import Cell
from truepose.geometry import apply_transform, invert_transform
from truepose.robots import load_robot
from truepose.robots.io.toml import to_toml
from truepose.samples import Poses
from truepose.simulation import PRESETS

FloatArray = NDArray[np.float64]
PAGE = "conditions"
PREDICTOR = "kinematic-kriging"
WITHOUT = f"{PREDICTOR}:conditions=none"
CONSTANT = f"{PREDICTOR}:backlash_shape=no"
SAMPLES, TARGETS = 100, 200
GEAR_SAMPLES = 150
WAVE = (0.3, 0.6)  # of the mean lost motion
PAYLOADS, THIRD, OTHER = (20.0, 120.0), 70.0, 30.0  # kg


class Left(NamedTuple):
    """What a map leaves: mean error [mm], mean length of the deviation [mm], share of components inside 95 %."""

    mean: float
    std: float
    inside: float


class Case(NamedTuple):
    """One row of the table for one robot."""

    group: str
    name: str
    left: Left


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    seeds = range(2 if quick else 20)
    page = Page("Accuracy under conditions that change", path)
    page.say(
        f"Virtual robots of 210 kg (preset hard with one more effect, see docs/virtual-cell.md), {SAMPLES} samples, "
        f"{TARGETS} other poses; means over {len(seeds)} robots (seeds 0 …). Errors are those of the prediction "
        "against the truth without noise. The floor of a group is the same robot with the same noise, without "
        "the effect or at the condition of work; the ratio is that of the means, robot by robot: mean and largest. "
        "`conditions=none` switches the terms off."
    )
    page.head(["effect", "conditions", "mean [mm]", "std [mm]", "in 95 %", "ratio", "worst ratio"])
    found = [case for seed in seeds for case in cases(seed)]
    for group, name in dict.fromkeys((case.group, case.name) for case in found):
        rows = [case.left for case in found if (case.group, case.name) == (group, name)]
        floor = [case.left.mean for case in found if (case.group, case.name) == (group, "floor")]
        ratio = np.array([row.mean for row in rows]) / floor
        page.row(
            group,
            name,
            f"{np.mean([row.mean for row in rows]):.4f}",
            f"{np.mean([row.std for row in rows]):.4f}",
            f"{100 * np.mean([row.inside for row in rows]):.0f} %",
            f"{ratio.mean():.2f}",
            f"{ratio.max():.2f}",
        )


def cases(seed: int) -> Iterator[Case]:
    """Return the rows of one robot."""
    yield from _backlash(seed)
    yield from _uneven(seed)
    yield from _cold_start(seed)
    yield from _creep(seed)
    yield from _payload(seed)
    yield from _ripple(seed)


def _backlash(seed: int) -> Iterator[Case]:
    cell = VirtualCell("backlash", seed=seed)
    q = cell.design(TARGETS, seed=seed + 999)
    signs = np.sign(np.diff(q, axis=0, prepend=[np.deg2rad(cell.preset.home_deg)]))
    samples, poses = _measured(cell, seed), Poses(q=q, approach=signs)
    by_order = _stating(cell.cell, approach="from-order")
    rows = {
        "approach stated": fit_cell(cell.cell, samples, PREDICTOR),
        "approach from the order of rows": fit_cell(by_order, replace(samples, approach=None), PREDICTOR),
        "approach stated, backlash_shape=no": fit_cell(cell.cell, samples, CONSTANT),
        "conditions=none": fit_cell(cell.cell, samples, WITHOUT),
    }
    for name, error_map in rows.items():
        yield Case("backlash", name, left(cell, error_map, poses, approach=signs))
    unknown = left(cell, rows["approach stated"], Poses(q=q), approach=signs)
    yield Case("backlash", "approach of the targets unknown", unknown)
    plain = VirtualCell("backlash", seed=seed, effects=cell.effects - {"backlash"})
    yield Case("backlash", "floor", left(plain, fit_cell(plain.cell, _measured(plain, seed), PREDICTOR), Poses(q=q)))


def _uneven(seed: int) -> Iterator[Case]:
    """Yield the rows of an arm whose lost motion varies with the angle of each joint."""
    group = f"backlash that varies with the angle by 30–60 %, {GEAR_SAMPLES} samples"
    cell = VirtualCell(replace(PRESETS["backlash"], backlash_wave=WAVE), seed=seed)
    plain = VirtualCell("backlash", seed=seed, effects=cell.effects - {"backlash"})
    q = cell.design(TARGETS, seed=seed + 999)
    signs = np.sign(np.diff(q, axis=0, prepend=[np.deg2rad(cell.preset.home_deg)]))
    poses = Poses(q=q, approach=signs)
    for one, name, predictor in (
        (cell, "approach stated", PREDICTOR),
        (cell, "backlash_shape=no", CONSTANT),
        (plain, "floor", PREDICTOR),
    ):
        samples = one.measure(one.design(GEAR_SAMPLES, seed=seed), seed=seed)
        yield Case(group, name, left(one, fit_cell(one.cell, samples, predictor), poses, approach=signs))


def _cold_start(seed: int) -> Iterator[Case]:
    cell = VirtualCell("cold-start", seed=seed)
    q, samples = cell.design(TARGETS, seed=seed + 999), _measured(cell, seed)
    warm = np.full(len(q), cell.preset.work_s)
    at_work = cell.measure(q, seed=seed, time=warm).temperature
    error_map = fit_cell(cell.cell, samples, PREDICTOR)
    untold = fit_cell(cell.cell, replace(samples, temperature=None), PREDICTOR)
    rows = {
        "temperature of samples and targets": (error_map, Poses(q=q, temperature=at_work)),
        "temperature of samples": (error_map, Poses(q=q)),
        "no temperature": (untold, Poses(q=q)),
    }
    for name, (one, poses) in rows.items():
        yield Case("cold start", name, left(cell, one, poses, time=warm))
    yield Case("cold start", "floor", _plain(seed, q))


def _creep(seed: int) -> Iterator[Case]:
    cell = VirtualCell("creep", seed=seed)
    q, samples = cell.design(TARGETS, seed=seed + 999), _measured(cell, seed)
    for name, predictor in (("times", PREDICTOR), ("conditions=none", WITHOUT)):
        error_map = fit_cell(cell.cell, samples, predictor, accept_campaign=predictor == WITHOUT)
        yield Case("station creeps 0.1–0.5 mm", name, left(cell, error_map, Poses(q=q)))
    yield Case("station creeps 0.1–0.5 mm", "floor", _plain(seed, q))


def _payload(seed: int) -> Iterator[Case]:
    cell = VirtualCell("hard", seed=seed)
    measured = cell.design(SAMPLES, seed=seed)
    two = cell.measure(measured, seed=seed, payload_kg=np.where(np.arange(SAMPLES) % 2, *PAYLOADS))
    q = cell.design(TARGETS, seed=seed + 999)
    third = Poses(q=q, load=np.full(len(q), THIRD))
    group = "payloads of 20 and 120 kg, used with 70"
    yield Case(group, "payload", left(cell, fit_cell(cell.cell, two, PREDICTOR), third, payload_kg=THIRD))
    yield Case(group, "conditions=none", left(cell, fit_cell(cell.cell, two, WITHOUT), third, payload_kg=THIRD))
    own = cell.measure(measured, seed=seed, payload_kg=THIRD)
    at_third = fit_cell(_stating(cell.cell, payload_kg=THIRD), own, PREDICTOR)
    yield Case(group, "floor", left(cell, at_third, Poses(q=q), payload_kg=THIRD))
    group, samples = "payload of 120 kg, used with 30", _measured(cell, seed)
    for name, predictor in (("payload at work stated", PREDICTOR), ("conditions=none, stated", WITHOUT)):
        error_map = fit_cell(_stating(cell.cell, payload_kg=OTHER), samples, predictor)
        yield Case(group, name, left(cell, error_map, Poses(q=q), payload_kg=OTHER))
    own = cell.measure(measured, seed=seed, payload_kg=OTHER)
    at_other = fit_cell(_stating(cell.cell, payload_kg=OTHER), own, PREDICTOR)
    yield Case(group, "floor", left(cell, at_other, Poses(q=q), payload_kg=OTHER))


def _ripple(seed: int) -> Iterator[Case]:
    """Yield the rows of an arm whose file states the gear ratios, one of them for the term without ripple."""
    group, without = f"ripple of 20–50 µrad, {GEAR_SAMPLES} samples", f"{PREDICTOR}:gear_harmonics=no"
    arm = load_robot(VirtualCell("ripple").preset.robot)
    ratio = np.random.default_rng(seed).uniform(80.0, 250.0, arm.dof).round(1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.toml"
        path.write_text(to_toml(replace(arm, gear_ratio=ratio)), "utf-8")
        cell = VirtualCell("ripple", robot=path, seed=seed)
        plain = VirtualCell("ripple", robot=path, seed=seed, effects=cell.effects - {"ripple"})
        q = cell.design(TARGETS, seed=seed + 999)
        for one, name, predictor in (
            (cell, "gear ratios stated", PREDICTOR),
            (cell, "gear_harmonics=no", without),
            (plain, "gear ratios stated, no ripple", PREDICTOR),
            (plain, "floor", without),
        ):
            samples = one.measure(one.design(GEAR_SAMPLES, seed=seed), seed=seed)
            yield Case(group, name, left(one, fit_cell(one.cell, samples, predictor), Poses(q=q)))


def left(cell: VirtualCell, error_map: ErrorMap, poses: Poses, **conditions: Any) -> Left:
    """Compare the predictions of a map with the truth, seen through the registration of the map."""
    assert poses.q is not None
    tf_tracker_base = invert_transform(cell.truth.tf_base_tracker)
    p = error_map.registration.apply(apply_transform(tf_tracker_base, cell.true_position(poses.q, **conditions)))
    predicted, std = error_map.predict_errors(poses)
    miss = predicted - (p - cell.robot.forward(poses.q, tool=error_map.tf_flange_tool)[:, :3, 3])
    return Left(
        float(np.linalg.norm(miss, axis=1).mean()),
        float(np.linalg.norm(std, axis=1).mean()),
        float(np.mean(np.abs(miss) <= 1.96 * std)),
    )


def _measured(cell: VirtualCell, seed: int) -> Samples:
    return cell.measure(cell.design(SAMPLES, seed=seed), seed=seed)


def _plain(seed: int, q: FloatArray) -> Left:
    cell = VirtualCell("hard", seed=seed)
    return left(cell, fit_cell(cell.cell, _measured(cell, seed), PREDICTOR), Poses(q=q))


def _stating(cell: Cell, **conditions: Any) -> Cell:
    """Return a cell with other ``[conditions]``."""
    return cell.model_copy(update={"conditions": cell.conditions.model_copy(update=conditions)})
