"""Registration of samples to the robot base frame, with station and tool as the cell file states (theory)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.error_map.arm_check import check_arm
from truepose.error_map.points import check_points, commanded_points, points_on_tool, reflectors_of
from truepose.errors import DataError, IdentifiabilityError, RobotError
from truepose.geometry import (
    Registration,
    ToolEstimate,
    apply_transform,
    estimate_tool,
    invert_transform,
    register,
    register_known,
    register_with_body,
    register_with_tool,
    tool_suspected,
)
from truepose.geometry.plausibility import write_hint
from truepose.geometry.station import TOOL_NAMES
from truepose.predictors.reflectors import distance_from_line, on_a_line
from truepose.robots import Robot
from truepose.samples import Poses, Samples, check_not_compensated, reflector_index

_ON_THE_LINE: Final = 1.0  # mm
_TOOL_OFF: Final = 5.0  # mm
_TOOL_STD: Final = 30.0  # mm, of a stated tool
_ANY_TOOL_STD: Final = 300.0  # mm, of the distance of a tool that is not stated from the flange
_DEGREES_OF_RADIANS: Final = np.deg2rad(2.0 * np.pi)  # a full turn in radians, read as degrees


def register_samples(cell: Cell, robot: Robot, samples: Samples) -> tuple[Registration, FloatArray, FloatArray]:
    """Register samples with a cell.

    Returns
    -------
    registration : Registration
        The registration; its residuals are the positional errors e = P_meas − P_cmd, base frame.
    tf_flange_tool : (4, 4) array [mm]
        The transform from flange to measured point.
    p_cmd : (n, 3) array [mm]
        The commanded positions of that point, base frame.

    Raises
    ------
    DataError
        If the tool is to be fitted and the samples lack joints or orientations; if joints and commanded poses disagree,
        as with a controller that compensates already or one that has another tool.
    IdentifiabilityError
        If the samples cannot separate the tool from the station.
    """
    check_samples(cell, robot, samples)
    return register_checked(cell, robot, samples)


def check_samples(cell: Cell, robot: Robot, samples: Samples) -> None:
    """Refuse samples whose joints are beyond their limits, or disagree with their commanded poses.

    Raises
    ------
    DataError, RobotError
        As `register_samples`.
    """
    if samples.q is None:
        return
    with _radians_hinted(samples):
        check_limits(robot, samples)
        check_not_compensated(samples, robot)
        check_points(samples, cell)
        if cell.tool.fit == "none":
            check_arm(robot, samples, cell.tf_flange_tool)


def register_checked(cell: Cell, robot: Robot, samples: Samples) -> tuple[Registration, FloatArray, FloatArray]:
    """Register samples, or some of those, that `check_samples` accepted; see `register_samples`."""
    with _radians_hinted(samples):
        registration, tf_flange_tool, p_cmd = _register(cell, robot, samples)
    return _with_names(registration, samples), tf_flange_tool, p_cmd


def _with_names(registration: Registration, samples: Samples) -> Registration:
    """Return a registration whose hint names points and lines instead of rows."""
    found = registration.outliers, registration.swapped
    by_row = write_hint(*found)
    if not by_row:
        return registration
    return replace(registration, hint=registration.hint.replace(by_row, write_hint(*found, samples.rows)))


def with_tool_hint(registration: Registration, parameters: Sequence[dict[str, Any]]) -> Registration:
    """Return a registration whose hint says how far errors of the arm moved the fitted tool, if by 5 mm or more.

    The tool is fitted at the nominal arm; a model that estimates the arm as well knows better, and how well.

    Parameters
    ----------
    registration : Registration
        A registration with a fitted tool.
    parameters : sequence of dict
        Rows of name, estimate and std [mm], among them those of the tool, as
        `truepose.predictors.KinematicKriging.parameters_`.
    """
    tool = [row for row in parameters if row["name"] in TOOL_NAMES]
    moved = float(np.linalg.norm([row["estimate"] for row in tool]))
    std = float(np.linalg.norm([row["std"] for row in tool]))
    if np.hypot(moved, std) < _TOOL_OFF:
        return registration
    told = (
        f"with the arm's own errors estimated too, the fitted tool is off by {moved:.0f} mm ± {std:.2g} mm: "
        'predictions include it; if the tool is known, state it, with [tool] fit = "none"'
    )
    return replace(registration, hint="; ".join(filter(None, (registration.hint, told))))


@contextmanager
def _radians_hinted(samples: Samples) -> Iterator[None]:
    """Add a hint to an error of the samples if their joints look like radians read as degrees."""
    try:
        yield
    except DataError as error:
        if samples.q is not None and np.abs(samples.q).max() < _DEGREES_OF_RADIANS:
            hint = "all joints lie within 6.3 degrees: are the columns q1_deg … in radians? Then name them q1_rad …"
            raise DataError(f"{error}; {hint}") from None
        raise


def tool_estimate(cell: Cell, robot: Robot, samples: Samples) -> ToolEstimate | None:
    """Return the tool that samples imply, and the stated one; None if it is fitted or cannot be found."""
    if samples.q is None or cell.tool.fit != "none" or samples.reflector is not None:
        return None
    return estimate_tool(robot.forward(samples.q), samples.p_meas, cell.tf_flange_tool[:3, 3])


@contextmanager
def wrong_tool_named(cell: Cell, robot: Robot, samples: Samples) -> Iterator[None]:
    """Name a probably wrong tool in front of an error of the samples."""

    def pairs() -> tuple[FloatArray, FloatArray] | None:
        if samples.q is None or cell.tool.fit != "none" or samples.reflector is not None:
            return None
        return robot.forward(samples.q), samples.p_meas

    with tool_suspected(pairs, cell.tf_flange_tool[:3, 3], samples.source):
        yield


def reading_noise(cell: Cell, samples: Samples, registration: Registration) -> FloatArray | None:
    """Return the standard deviation of readings in the base frame, (n, 3) [mm], or None if it is unknown.

    It is that of each sample where the table has it (x_std_mm …), otherwise that of the tracker in the cell file.
    """
    std = cell.tracker.reading_std(samples.p_meas) if samples.p_std is None else samples.p_std
    if std is None:
        return None
    return np.asarray(np.sqrt(std**2 @ (registration.tf_base_tracker[:3, :3] ** 2).T))


def check_limits(robot: Robot, poses: Poses) -> None:
    """Refuse joints beyond the robot's limits, by the rows' own names.

    Raises
    ------
    RobotError
        With row, joint, value and limits.
    """
    assert poses.q is not None
    robot.check_joints(poses.q)
    beyond = np.argwhere(~robot.within_limits(poses.q))
    if len(beyond):
        i, j = beyond[0]
        low, high = np.rad2deg(robot.limits[j])
        value = f"joint {j + 1} at {np.rad2deg(poses.q[i, j]):.3f} deg, limits {low:g} to {high:g}"
        rows = poses.rows(np.unique(beyond[:, 0]))
        raise RobotError(
            f"{poses.source}: {rows}: {robot.name} cannot reach this pose ({value}); check joint order, sign and unit"
        )


def _register(cell: Cell, robot: Robot, samples: Samples) -> tuple[Registration, FloatArray, FloatArray]:
    tf_flange_tool = cell.tf_flange_tool
    if samples.q is None:
        if cell.tool.fit != "none":
            raise DataError(
                f'{samples.source}: [tool] fit = "{cell.tool.fit}" needs joints (q1_deg …), or set fit = "none"'
            )
        assert samples.p_cmd is not None
        return _station(cell, samples.p_cmd, samples.p_meas), tf_flange_tool, samples.p_cmd
    tf_base_flange = robot.forward(samples.q)
    if cell.tool.fit == "none":
        p_cmd = commanded_points(robot, cell, samples, tf_flange_tool)
        with wrong_tool_named(cell, robot, samples):
            return _station(cell, p_cmd, samples.p_meas), tf_flange_tool, p_cmd
    if not cell.station_fitted:
        raise DataError('[tool] fit needs the station fitted with it: set [tracker] fit = "pose", or state the tool')
    if samples.reflector is not None:
        return _register_body(cell, robot, samples)
    registration = register_with_tool(
        tf_base_flange,
        samples.p_meas,
        tf_flange_tool[:3, 3],
        robust=cell.tracker.robust,
        tool_std=_TOOL_STD if {"x_mm", "y_mm", "z_mm"} & cell.tool.model_fields_set else _ANY_TOOL_STD,
    )
    assert registration.p_flange_tool is not None
    tf_flange_tool = tf_flange_tool.copy()
    tf_flange_tool[:3, 3] = registration.p_flange_tool
    if cell.tool.fit == "pose":
        tf_flange_tool[:3, :3] = _tool_rotation(tf_base_flange, registration, samples).as_matrix()
    return registration, tf_flange_tool, (tf_base_flange @ tf_flange_tool)[:, :3, 3]


def _register_body(cell: Cell, robot: Robot, samples: Samples) -> tuple[Registration, FloatArray, FloatArray]:
    """Register the readings of several reflectors, which move on the flange as one body with the tool."""
    reflectors = reflectors_of(cell)
    assert samples.q is not None
    assert reflectors is not None
    read = np.unique(reflector_index(samples, cell))
    off = distance_from_line(reflectors.p_tool[read])
    if off > _ON_THE_LINE and on_a_line(reflectors.p_tool[read]):
        raise IdentifiabilityError(
            f"{samples.source}: the reflectors are on one line and do not show the turn of the tool about it, but the "
            f"tool point is {off:.1f} mm off the line; measure a reflector beside the line, or state the tool with "
            '[tool] fit = "none"'
        )
    p_body = apply_transform(cell.tf_flange_tool, points_on_tool(samples, cell))
    registration, motion = register_with_body(
        robot.forward(samples.q),
        samples.p_meas,
        p_body,
        reflector_index(samples, cell),
        cell.tf_flange_tool[:3, 3],
        robust=cell.tracker.robust,
    )
    tf_flange_tool = motion @ cell.tf_flange_tool
    return registration, tf_flange_tool, commanded_points(robot, cell, samples, tf_flange_tool)


def _station(cell: Cell, p_cmd: FloatArray, p_meas: FloatArray) -> Registration:
    if cell.station_fitted:
        return register(p_cmd, p_meas, robust=cell.tracker.robust)
    return register_known(cell.tf_base_tracker, p_cmd, p_meas, robust=cell.tracker.robust)


def _tool_rotation(tf_base_flange: FloatArray, registration: Registration, samples: Samples) -> Rotation:
    """Return the mean of the measured tool orientations, in the flange frame."""
    if samples.rotation_meas is None:
        raise DataError(
            f'{samples.source}: [tool] fit = "pose" needs measured orientations (rx_meas_deg …); set fit = "position"'
        )
    rotation_base_tracker = Rotation.from_matrix(registration.tf_base_tracker[:3, :3])
    rotation_flange_base = Rotation.from_matrix(invert_transform(tf_base_flange)[:, :3, :3])
    return (rotation_flange_base * rotation_base_tracker * samples.rotation_meas)[~registration.outliers].mean()
