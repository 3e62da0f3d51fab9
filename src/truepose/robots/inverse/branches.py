"""All branches of the inverse kinematics, with reach, limits and singularity, and the choice among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import BoolArray, FloatArray
from truepose.errors import DataError, RobotError
from truepose.geometry.arrays import as_floats, name_rows
from truepose.geometry.transforms import check_transforms, invert_transform
from truepose.robots.chain import Chain, tool_transform
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.closed_form import closed_form, nominal_of
from truepose.robots.inverse.newton import smallest_singular
from truepose.robots.inverse.search import distance_beyond_reach, follow_nominal, search_from_samples

SINGULAR = 0.01  # m/rad: below this smallest singular value small errors move joints by degrees


@dataclass(frozen=True, eq=False, repr=False)
class Branches:
    """The branches of n poses, from `find_branches`.

    Attributes
    ----------
    robot : Robot
    q : (n, k, dof) array [rad]
        Joints of each branch; NaN where a branch does not exist or was not found. Where the arm, or its nominal arm,
        has a closed form, k is 8 and each slot keeps its meaning (shoulder, elbow, wrist); otherwise k is 16 without
        order. Near a singularity a calibrated arm may have more than eight branches, or fewer, and one may be missing.
    sigma_min : (n, k) array [m/rad]
        The smallest singular value of the geometric Jacobian (lengths in m); below 0.01 the arm is nearly singular.
    moved : (n, k) array [rad]
        The largest joint motion from the nominal arm's branch; zero for closed forms, NaN without a nominal arm.
    beyond_mm : (n,) array [mm]
        The distance of the pose beyond the arm's reach in its orientation, along the nearest branch; zero within.
    """

    robot: Chain
    q: FloatArray
    sigma_min: FloatArray
    moved: FloatArray
    beyond_mm: FloatArray

    def __repr__(self) -> str:
        reached = int(self.exists.any(axis=1).sum())
        within = int(self.within_limits.any(axis=1).sum())
        return f"<Branches of {len(self.q)} poses of {self.robot.name}: {reached} reached, {within} within limits>"

    @property
    def exists(self) -> BoolArray:
        """Whether a branch exists: (n, k)."""
        return np.asarray(~np.isnan(self.q).any(axis=-1))

    @property
    def within_limits(self) -> BoolArray:
        """Whether a branch exists within the joint limits: (n, k)."""
        return np.asarray(self.robot.within_limits(self.q).all(axis=-1))

    @property
    def singular(self) -> BoolArray:
        """Whether a branch is nearly singular, sigma_min below 0.01 m/rad: (n, k)."""
        return np.asarray(self.sigma_min < SINGULAR)

    def check_reach(self) -> None:
        """Raise `RobotError` if rows are out of reach; the message names them and the missing lengths [mm]."""
        rows = np.flatnonzero(~self.exists.any(axis=1))
        if len(rows):
            listed = "; ".join(f"row {row} by {self.beyond_mm[row]:.4g} mm" for row in rows[:3])
            more = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
            raise RobotError(f"{self.robot.name}: out of reach: {listed}{more}; check base, tool and unit (mm)")

    def check(self) -> None:
        """Raise `RobotError` if rows are out of reach, or are reached only beyond the joint limits."""
        self.check_reach()
        name, rows = self.robot.name, np.flatnonzero(~self.within_limits.any(axis=1))
        if len(rows):
            lower, upper = self.robot.limits.T
            q = self.q[rows[0]]
            over = np.nan_to_num(np.maximum(lower - q, q - upper), nan=np.inf)
            slot = int(np.argmin(over.max(axis=1)))
            joint = int(np.argmax(over[slot]))
            raise RobotError(
                f"{name}: no branch lies within the joint limits for {name_rows(rows)}; in row {rows[0]} the "
                f"nearest has joint {joint + 1} at {np.rad2deg(q[slot, joint]):.3f} deg, limits "
                f"{np.rad2deg(lower[joint]):.6g} to {np.rad2deg(upper[joint]):.6g}; move the target or the base"
            )


def find_branches(
    robot: Chain, poses: ArrayLike, tool: ArrayLike | None = None, *, nominal: Chain | None = None
) -> Branches:
    """Return all branches of the inverse kinematics, with reach, limits and singularity.

    Parameters
    ----------
    robot : Robot
        An arm of up to six joints.
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        Poses of the flange, or of the TCP when `tool` is given.
    tool : (4, 4) array or (3,) array [mm], optional
        As in `Robot.forward`.
    nominal : Robot, optional
        The nominal arm of a calibrated one, which has a closed form; made from `robot` when not given.

    Returns
    -------
    Branches

    Raises
    ------
    RobotError
        If the chain has more than six joints, or `nominal` has no closed form.
    DataError
        If poses or tool are not rigid transforms.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> poses = robot.forward(np.deg2rad([[0, -90, 90, 0, 45, 0], [0, -90, 90, 0, 0.1, 0]]))
    >>> found = find_branches(robot, poses)
    >>> found.sigma_min.round(4)[:, 0]
    array([0.4069, 0.0009])
    >>> poses[1, 0, 3] += 3000.0
    >>> find_branches(robot, poses).check()
    Traceback (most recent call last):
    truepose.errors.RobotError: kuka-kr150-2: out of reach: row 1 by 1919 mm; check base, tool and unit (mm)
    """
    check_dof(robot)
    given = check_transforms("poses", poses)
    flange = given.reshape(-1, 4, 4) @ invert_transform(tool_transform(tool))
    arm = closed_form(robot)
    if arm is not None and nominal is None:
        q = arm.branches(flange)
        moved = np.where(np.isnan(q[..., 0]), np.nan, 0.0)
        beyond = np.zeros(len(q))
        lost = np.isnan(q[..., 0]).all(axis=1)
        beyond[lost] = distance_beyond_reach(robot, arm, flange[lost]).min(axis=1)
    elif (nominal := nominal or nominal_of(robot)) is not None:
        q, moved, beyond = follow_nominal(robot, nominal, flange)
    else:
        q, beyond = search_from_samples(robot, flange)
        moved = np.full(q.shape[:2], np.nan)
    q = wrap_into_limits(robot, q)
    sigma = smallest_singular(robot, q.reshape(-1, robot.dof)).reshape(q.shape[:2])
    return Branches(robot, q, sigma, moved, beyond)


def check_dof(robot: Chain) -> None:
    """Raise `RobotError` for a chain of more than six joints."""
    if robot.dof > 6:
        raise RobotError(
            f"{robot.name}: {robot.dof} joints reach a pose in infinitely many ways; inverse kinematics supports at "
            "most six: hold the others still and describe the rest as a chain"
        )


def wrap_into_limits(robot: Chain, q: FloatArray) -> FloatArray:
    """Return joints (…, dof) [rad] in (-pi, pi], or a turn away where that brings them within the limits."""
    turn = 2 * np.pi
    wrapped = np.asarray(q - turn * np.ceil((q - np.pi) / turn))
    for shift in (turn, -turn):
        moves = ~robot.within_limits(wrapped) & robot.within_limits(wrapped + shift)
        wrapped = np.where(moves, wrapped + shift, wrapped)
    return wrapped


def inverse(
    robot: Chain, poses: ArrayLike, tool: ArrayLike | None = None, *, nominal: Chain | None = None
) -> FloatArray:
    """Return all branches of the inverse kinematics.

    Arms with a parallel base pair and a spherical wrist, and arms with three parallel axes (UR), have eight branches in
    closed form. A calibrated arm, which is neither, follows the branches of its nominal arm by damped Newton. Other
    chains of up to six joints get up to 16 branches without order, by damped Newton from 64 starts; one may be missed.

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        Poses of the flange, or of the TCP when `tool` is given.
    tool : (4, 4) array or (3,) array [mm], optional
        As in `Robot.forward`.
    nominal : Robot, optional
        The nominal arm of a calibrated one, which has a closed form. When not given, it is made from `robot`: axes
        out of square or parallel by less than 0.05 rad are made square or parallel.

    Returns
    -------
    (8, dof) or (n, 8, dof) array [rad]
        NaN where a branch does not exist. A slot keeps its meaning over all poses (shoulder, elbow, wrist). Joints
        lie in (-pi, pi], or a full turn away where this brings them within the limits. Branches beyond the limits are
        returned as well; test them with `Robot.within_limits`. Chains without a closed form return (16, dof) or
        (n, 16, dof), without order.

    Raises
    ------
    RobotError
        If the chain has more than six joints, or `nominal` has no closed form.
    DataError
        If poses or tool are not rigid transforms.

    Notes
    -----
    At a singular pose (two wrist axes in line) a branch is one of infinitely many: joint 4 of an arm with a spherical
    wrist, or joint 6 of a UR arm, is set to the zero of its closed form. `find_branches` also returns reach and
    singularity.

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
    """Return the branch nearest to reference joints, each joint at the full turn nearest to its reference.

    Parameters
    ----------
    solutions : (k, dof) or (n, k, dof) array [rad]
        The branches from `Robot.inverse`; NaN where there is none.
    q_reference : (dof,) or (n, dof) array [rad]
        The reference joints, such as those of a program.

    Returns
    -------
    (dof,) or (n, dof) array [rad]
        The branch whose largest joint motion is smallest; NaN where no branch exists.

    Raises
    ------
    DataError
        If the shapes do not fit.
    """
    branches, reference = as_floats("solutions", solutions), as_floats("q_reference", q_reference)
    if branches.ndim not in (2, 3) or reference.ndim > branches.ndim - 1 or reference.shape[-1:] != branches.shape[-1:]:
        raise DataError(
            f"expected solutions (n, 8, dof) and q_reference (n, dof), got {branches.shape} and {reference.shape}"
        )
    if reference.ndim == 2 and len(reference) != len(branches):
        raise DataError(
            f"got {len(branches)} poses and {len(reference)} reference joints; expected equal numbers, or one (dof,)"
        )
    motion = half_turn(branches - reference[..., None, :])
    largest = np.where(np.isnan(motion).any(axis=-1), np.inf, np.abs(motion).max(axis=-1))
    best = np.argmin(largest, axis=-1)
    return np.asarray(reference + np.take_along_axis(motion, best[..., None, None], axis=-2)[..., 0, :])
