"""What becomes of targets where a statement is wrong, or the work has conditions that no sample had.

Each fault is made on virtual cells whose samples are otherwise right; the truth is that of `benchmarks.trust_cells`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.trust_cells import SAMPLES, TARGETS, Fate, FloatArray, is_used
from truepose import Cell, ErrorMap, Samples, VirtualCell, fit_cell
from truepose.errors import TrueposeError
from truepose.geometry import apply_transform, invert_transform, make_transform
from truepose.programs.agreement import check_identity
from truepose.robots import nearest_branch
from truepose.samples import Poses

PREDICTORS: Final = ("ordinary-kriging", "calibration", "kinematic-kriging")
_WORK: Final = 10_000  # added to a cell's seed: that of the work program's design, and that of another robot
_HALF_TURN: Final = make_transform(Rotation.from_euler("z", 180, degrees=True), np.zeros(3))
_OFF_MM: Final = 12.7  # half an inch: a reflector in the nest of another size
_APART_MM: Final = 0.5
_SLIP: Final = 10.0


@dataclass(frozen=True)
class Campaign:
    """What is fitted and then used.

    Attributes
    ----------
    cell : Cell
        The cell that the user states.
    samples : Samples
        The samples.
    at_work : callable
        Returns the true positions (n, 3) [mm] of the tool at work, base frame, at joints (n, dof) [rad].
    used_with : Cell
        The cell whose programs are corrected.
    tf_shown : (4, 4) array [mm]
        The virtual cell's base in the base in which its controller shows and programs positions.
    sides : bool
        Whether the program shows from which side each joint comes, as straight motions do.
    """

    cell: Cell
    samples: Samples
    at_work: Callable[[FloatArray], FloatArray]
    used_with: Cell
    tf_shown: FloatArray
    sides: bool = False


def _plain(virtual: VirtualCell, samples: Samples, **changes: object) -> Campaign:
    made = Campaign(virtual.cell, samples, virtual.at_work, virtual.cell, np.eye(4))
    return replace(made, **changes)  # type: ignore[arg-type]


def _measured(virtual: VirtualCell, **conditions: object) -> Samples:
    seed = virtual.seed
    return virtual.measure(virtual.design(SAMPLES, seed=seed), seed=seed, **conditions)  # type: ignore[arg-type]


def _with_robot(cell: Cell, **stated: object) -> Cell:
    return cell.model_copy(update={"robot": cell.robot.model_copy(update=stated)})


def _in_flange(virtual: VirtualCell, samples: Samples, offset: FloatArray) -> Samples:
    """Return samples whose reflector sat elsewhere, by offsets (n, 3) [mm] in the frame of the tool."""
    assert samples.q is not None
    tf = virtual.robot.forward(samples.q, tool=virtual.tf_flange_tool)
    moved = np.einsum("nij,nj->ni", tf[:, :3, :3], offset)
    turn = invert_transform(virtual.truth.tf_base_tracker)[:3, :3]
    return replace(samples, p_meas=samples.p_meas + moved @ turn.T)


def _wrong_serial(virtual: VirtualCell) -> Campaign:
    other = VirtualCell(virtual.preset, seed=virtual.seed + _WORK)
    own, theirs = (_with_robot(virtual.cell, id=name) for name in ("first", "second"))
    return _plain(virtual, _measured(virtual), cell=own, used_with=theirs, at_work=_seen_by(virtual, other))


def _seen_by(virtual: VirtualCell, other: VirtualCell) -> Callable[[FloatArray], FloatArray]:
    """Return the positions of another robot, relative to its own station."""

    def positions(q: FloatArray) -> FloatArray:
        p_tracker = apply_transform(invert_transform(other.truth.tf_base_tracker), other.at_work(q))
        return apply_transform(virtual.truth.tf_base_tracker, p_tracker)

    return positions


def _turned_base(virtual: VirtualCell) -> Campaign:
    samples = _measured(virtual)
    assert samples.p_cmd is not None
    shown = np.round(apply_transform(_HALF_TURN, samples.p_cmd), 3)
    return _plain(virtual, replace(samples, p_cmd=shown, rotation_cmd=None), tf_shown=_HALF_TURN)


def _repeatability_slip(virtual: VirtualCell) -> Campaign:
    stated = virtual.cell.robot.repeatability_mm or virtual.noise_floor
    return _plain(virtual, _measured(virtual), cell=_with_robot(virtual.cell, repeatability_mm=_SLIP * stated))


def _one_sided(virtual: VirtualCell) -> Campaign:
    return _plain(
        virtual,
        _measured(virtual, approach=1.0),
        at_work=lambda q: virtual.true_position(q, approach=_sides(virtual, q)),
        sides=True,
    )


def _sides(virtual: VirtualCell, q: FloatArray) -> FloatArray:
    """Return the same random sides for a program's targets, wherever they were moved to."""
    return np.random.default_rng(virtual.seed).choice([-1.0, 1.0], q.shape)


def _payload_not_told(virtual: VirtualCell) -> Campaign:
    full = virtual.preset.payload_kg
    payload = np.random.default_rng(virtual.seed).choice([0.0, 0.5 * full, full], SAMPLES)
    return _plain(
        virtual,
        _measured(virtual, payload_kg=payload),
        at_work=lambda q: virtual.true_position(q, payload_kg=full),
    )


def _reflector_off(virtual: VirtualCell) -> Campaign:
    samples = _measured(virtual)
    return _plain(virtual, _in_flange(virtual, samples, np.tile([0.0, 0.0, _OFF_MM], (len(samples), 1))))


def _alternating_reflectors(virtual: VirtualCell) -> Campaign:
    samples = _measured(virtual)
    offset = np.zeros((len(samples), 3))
    offset[1::2, 0] = _APART_MM
    return _plain(virtual, _in_flange(virtual, samples, offset))


def _flipped_approach(virtual: VirtualCell) -> Campaign:
    samples = _measured(virtual, approach="order")
    assert samples.approach is not None
    return _plain(virtual, replace(samples, approach=-samples.approach))


FAULTS: Final = {
    "wrong serial": ("hard", _wrong_serial),
    "turned base": ("hard", _turned_base),
    "repeatability slip": ("hard", _repeatability_slip),
    "one-sided samples": ("backlash", _one_sided),
    "payload not told": ("hard", _payload_not_told),
    "reflector off": ("hard", _reflector_off),
    "alternating reflectors": ("hard", _alternating_reflectors),
    "flipped approach": ("backlash", _flipped_approach),
}
"""The preset of each fault, and what makes its campaign."""


def fates_of_fault(fault: str, seed: int, *, predictors: tuple[str, ...] = PREDICTORS) -> list[Fate]:
    """Make one campaign with a fault, fit predictors, correct a work program, and look at the truth."""
    preset, made = FAULTS[fault]
    virtual = VirtualCell(preset, seed=seed)
    campaign = made(virtual)
    q = virtual.design(TARGETS, seed=seed + _WORK)
    found = []
    for name in predictors:
        try:
            error_map = fit_cell(campaign.cell, campaign.samples, name)
            check_identity(campaign.cell, campaign.used_with)
            found.append(_fate(fault, virtual, campaign, error_map, q))
        except TrueposeError as error:
            found.append(Fate(fault, seed, name, refused=str(error)))
    return found


def _fate(fault: str, virtual: VirtualCell, campaign: Campaign, error_map: ErrorMap, q: FloatArray) -> Fate:
    tool = virtual.tf_flange_tool
    targets = virtual.robot.forward(q, tool=tool)
    if campaign.sides:
        corrections = error_map.correct(Poses(q=q, approach=_sides(virtual, q)), on_guard="skip")
    else:
        corrections = error_map.correct(campaign.tf_shown @ targets, tf_flange_tool=tool, on_guard="skip")
    commands = targets.copy()
    commands[:, :3, 3] = apply_transform(invert_transform(campaign.tf_shown), corrections.p_command)
    q_command = nearest_branch(virtual.robot.inverse(commands, tool=tool), q)

    def miss(q: FloatArray) -> FloatArray:
        p_tracker = apply_transform(invert_transform(virtual.truth.tf_base_tracker), campaign.at_work(q))
        p_target = apply_transform(campaign.tf_shown, targets[:, :3, 3])
        return np.asarray(error_map.registration.apply(p_tracker) - p_target)

    q_reached = np.where(is_used(corrections)[:, None], q_command, q)
    margin = 2.0 * virtual.noise_floor
    return Fate.of(fault, virtual.seed, error_map, corrections, miss(q), miss(q_reached), margin)
