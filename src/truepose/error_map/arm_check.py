"""Check the nominal arm and the stated tool with positions that the controller shows.

A controller with another tool, or an arm of another size, reaches other positions than the model. Joints and positions
of the same poses check both: p = F(q) · tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.cell.sections import Fit
from truepose.error_map.facts import Fact
from truepose.errors import DataError, IdentifiabilityError, RobotError
from truepose.geometry import Registration, invert_transform, register_with_tool
from truepose.robots import Robot, shown_joints
from truepose.samples import Poses

_ROUNDING_MM: Final = 0.3  # rounded joints of a large arm, or the servo errors of a small one
_TOOL_MM: Final = 0.1
_OWN_MM: Final = 1e-5  # no controller shows positions with so many digits
_OTHER_POINT_MM: Final = 1.0  # largest distance of a fitted tool to that of the controller without a note
_START_MM: Final = 50.0  # from the starting value of a tool to that of the controller
_OTHER_FRAME_MM: Final = 1.0  # smaller differences are errors of the model
_QUARTER_TURNS: Final = [np.array([[c, -s], [s, c]], float) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
_KNOWN_MM: Final = 1.0  # directions of the tool with a larger standard deviation are not compared
_SIGMAS: Final = 4.0
_ANGLE: Final = float(np.deg2rad(0.2))
_FEWEST: Final = 8
_UNCHECKED: Final = "The arm's model, its base and the tool were not checked"
_REMEDY: Final = "Check one taught point with 'truepose check-point'."
NOT_CHECKED: Final = f"{_UNCHECKED}: the joints have no commanded positions. {_REMEDY}"
_UNDECIDED: Final = f"{_UNCHECKED}: too few poses, or one orientation in an unknown frame. " + _REMEDY
_OWN: Final = (
    f"{_UNCHECKED}: the commanded positions are the model's own to the last digit, not the controller's. {_REMEDY}"
)
_NO_JOINTS: Final = (
    f"{_UNCHECKED}: the samples have no joints, and their positions are taken as the controller's own. {_REMEDY}"
)


@dataclass(frozen=True)
class ArmCheck:
    """The comparison of the nominal arm and the tool with commanded positions.

    Attributes
    ----------
    checked : bool
        Whether there were positions to compare with.
    words : str
        The result in sentences.
    n : int
        The number of poses compared.
    residual_mm : float, optional
        The median distance between the model and the commanded positions, with the tool and frame fitted to them.
    p_flange_tool_mm : tuple of float, optional
        The controller's tool that the positions imply, flange frame.
    """

    checked: bool
    words: str
    n: int = 0
    residual_mm: float | None = None
    p_flange_tool_mm: tuple[float, ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the check as plain values."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> Self:
        """Return the check that `to_dict` described.

        Raises
        ------
        TypeError, ValueError
            If a value is missing or of a wrong kind.
        """
        made = cls(**found)
        if type(made.checked) is not bool or type(made.words) is not str or type(made.n) is not int:
            raise TypeError("arm_check has values of a wrong kind")
        numbers = [] if made.residual_mm is None else [made.residual_mm]
        if not np.isfinite([*numbers, *(made.p_flange_tool_mm or ())]).all():
            raise ValueError("arm_check has numbers that are not finite")
        return made


UNCHECKED: Final = ArmCheck(False, NOT_CHECKED)


@dataclass(frozen=True)
class _Implied:
    """The tool and the frame that positions imply."""

    p_flange_tool: FloatArray
    covariance: FloatArray
    tf_frame_base: FloatArray
    residual: float

    @property
    def frame_differs(self) -> bool:
        return not np.allclose(self.tf_frame_base, np.eye(4), rtol=0.0, atol=1e-9)

    def from_tool(self, p_flange_tool: FloatArray) -> tuple[float, float]:
        """Return the distance to a tool in the directions that the poses determine [mm], and its limit there [mm]."""
        variance, axes = np.linalg.eigh(self.covariance)
        known = variance < _KNOWN_MM**2
        away = axes.T @ (self.p_flange_tool - p_flange_tool)
        std = np.sqrt(np.maximum(variance, 0.0)[known].sum())
        return float(np.linalg.norm(away[known])), _TOOL_MM + _SIGMAS * float(std)


def check_arm(robot: Robot, poses: Poses, tf_flange_tool: FloatArray, *, fit: Fit = "none") -> ArmCheck:
    """Compare the nominal arm and the tool with the commanded positions of a table.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    poses : Poses
        The joints and the positions that the controller shows.
    tf_flange_tool : (4, 4) array [mm]
        The transform from flange to measured point.
    fit : {"none", "position", "pose"}
        The fitted part of the tool; by default the tool is stated, and must be the controller's.

    Returns
    -------
    ArmCheck

    Raises
    ------
    DataError
        If the positions prove another tool than the one stated; both are named.

    Notes
    -----
    A tool is constant in the flange frame, a frame is constant in space, and the errors of a calibrated model are
    neither: poses of several orientations separate the three. With one orientation a tool and a frame cannot be
    separated; both are named then.
    """
    if poses.q is None:
        return ArmCheck(False, _NO_JOINTS)
    if poses.p_cmd is None:
        return ArmCheck(False, NOT_CHECKED)
    tf_base_flange = robot.forward(poses.q)
    implied = _implied(tf_base_flange, poses.p_cmd)
    if implied is None:
        return ArmCheck(False, _UNDECIDED)
    within = f"{len(poses)} poses within {implied.residual:.3f} mm (median)"
    notes = [f"The arm's model agrees with the commanded positions of {within}."]
    if implied.frame_differs:
        notes.append(_other_frame(implied.tf_frame_base))
    stated = tf_flange_tool[:3, 3]
    away, limit = implied.from_tool(stated)
    if fit == "none":
        if away > limit:
            raise poses.error(_other_tool(tf_base_flange, poses.p_cmd, implied, stated, away))
        notes.append(f"The controller's tool agrees with [tool] within {away:.3f} mm.")
    elif away > limit + _OTHER_POINT_MM:
        notes.append(
            f"They are of another point than the measured one, {away:.2f} mm from it: the controller's tool is "
            f"{_point(implied.p_flange_tool)}, the measured point {_point(stated)}; programs must name their tool."
        )
    if implied.residual < _OWN_MM:
        return ArmCheck(False, _OWN)
    if poses.rotation_cmd is not None and fit != "pose":
        turns = _tool_turns(tf_base_flange, implied, poses.rotation_cmd)
        notes.append(_check_rotation(poses, turns, Rotation.from_matrix(tf_flange_tool[:3, :3]), fit))
    p = _rounded(implied.p_flange_tool)
    return ArmCheck(True, " ".join(notes), len(poses), implied.residual, p)


def in_controllers_base(
    robot: Robot, poses: Poses, tf_flange_tool: FloatArray, *, fit: Fit = "none"
) -> tuple[Robot, list[Fact]]:
    """Return the arm in the base in which its controller shows positions, with what that changes.

    The base of a model may be turned against that of the controller, as in the descriptions of ROS, or lie at another
    height. Positions of programs are relative to the controller's base, so the model is placed in it.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    poses : Poses
        The joints and the positions that the controller shows.
    tf_flange_tool : (4, 4) array [mm]
        The stated tool.
    fit : {"none", "position", "pose"}
        The fitted part of the tool; a stated tool must be that of the positions, or the arm may be another one.

    Returns
    -------
    robot : Robot
        The robot whose base is the controller's where the two differ by quarter turns about z and by height alone;
        otherwise the same robot.
    facts : list of Fact
        ``base-turned`` for a base that was changed; ``base-elsewhere`` where the positions are in a frame that may be
        any other one of the controller, such as a work object.
    """
    if poses.q is None or poses.p_cmd is None:
        return robot, []
    tf_base_flange = robot.forward(poses.q)
    try:
        implied = _implied(tf_base_flange, poses.p_cmd)
    except DataError:  # no frame explains the positions: the check of the samples says more
        return robot, []
    if implied is None or not implied.frame_differs or implied.residual > _ROUNDING_MM:
        return robot, []
    tf = implied.tf_frame_base
    angle = float(np.arctan2(tf[1, 0], tf[0, 0]))
    quarter = round(angle / (np.pi / 2.0)) % 4
    height = float(np.round(tf[2, 3], 2)) + 0.0
    snapped = np.eye(4)
    snapped[:2, :2] = _QUARTER_TURNS[quarter]
    snapped[2, 3] = 0.0 if abs(height) <= _ROUNDING_MM else height
    again = _implied(snapped @ tf_base_flange, poses.p_cmd)
    stated = tf_flange_tool[:3, 3]
    away, limit = (0.0, 0.0) if again is None else again.from_tool(stated)
    if fit != "none":  # a starting value, or none at all
        limit = _START_MM if stated.any() else np.inf
    if again is not None and not again.frame_differs and away <= limit:
        turned = [f"turned by {90 * quarter}° about z"] if quarter else []
        shifted = [f"{snapped[2, 3]:g} mm higher"] if snapped[2, 3] else []
        words = (
            f"the base of {robot.name} is {' and '.join(turned + shifted)} in the controller's base: the model was "
            "placed in the controller's base, in which programs are corrected"
        )
        placed = replace(robot, tf_base_first=snapped @ robot.tf_base_first)
        return placed, [Fact("base-turned", words, "fit", 90.0 * quarter, None, "deg")]
    tools = np.einsum("nji,nj->ni", tf_base_flange[:, :3, :3], poses.p_cmd - tf_base_flange[:, :3, 3])
    spread = float(np.median(np.linalg.norm(tools - np.median(tools, axis=0), axis=1)))
    if spread <= _OTHER_FRAME_MM:
        return robot, []
    words = (
        "the commanded positions are in a frame in which the model's base lies at "
        f"{_point(tf[:3, 3])}, turned by {_degrees(Rotation.from_matrix(tf[:3, :3]))}: it is not known whether this is "
        "the controller's base or another frame"
    )
    return robot, [Fact("base-elsewhere", words, "fit", float(np.linalg.norm(tf[:3, 3])), None, "mm")]


def check_point(
    cell: Cell,
    q: ArrayLike,
    p_shown: ArrayLike,
    rotation_shown: Rotation | None = None,
    *,
    tool: int | str | None = None,
    shown: bool = False,
) -> ArmCheck:
    """Compare the nominal arm and the cell's tool with one taught point, as the controller shows it.

    Parameters
    ----------
    cell : Cell
        The cell with robot and tool.
    q : (dof,) array [rad]
        The joints of the point.
    p_shown : (3,) array [mm], robot base frame
        The position that the controller shows, with the cell's tool active and no other base.
    rotation_shown : Rotation, optional
        The orientation that the controller shows.
    tool : int or str, optional
        The active tool, from ``[frames.tools]``; by default that of ``[tool]``.
    shown : bool
        Whether the joints are as the controller shows them; see `truepose.robots.shown_joints`.

    Returns
    -------
    ArmCheck
        The check, with the tool that the position implies.

    Raises
    ------
    DataError
        If model and controller differ by more than rounding; both positions and both tools are named.
    RobotError
        If the number of joints is wrong.

    Examples
    --------
    >>> from truepose import VirtualCell
    >>> cell = VirtualCell("paper").cell
    >>> q = np.deg2rad([0.0, -60.0, 80.0, 0.0, 40.0, 0.0])
    >>> shown = cell.load_robot().forward(q[None], tool=cell.tf_flange_tool)[0, :3, 3]
    >>> check_point(cell, q, shown).words
    "The arm's model and the tool agree with one taught point within 0.000 mm."
    """
    robot = cell.load_robot()
    joints, display = np.atleast_2d(np.asarray(q, float)), np.asarray(p_shown, float)
    if display.shape != (3,) or not np.isfinite(display).all():
        raise DataError(f"expected a position of shape (3,) and finite, got shape {display.shape}")
    robot.check_joints(joints)
    joints = shown_joints(robot).to_model(joints) if shown else joints
    tf_base_flange = robot.forward(joints)[0]
    tf_flange_tool = _tool_of(cell, tool)
    tf_base_tool = tf_base_flange @ tf_flange_tool
    away = float(np.linalg.norm(tf_base_tool[:3, 3] - display))
    p_flange_tool = tf_base_flange[:3, :3].T @ (display - tf_base_flange[:3, 3])
    if away > _ROUNDING_MM:
        raise DataError(
            f"the controller shows {_point(display)} where {robot.name} with the cell's tool has "
            f"{_point(tf_base_tool[:3, 3])}, {away:.2f} mm apart; if the arm is right, the controller's tool is "
            f"{_point(p_flange_tool)} and the cell's {_point(tf_flange_tool[:3, 3])}: check the robot's model, "
            f"[tool], and that no base is active{_counted(robot, shown)}"
        )
    if rotation_shown is not None:
        turn = (Rotation.from_matrix(tf_base_tool[:3, :3]).inv() * rotation_shown).magnitude()
        if turn > _ANGLE:
            raise DataError(
                f"the controller shows an orientation {np.rad2deg(turn):.2f}° from that of {robot.name} with the "
                "cell's tool; check the angles of [tool]"
            )
    words = f"The arm's model and the tool agree with one taught point within {away:.3f} mm."
    return ArmCheck(True, words, 1, away, _rounded(p_flange_tool))


def _counted(robot: Robot, shown: bool) -> str:
    """Return what else to check where the controller shows other joints than those of the model."""
    try:
        if not shown_joints(robot).coupling:
            return ""
    except RobotError:
        pass
    if shown:
        return "; the joints were taken as the controller shows them"
    return "; the joints were taken as those of the model: state it if they are from the display (--shown)"


def _tool_of(cell: Cell, tool: int | str | None) -> FloatArray:
    if tool is None:
        return cell.tf_flange_tool
    known = {str(key).casefold(): tf for key, tf in cell.tools.items()}
    if (key := str(tool).strip().casefold()) not in known:
        raise DataError(f"tool {tool} is not in [frames.tools] of the cell file ({', '.join(known) or 'none'})")
    return known[key]


def _implied(tf_base_flange: FloatArray, p_cmd: FloatArray) -> _Implied | None:
    """Return the implied tool where that explains the positions, else tool and frame; None if neither does."""
    rotation = tf_base_flange[:, :3, :3]
    tools = np.einsum("nji,nj->ni", rotation, p_cmd - tf_base_flange[:, :3, 3])
    tool = np.median(tools, axis=0)
    residual = float(np.median(np.linalg.norm(tools - tool, axis=1)))
    if residual <= _ROUNDING_MM:
        variance = np.eye(3) * residual**2 / len(tools)
        return _Implied(tool, variance, np.eye(4), residual)
    if len(p_cmd) < _FEWEST:
        return None
    try:
        found: Registration = register_with_tool(tf_base_flange, p_cmd, robust=True)
    except IdentifiabilityError:
        return None
    assert found.p_flange_tool is not None
    residual = float(np.median(np.linalg.norm(found.residuals, axis=1)))
    return _Implied(found.p_flange_tool, found.covariance[6:9, 6:9], invert_transform(found.tf_base_tracker), residual)


def _other_tool(
    tf_base_flange: FloatArray, p_cmd: FloatArray, implied: _Implied, stated: FloatArray, away: float
) -> str:
    """Return the message for a tool that the positions contradict."""
    message = (
        f"the commanded positions are those of the tool {_point(implied.p_flange_tool)}, but [tool] states "
        f"{_point(stated)}, {away:.2f} mm apart"
    )
    shifts = p_cmd - tf_base_flange[:, :3, 3] - tf_base_flange[:, :3, :3] @ stated
    shift = np.median(shifts, axis=0)
    if np.median(np.linalg.norm(shifts - shift, axis=1)) <= _ROUNDING_MM and not implied.frame_differs:
        message += f" (or, since the orientations are all alike, a base that lies at {_point(-shift)})"
    remedy = "state the controller's tool in the cell file, or leave out positions that the controller did not show"
    return f"{message}; {remedy}"


def _other_frame(tf_frame_base: FloatArray) -> str:
    turn = np.rad2deg(Rotation.from_matrix(tf_frame_base[:3, :3]).magnitude())
    return (
        f"They are given in a frame in which the model's base lies at {_point(tf_frame_base[:3, 3])}, turned by "
        f"{turn:.2f}°: bases of programs must be stated from the robot's own base."
    )


def _tool_turns(tf_base_flange: FloatArray, implied: _Implied, rotation_cmd: Rotation) -> Rotation:
    """Return the tool orientations in the flange frame that commanded orientations imply."""
    frame = Rotation.from_matrix(implied.tf_frame_base[:3, :3])
    return (frame * Rotation.from_matrix(tf_base_flange[:, :3, :3])).inv() * rotation_cmd


def _check_rotation(poses: Poses, turns: Rotation, stated: Rotation, fit: Fit) -> str:
    """Return a note on the tool's orientation, or raise an error if commanded orientations contradict it."""
    mean = turns.mean()
    if np.median((turns * mean.inv()).magnitude()) > _ANGLE:
        return "Commanded orientations do not follow the joints, and were not used to check the tool."
    if (angle := float((stated.inv() * mean).magnitude())) <= _ANGLE:
        return "Its orientation agrees as well."
    message = (
        f"the tool of the commanded orientations is turned by {_degrees(mean)}, that of [tool] by {_degrees(stated)}, "
        f"{np.rad2deg(angle):.2f}° apart"
    )
    if fit == "none" or stated.magnitude() > 0.0:
        raise poses.error(f"{message}; state the controller's tool in the cell file")
    return f"{message[0].upper()}{message[1:]}: state the angles in [tool]."


def _rounded(p: FloatArray) -> tuple[float, ...]:
    return tuple((np.round(p, 4) + 0.0).tolist())


def _point(p: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in np.round(p, 2) + 0.0) + ") mm"


def _degrees(rotation: Rotation) -> str:
    return "Rz {:.2f}° Ry {:.2f}° Rx {:.2f}°".format(*(rotation.as_euler("ZYX", degrees=True).round(2) + 0.0))
