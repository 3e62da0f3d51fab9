"""Tables of joints as a controller shows them (``q1_shown_deg`` …), and the joints of the model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.samples.table import Poses, Samples

if TYPE_CHECKING:
    from truepose.robots import Robot

_SAME: Final = np.deg2rad(0.02)  # a pendant shows two to four decimals

PosesT = TypeVar("PosesT", bound=Poses)


def on_arm(poses: PosesT, robot: Robot) -> PosesT:
    """Return a table with the joints of the model, given joints as the controller shows them; else the table as it is.

    Where a table has both, they are compared, and the joints of the model count.

    Parameters
    ----------
    poses : Poses or Samples
        The table.
    robot : Robot
        The arm, with the coupling of its joints; see `truepose.robots.shown_joints`.

    Raises
    ------
    DataError
        If the number of joints is another than the arm's, or both kinds of joints disagree; with the rows.
    RobotError
        If it is not known how the controller of the arm counts its joints.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> table = Poses(q_shown=np.radians([[0.0, 20.0, 5.0, 0.0, 0.0, 0.0]]))
    >>> np.rad2deg(on_arm(table, load_robot("fanuc-m20ia")).q).round(6) + 0.0
    array([[ 0., 20., 25.,  0.,  0.,  0.]])
    """
    if isinstance(poses, Samples) and poses.distances is not None and poses.distances.q_shown is not None:
        poses = replace(poses, distances=on_arm(poses.distances, robot))
    if poses.q_shown is None:
        return poses
    from truepose.robots import shown_joints

    if poses.q_shown.shape[1] != robot.dof:
        raise poses.error(f"has {poses.q_shown.shape[1]} joints as shown (q1_shown_deg …), {robot.name} {robot.dof}")
    q = shown_joints(robot).to_model(poses.q_shown)
    if poses.q is not None:
        if poses.q.shape != q.shape:
            raise poses.error(f"has {poses.q.shape[1]} joints (q1_deg …), {robot.name} {robot.dof}")
        off = np.abs(poses.q - q)
        if (wrong := (off > _SAME).any(axis=1)).any():
            row, joint = np.unravel_index(off.argmax(), off.shape)
            raise poses.error(
                f"q{joint + 1} is {np.rad2deg(poses.q[row, joint]):.3f}°, but {np.rad2deg(q[row, joint]):.3f}° by the "
                f"joints shown and the coupling of {robot.name}; leave one kind of joints out, or correct coupling in "
                "the robot file",
                wrong,
            )
    return replace(poses, q=q if poses.q is None else poses.q, q_shown=None)


def read_as_shown(q: FloatArray, robot: Robot) -> FloatArray | None:
    """Return joints of the model (n, dof) [rad] if `q` were as the controller shows them; None where it is the same."""
    from truepose.robots import shown_joints

    try:
        shown = shown_joints(robot)
    except RobotError:
        return None
    return shown.to_model(q) if shown.coupling else None
