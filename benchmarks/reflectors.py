"""Accuracy with three reflectors at a pose, on virtual cells: what they replace, and what they do not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from sklearn.base import clone

from benchmarks.conditions import PREDICTOR, TARGETS, WITHOUT, Case, Left, left
from benchmarks.held_out import Page
from truepose import Cell, ErrorMap, VirtualCell, fit_cell
from truepose._typing import FloatArray
from truepose.geometry import invert_transform
from truepose.samples import Poses, Samples

PAGE = "reflectors"
POSES, REFLECTORS, TURN, MANY = 40, 3, 15.0, 400
GROUPS = (
    ("geometry alone, motion repeats exactly", "paper", {"repeatability"}),
    ("geometry alone", "paper", set()),
    ("joint errors, compliance, motion repeats exactly", "hard", {"repeatability"}),
    ("joint errors, compliance", "hard", set()),
)


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    seeds = range(2 if quick else 20)
    page = Page("Three reflectors at a pose", path)
    page.say(
        f"Virtual robots of 210 kg (presets paper and hard, see docs/virtual-cell.md) whose poses are turned by up to "
        f"{TURN:g}° about each axis, {TARGETS} other poses; means over {len(seeds)} robots (seeds 0 …). Errors are "
        "those of the prediction at the tool point against the truth without noise. Three reflectors are on a circle "
        "of 120 mm "
        f"about the tool point, where none is. The ratio is to one reflector at {REFLECTORS * POSES} poses, robot by "
        "robot: of the means, and the largest. A motion that repeats exactly leaves the noise of the tracker alone."
    )
    page.head(["errors of the robot", "samples", "mean [mm]", "std [mm]", "in 95 %", "ratio of means", "worst ratio"])
    found = [case for seed in seeds for case in cases(seed)]
    for group, name in dict.fromkeys((case.group, case.name) for case in found):
        rows = [case.left for case in found if (case.group, case.name) == (group, name)]
        floor = np.array([one.left.mean for one in found if (one.group, one.name) == (group, _floor())])
        means = np.array([row.mean for row in rows])
        page.row(
            group,
            name,
            f"{means.mean():.4f}",
            f"{np.mean([row.std for row in rows]):.4f}",
            f"{100 * np.mean([row.inside for row in rows]):.0f} %",
            f"{means.mean() / floor.mean():.2f}",
            f"{(means / floor).max():.2f}",
        )
    page.say(
        f"The same with hyperparameters that one reflector at {MANY} poses has shown, so that neither fit has to find "
        "them: what is left is what the readings say of the robot. Conditions of the poses are left out."
    )
    page.head(
        [
            "errors of the robot",
            f"3 reflectors, {POSES} poses [mm]",
            f"1 reflector, {REFLECTORS * POSES} poses [mm]",
            "ratio",
        ]
    )
    for group, preset, without in GROUPS:
        means = np.array([known(preset, without, seed) for seed in seeds]).mean(axis=0)
        page.row(group, *(f"{mean:.4f}" for mean in means), f"{means[0] / means[1]:.2f}")
    page.say(
        "Orientations measured with the three reflectors, as poses with their noise, and used or not "
        "(`conditions=none`). The turn is the mean length of the error of the predicted orientation."
    )
    page.head(["errors of the robot", "samples", "mean [mm]", "in 95 %", "turn [mrad]", "turns in 95 %"])
    turns = [case for seed in seeds for case in oriented(seed)]
    for group, name in dict.fromkeys((case.group, case.name) for case in turns):
        some = [case for case in turns if (case.group, case.name) == (group, name)]
        page.row(
            group,
            name,
            f"{np.mean([case.left.mean for case in some]):.4f}",
            f"{100 * np.mean([case.left.inside for case in some]):.0f} %",
            f"{np.mean([case.turn for case in some]):.3f}",
            f"{100 * np.mean([case.turns_inside for case in some]):.0f} %",
        )
    page.say(
        f"Three reflectors at {POSES} poses are as good as one at {REFLECTORS * POSES} where both know the same of the "
        "robot: its geometry, seen through the noise of the tracker. They are not where more poses know more. The "
        "three share one motion, so repeatability is averaged over a third of the motions. They share one angle of "
        "each joint, so an error that depends on this angle is seen at a third of the angles, and gravity in a third "
        "of the postures. Known hyperparameters hardly change the ratios, so no better fit would."
    )


def cases(seed: int) -> Iterator[Case]:
    """Return the rows of one robot."""
    for group, preset, without in GROUPS:
        cell = VirtualCell(preset, seed=seed)
        cell = VirtualCell(preset, seed=seed, effects=cell.effects - without)
        targets = Poses(q=cell.design(TARGETS, seed=seed + 999, orientation_deg=TURN))
        q = cell.design(POSES, seed=seed, orientation_deg=TURN)
        several = cell.measure_each(q, REFLECTORS, seed=seed)
        error_map = fit_cell(cell.cell_with(REFLECTORS), several, PREDICTOR, accept_campaign=True)
        yield Case(group, f"{REFLECTORS} reflectors, {POSES} poses", left(cell, error_map, targets))
        for count in (POSES, REFLECTORS * POSES):
            alone = cell.measure(cell.design(count, seed=seed, orientation_deg=TURN), seed=seed)
            error_map = fit_cell(cell.cell, alone, PREDICTOR, accept_campaign=True)
            yield Case(group, f"1 reflector, {count} poses", left(cell, error_map, targets))


def known(preset: str, without: set[str], seed: int) -> tuple[float, float]:
    """Return the errors [mm] of three reflectors and of one at thrice the poses, with known hyperparameters."""
    cell = VirtualCell(preset, seed=seed)
    cell = VirtualCell(preset, seed=seed, effects=cell.effects - without)
    targets = Poses(q=cell.design(TARGETS, seed=seed + 999, orientation_deg=TURN))

    def fitted(stated: Cell, samples: Samples) -> ErrorMap:
        return fit_cell(stated, samples, WITHOUT, accept_campaign=True)

    def design(n: int, own: int = seed) -> FloatArray:
        return cell.design(n, seed=own, orientation_deg=TURN)

    model = fitted(cell.cell, cell.measure(design(MANY, seed + 500), seed=seed + 500)).predictor
    several = fitted(cell.cell_with(REFLECTORS), cell.measure_each(design(POSES), REFLECTORS, seed=seed))
    alone = fitted(cell.cell, cell.measure(design(REFLECTORS * POSES), seed=seed))
    found = []
    for one in (several, alone):
        told = clone(one.predictor).set_params(hyper=model.hyper_.to_dict(), joints=model.joints_.tolist())
        told.fit(one.fitted_inputs, one.e, one.predictor.noise_std_)
        found.append(left(cell, one.changed(predictor=told), targets).mean)
    return found[0], found[1]


class Oriented(NamedTuple):
    """One row of the table of orientations for one robot."""

    group: str
    name: str
    left: Left
    turn: float
    turns_inside: float


def oriented(seed: int) -> Iterator[Oriented]:
    """Return the rows of one robot whose orientations were measured."""
    for group, preset, without in GROUPS[1::2]:
        cell = VirtualCell(preset, seed=seed)
        cell = VirtualCell(preset, seed=seed, effects=cell.effects - without)
        targets = Poses(q=cell.design(TARGETS, seed=seed + 999, orientation_deg=TURN))
        samples = cell.measure(cell.design(POSES, seed=seed, orientation_deg=TURN), seed=seed, reflectors=REFLECTORS)
        for name, predictor in (("orientations used", PREDICTOR), ("not used", WITHOUT)):
            error_map = fit_cell(cell.cell, samples, predictor, accept_campaign=True)
            yield Oriented(group, name, left(cell, error_map, targets), *_turns(cell, error_map, targets))


def _turns(cell: VirtualCell, error_map: ErrorMap, poses: Poses) -> tuple[float, float]:
    """Return the mean error of predicted orientations [mrad], and the share of components inside 95 %."""
    assert poses.q is not None
    seen = error_map.registration.tf_base_tracker @ invert_transform(cell.truth.tf_base_tracker)
    true = Rotation.from_matrix((seen @ cell.true_poses(poses.q))[:, :3, :3])
    nominal = Rotation.from_matrix(cell.robot.forward(poses.q, tool=error_map.tf_flange_tool)[:, :3, :3])
    predicted, std = (one[:, 3:] for one in error_map.predict_pose_errors(poses))
    miss = predicted - (true * nominal.inv()).as_rotvec()
    return 1e3 * float(np.linalg.norm(miss, axis=1).mean()), float(np.mean(np.abs(miss) <= 1.96 * std))


def _floor() -> str:
    return f"1 reflector, {REFLECTORS * POSES} poses"
