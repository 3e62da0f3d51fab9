"""Plausibility checks of a table against a robot and a tracker; every message names the rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import IdentifiabilityError, TrueposeError
from truepose.samples.conditions import check_conditions
from truepose.samples.distances import check_distances
from truepose.samples.reflectors import check_reflector_rows
from truepose.samples.shown import read_as_shown
from truepose.samples.table import Poses, Samples

if TYPE_CHECKING:
    from truepose.robots import Robot


_METRES_SPREAD: Final = (0.2, 10.0)  # a work region in metres
_METRES_NORM: Final = 60.0  # in mm, no tracker or robot measures this close to its origin
_MOST_RAD: Final = 13.0  # two turns: no revolute joint goes further
_REPEAT_MM: Final = 2.0  # repeats of one pose lie within a tenth of this, even on a poor robot
_SAME: Final = 1e-6
_UNIT_FACTORS: Final = {1000.0: "metres", 25.4: "inches", 10.0: "centimetres"}
_DEG: Final = np.pi / 180.0
_ROUNDING_MM: Final = 0.3  # median: 0.01 deg in the joints of a large arm, or a UR10's servo errors, leave 0.1
_FEWEST: Final = 8  # rows for a comparison of joints with commanded positions
_TURN_TOLERANCE: Final = np.deg2rad(1.0)
_FEWEST_TURNS: Final = 4  # samples for a comparison of turns
_READ_ORDER: Final = "xyz"
_OTHER_ORDERS: Final = ("ZYX", "XYZ", "zyx")
_REMEDIES: Final = (
    (_DEG, 1.0, "the joints are degrees; name the columns q1_deg …"),
    (1 / _DEG, 1.0, "the joints are radians; name the columns q1_rad …"),
    (1.0, 1e3, "the commanded positions are metres; name the columns x_cmd_m …"),
    (1 / _DEG, 1e3, "the joints are radians and the positions metres; name the columns q1_rad …, x_cmd_m …"),
)


def check(poses: Poses) -> None:
    """Raise if the values of a table are implausible; called by the readers.

    The check finds: no rows, all-zero readings, metres or inches in mm columns, degrees in rad columns, constant
    readings, contradicting readings of one configuration, and conditions that cannot be (`check_conditions`).

    Raises
    ------
    DataError
        With the rows and a remedy.
    """
    if not len(poses):
        raise poses.error("has no rows; at least one pose is required")
    _check_commands(poses)
    check_reflector_rows(poses)
    if isinstance(poses, Samples):
        _check_readings(poses)
        _check_scale(poses)
        _check_repeats(poses)
        if poses.distances is not None:
            check_distances(poses.distances)
            check(poses.distances)


def _check_commands(poses: Poses) -> None:
    for q, column in ((poses.q, "q1_deg"), (poses.q_shown, "q1_shown_deg")):
        if q is not None and (worst := np.abs(q).max()) > _MOST_RAD:
            raise poses.error(
                f"joints up to {worst:.4g} rad; are they degrees? Name the columns {column} …",
                np.abs(q).max(axis=1) > _MOST_RAD,
            )
    if poses.p_cmd is not None:
        _refuse_metres(poses, poses.p_cmd, "commanded", "x_cmd_m …")
    check_conditions(poses)


def _check_readings(samples: Samples) -> None:
    zero = (samples.p_meas == 0.0).all(axis=1)
    if zero.any():
        raise samples.error("all-zero reading: no measurement; measure again or remove the row", zero)
    if _moves(samples):
        _refuse_metres(samples, samples.p_meas, "measured", "x_meas_m …")


def _refuse_metres(poses: Poses, p: FloatArray, what: str, column: str) -> None:
    if looks_like_metres(p):
        spread = np.linalg.norm(np.ptp(p, axis=0))
        remedy = f"are they metres? Name the columns {column}"
        raise poses.error(f"the {what} positions spread over {spread:.2f} mm; {remedy}")


def looks_like_metres(p: FloatArray) -> bool:
    """Return whether positions (n, 3) in mm are rather a work region in metres: 0.2–10 wide, near the origin."""
    spread = float(np.linalg.norm(np.ptp(p, axis=0))) if len(p) else 0.0
    return _METRES_SPREAD[0] <= spread <= _METRES_SPREAD[1] and bool(np.abs(p).max() < _METRES_NORM)


def _moves(poses: Poses) -> bool:
    return any(bool((np.ptp(x, axis=0) > _SAME).any()) for x in (poses.given_joints, poses.p_cmd) if x is not None)


def _radius(p: FloatArray) -> float:
    """Return the RMS distance from the centroid: rigid motions do not change it."""
    return float(np.sqrt(((p - p.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _check_scale(samples: Samples) -> None:
    if samples.p_cmd is None or (commanded := _radius(samples.p_cmd)) < 1.0:
        return
    ratio = _radius(samples.p_meas) / commanded
    if ratio < _SAME:
        raise samples.error("all measured positions are equal, but the commanded ones are not; was one reading copied?")
    for factor, unit in _UNIT_FACTORS.items():
        for of, value in (("measured", ratio), ("commanded", 1.0 / ratio)):
            if abs(value * factor - 1.0) < 0.2:
                message = f"the {of} positions spread {factor:g} times less than the others: they are {unit}, not mm"
                raise samples.error(f"{message}; correct the unit in the column names")


def _check_repeats(samples: Samples) -> None:
    """Refuse readings of one configuration (with its load and approach) that are too far apart for any robot."""
    rotation = None if samples.rotation_cmd is None else samples.rotation_cmd.as_matrix().reshape(len(samples), 9)
    joints = samples.given_joints
    configuration = (joints,) if joints is not None else (samples.p_cmd, rotation)
    words = samples.reflector
    which = None if words is None else np.unique(words, return_inverse=True)[1].reshape(-1) * 1.0
    keys = [x for x in (*configuration, samples.approach, samples.load, which) if x is not None]
    key = np.round(np.column_stack(keys) / _SAME).astype(np.int64)
    _, group, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    if count.max() == 1:
        return
    low, high = np.full((len(count), 3), np.inf), np.full((len(count), 3), -np.inf)
    np.minimum.at(low, group, samples.p_meas)
    np.maximum.at(high, group, samples.p_meas)
    spread = np.linalg.norm(high - low, axis=1)
    worst = int(spread.argmax())
    if spread[worst] > _REPEAT_MM:
        message = f"readings of one configuration are {spread[worst]:.3g} mm apart, expected at most {_REPEAT_MM:g} mm"
        remedy = "measure again, or separate the series if the tracker was moved"
        raise samples.error(f"{message}; {remedy}", group == worst)


def check_against(poses: Poses, robot: Robot, *, tolerance_mm: float = 5.0) -> FloatArray:
    """Compare the commanded positions with the joints through the robot's nominal model.

    The frame of the commanded positions and the tool are fitted (a rigid motion and an offset from the flange), so they
    need not be known.

    Parameters
    ----------
    poses : Poses
        The poses; compared if they have `q` and `p_cmd`.
    robot : Robot
        The robot with its nominal model.
    tolerance_mm : float [mm]
        The largest deviation of a rounded or factory-calibrated controller from the nominal model.

    Returns
    -------
    (n,) array [mm]
        The remaining deviation of each row; empty without joints, without commanded positions, or with too few rows.

    Raises
    ------
    DataError
        With the rows that disagree, or the unit that explains the deviation.
    """
    if poses.q is None or poses.p_cmd is None or len(poses) < _FEWEST or not _moves(poses):
        return np.empty(0)
    if poses.q.shape[1] != robot.dof:
        raise poses.error(f"has {poses.q.shape[1]} joints, {robot.name} has {robot.dof}")
    left = _disagreement(poses.q, poses.p_cmd, robot, robust=False)
    if left.max() > _ROUNDING_MM:  # else no row is off, and nothing is to be left out
        left = _disagreement(poses.q, poses.p_cmd, robot)
    median = float(np.median(left))
    if median <= tolerance_mm:
        if (bad := left > tolerance_mm).any():
            message = f"joints and commanded positions disagree by up to {left[bad].max():.4g} mm"
            raise poses.error(f"{message}; rows swapped, or a typing error?", bad)
        return left
    by = f" by {median:.4g} mm (median)" if np.isfinite(median) else ""
    message = f"joints and commanded positions disagree{by} on {robot.name}"
    for q_factor, p_factor, why in _REMEDIES:
        if np.median(_disagreement(poses.q * q_factor, poses.p_cmd * p_factor, robot, robust=False)) <= tolerance_mm:
            raise poses.error(f"{message}: {why}")
    shown = read_as_shown(poses.q, robot)
    if shown is not None and np.median(_disagreement(shown, poses.p_cmd, robot, robust=False)) <= tolerance_mm:
        raise poses.error(f"{message}: they are joints as the controller shows them; name the columns q1_shown_deg …")
    raise poses.error(
        f"{message}; is it this robot, with its D-H convention, and are its joints in the right order and sign?"
    )


def check_not_compensated(poses: Poses, robot: Robot) -> None:
    """Refuse poses of a controller that already compensates the errors of its arm: they would be corrected twice.

    Such a controller (absolute accuracy) shows positions of its calibrated model, 1–3 mm from those of the nominal
    model. Rounding, and servo errors in measured joints, stay below `_ROUNDING_MM`.

    Raises
    ------
    DataError
        If joints and commanded positions disagree by more, or for a reason of `check_against`.
    """
    left = check_against(poses, robot)
    if len(left) and (median := float(np.median(left))) > _ROUNDING_MM:
        message = f"joints and commanded positions disagree by {median:.3g} mm (median) on the nominal {robot.name}"
        why = "the controller seems to compensate already (absolute accuracy), so errors would be corrected twice"
        remedy = "switch it off and measure again, or leave out the commanded positions if they are of another model"
        raise poses.error(f"{message}: {why}; {remedy}")


def _disagreement(q: FloatArray, p_cmd: FloatArray, robot: Robot, *, robust: bool = True) -> FloatArray:
    """Return the distance between model and commanded positions after the best frame and tool, (n,) [mm]."""
    from truepose.geometry.registration import register, register_with_tool

    try:
        tf_base_flange = robot.forward(q)
        try:
            residuals = register_with_tool(tf_base_flange, p_cmd, robust=robust).residuals
        except IdentifiabilityError:  # a single orientation: the tool cannot be separated from the frame
            residuals = register(tf_base_flange[:, :3, 3], p_cmd, robust=robust).residuals
    except TrueposeError:  # impossible joints, or positions that no frame and tool explain
        return np.full(len(q), np.inf)
    return np.asarray(np.linalg.norm(residuals, axis=1))


def check_turns(samples: Samples) -> None:
    """Raise if the measured turns from pose to pose are not the commanded ones: another order or unit of angles.

    R_meas = A R_cmd B with the same A (station) and B (tool) at each pose, so the turns R_iᵀ R_{i+1} of both are equal
    but for the frame: their rotation vectors differ by B.

    Raises
    ------
    DataError
        With the order of angles that agrees, if there is one.
    """
    if samples.rotation_meas is None or samples.rotation_cmd is None or len(samples) < _FEWEST_TURNS:
        return
    off = _turn_difference(samples.rotation_meas, samples.rotation_cmd)
    if off <= _TURN_TOLERANCE:
        return
    angles = samples.rotation_meas.as_euler(_READ_ORDER)
    agreeing = [
        order
        for order in _OTHER_ORDERS
        if _turn_difference(Rotation.from_euler(order, angles), samples.rotation_cmd) <= _TURN_TOLERANCE
    ]
    message = f"measured and commanded orientations differ by {np.rad2deg(off):.3g} deg (median turn)"
    if agreeing:
        why = f"they agree as {agreeing[0]}; state the columns with angles={agreeing[0]}"
    else:
        why = "is it this plan, and are the angles in the order of the layout? Leave them out if in doubt"
    raise samples.error(f"{message}: {why}")


def _turn_difference(measured: Rotation, commanded: Rotation) -> float:
    """Return the median difference of the turns from pose to pose, for the best B [rad]."""
    v_measured, v_commanded = ((rotation[:-1].inv() * rotation[1:]).as_rotvec() for rotation in (measured, commanded))
    tool, _ = Rotation.align_vectors(v_measured, v_commanded)
    return float(np.median(np.linalg.norm(v_measured - tool.apply(v_commanded), axis=1)))
