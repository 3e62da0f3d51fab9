"""Presets on other robots: work region, tool and payload scaled by reach, and a branch that reaches the region."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.geometry import euler, make_transform
from truepose.robots import Robot, load_robot, nearest_branch
from truepose.simulation.presets import Preset

_MASS_EXPONENT: Final = 2.7  # as in `truepose.robots.nongeometric.rough_masses`
_SHRINK: Final = 0.8
_NEARER: Final = (0.25, 0.0)  # exponents with which a smaller region moves towards the base
_SPREADS: Final = (1.0, 0.5)  # of the orientations, the second for wrists with little room
_TRIES: Final = 8


def adapt(preset: Preset, robot: Robot) -> Preset:
    """Return a preset adapted to another robot.

    Lengths scale with the length of the arm, the payload with its mass; the heights of presets count from the mounting
    face. Among the branches that reach the centre of the region, the one is chosen that reaches the corners at all
    orientations with the largest margin to the limits. A region that no branch reaches is made smaller and moved
    towards the base, or only made smaller; if that does not suffice, the orientations deviate half as much.

    Raises
    ------
    RobotError
        If no branch reaches even a small region.
    """
    scale = _length(robot) / _length(load_robot(preset.robot))
    lighter = scale**_MASS_EXPONENT
    centre, tool, load, size = (
        tuple((scale * np.array(value)).round(1).tolist())
        for value in (preset.centre_mm, preset.tool_mm, preset.payload_mm, preset.size_mm)
    )
    adapted = replace(
        preset,
        robot=robot.name,
        centre_mm=(centre[0], centre[1], centre[2] - (robot.world_height_mm or 0.0)),
        tool_mm=tool,
        payload_mm=load,
        payload_kg=round(preset.payload_kg * lighter, 1),
        work_payload_kg=None if preset.work_payload_kg is None else round(preset.work_payload_kg * lighter, 1),
        reflector_radius_mm=scale * preset.reflector_radius_mm,
    )
    for spread, nearer, smaller in product(_SPREADS, _NEARER, _SHRINK ** np.arange(_TRIES)):
        x, y, z = adapted.centre_mm
        tried = replace(
            adapted,
            size_mm=tuple((smaller * np.array(size)).round(1).tolist()),
            centre_mm=(round(x * smaller**nearer, 1), y, z),
            orientation_deg=spread * adapted.orientation_deg,
        )
        if (home := _home(tried, robot)) is not None:
            return replace(tried, home_deg=tuple(np.rad2deg(home).tolist()))
    raise RobotError(f"{robot.name}: no branch reaches a work region at {centre} mm; pass a Preset made for this robot")


def _length(robot: Robot) -> float:
    return float(np.linalg.norm(robot.fixed[1:, :3, 3], axis=1).sum())


def _home(preset: Preset, robot: Robot) -> FloatArray | None:
    """Return the joints at the centre of the region on a branch that reaches all of it; None if there is none."""
    sides = np.stack(np.meshgrid(*[[-0.5, 0.0, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    turns = np.deg2rad(preset.orientation_deg) * 2.0 * sides if preset.orientation_deg else np.zeros((1, 3))
    rotation = euler("kuka", preset.abc_deg)
    tilted = Rotation.concatenate([rotation * Rotation.from_rotvec(turn) for turn in turns])
    p = np.asarray(preset.centre_mm) + np.repeat(sides, len(turns), axis=0) * preset.size_mm
    poses = make_transform(Rotation.from_quat(np.tile(tilted.as_quat(), (len(sides), 1))), p)
    tool = make_transform(euler("kuka", preset.tool_abc_deg), preset.tool_mm)
    branches = robot.inverse(poses, tool=tool)
    best, room = None, 0.0
    for home in robot.inverse(make_transform(rotation, np.array([preset.centre_mm])), tool=tool)[0]:
        if np.isnan(home).any():
            continue
        q = nearest_branch(branches, home)
        margin = float(np.nan_to_num(np.minimum(q - robot.limits[:, 0], robot.limits[:, 1] - q), nan=-1.0).min())
        if margin > room:
            best, room = home, margin
    return best
