"""Inverse kinematics on arrays: all branches, and the choice among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry.arrays import as_floats
from truepose.geometry.transforms import check_transforms, invert_transform
from truepose.robots.chain import Chain, tool_transform
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.branches import find_branches, wrap_into_limits
from truepose.robots.inverse.closed_form import closed_form


def inverse(
    robot: Chain, poses: ArrayLike, tool: ArrayLike | None = None, *, nominal: Chain | None = None
) -> FloatArray:
    """Return all branches of the inverse kinematics.

    Ortho-parallel arms with a spherical wrist, and arms with three parallel axes (UR), have eight in closed form. A
    calibrated arm, which is neither any more, follows those of its nominal arm by damped Newton. Other chains of up to
    six joints get up to 16, without order, by damped Newton from 64 starts: then a branch may be missed.

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        Poses of the flange, or of the TCP when `tool` is given.
    tool : (4, 4) array or (3,) array [mm], optional
        As in `Robot.forward`.
    nominal : Robot, optional
        The arm with a closed form that a calibrated one stems from. When not given, it is made by setting axes right
        that are out of square or parallel by less than 0.05 rad.

    Returns
    -------
    (8, dof) or (n, 8, dof) array [rad]
        NaN where a branch does not exist. A slot keeps its meaning over all poses (shoulder, elbow, wrist). Joints
        lie in (-pi, pi], or a turn away from that where this brings them within the limits; branches beyond the
        limits are returned all the same: `Robot.within_limits` tells them. (16, dof) or (n, 16, dof), without order,
        for chains that have no closed form near them.

    Raises
    ------
    RobotError
        If the chain has more than six joints, or `nominal` has no closed form.
    DataError
        If poses or tool are no rigid transforms.

    Notes
    -----
    At a singular pose (two wrist axes in line) a branch is one of infinitely many: t4 of an ortho-parallel arm, t6 of
    a UR arm is set to zero there. `find_branches` returns the same joints with reach and singularity.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> solutions = robot.inverse(robot.forward(np.deg2rad([10, -80, 95, 20, 30, 40])))
    >>> np.rad2deg(solutions[0]).round(6) + 0.0
    array([ 10., -80.,  95.,  20.,  30.,  40.])
    """
    arm = closed_form(robot)
    given = check_transforms("poses", poses)
    if arm is None or nominal is not None:
        solutions = find_branches(robot, given, tool, nominal=nominal).q
    else:
        flange = given.reshape(-1, 4, 4) @ invert_transform(tool_transform(tool))
        solutions = wrap_into_limits(robot, arm.branches(flange))
    return solutions if given.ndim == 3 else solutions[0]


def nearest_branch(solutions: ArrayLike, q_reference: ArrayLike) -> FloatArray:
    """Return of all branches the one nearest to reference joints, each joint at the turn nearest to them.

    Parameters
    ----------
    solutions : (k, dof) or (n, k, dof) array [rad]
        From `Robot.inverse`; NaN where there is no branch.
    q_reference : (dof,) or (n, dof) array [rad]
        Such as the joints that a program names.

    Returns
    -------
    (dof,) or (n, dof) array [rad]
        NaN where no branch exists. Near means the smallest largest joint motion.

    Raises
    ------
    DataError
        If the shapes do not fit.
    """
    branches, reference = as_floats("solutions", solutions), as_floats("q_reference", q_reference)
    if branches.ndim not in (2, 3) or reference.ndim > branches.ndim - 1 or reference.shape[-1:] != branches.shape[-1:]:
        raise DataError(
            f"solutions {branches.shape} and q_reference {reference.shape}: expected (n, 8, dof) and (n, dof)"
        )
    if reference.ndim == 2 and len(reference) != len(branches):
        raise DataError(f"{len(branches)} poses and {len(reference)} reference joints; expected as many, or one (dof,)")
    motion = half_turn(branches - reference[..., None, :])
    largest = np.where(np.isnan(motion).any(axis=-1), np.inf, np.abs(motion).max(axis=-1))
    best = np.argmin(largest, axis=-1)
    return np.asarray(reference + np.take_along_axis(motion, best[..., None, None], axis=-2)[..., 0, :])
