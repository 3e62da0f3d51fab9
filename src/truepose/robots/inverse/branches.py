"""All branches of the inverse kinematics with what there is to tell: reach, limits, singularity.

Arms with a closed form use it. Calibrated arms take each branch of their nominal arm as the start of a damped Newton.
Other chains of up to six joints start from those of 200,000 joint vectors whose poses are nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from truepose._typing import BoolArray, FloatArray
from truepose.errors import RobotError
from truepose.geometry.arrays import name_rows
from truepose.geometry.transforms import check_transforms, invert_transform
from truepose.robots.chain import Chain, tool_transform
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.closed_form import closed_form, differ_by, nominal_of
from truepose.robots.inverse.newton import smallest_direction, smallest_singular, solve
from truepose.robots.inverse.ortho_parallel import OrthoParallel
from truepose.robots.inverse.three_parallel import ThreeParallel

SINGULAR = 0.01  # m/rad: below this smallest singular value small errors move joints by degrees
_ONE = 1e-6  # rad: solutions nearer than this are one
_BENT = 0.1  # rad from stretched, where a start must not be
_MARGIN = 3.0  # times the arms' difference: as far beyond the nominal arm's reach the calibrated one is still tried
_ASIDE = np.array([-0.3, 0.3, -1.0, 1.0])  # rad along the direction that hardly moves the flange
_SAMPLES = 200_000
_NEIGHBOURS = 64
_MOST = 16  # branches of a chain of six joints
_BLOCK = 1024  # poses at once


@dataclass(frozen=True)
class Branches:
    """The branches of n poses, from `find_branches`.

    Attributes
    ----------
    robot : Robot
    q : (n, k, dof) array [rad]
        NaN where a branch does not exist or was not found. k = 8 slots that keep their meaning where the arm, or the
        nominal arm it stems from, has a closed form; else 16 without order. Near a singularity a calibrated arm may
        have more than eight, or fewer: there one may be missing.
    sigma_min : (n, k) array [m/rad]
        Smallest singular value of the geometric Jacobian (lengths in m); below 0.01 the arm is as good as singular.
    moved : (n, k) array [rad]
        Largest joint motion from the nominal arm's branch; zero for closed forms, NaN where there is no nominal arm.
    beyond_mm : (n,) array [mm]
        How far the pose lies beyond the arm's reach in its orientation, measured along the nearest branch; zero within.
    """

    robot: Chain
    q: FloatArray
    sigma_min: FloatArray
    moved: FloatArray
    beyond_mm: FloatArray

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
        """Whether a branch is as good as singular, sigma_min below 0.01 m/rad: (n, k)."""
        return np.asarray(self.sigma_min < SINGULAR)

    def check_reach(self) -> None:
        """Raise `RobotError` that names the rows out of reach, and by how much [mm]."""
        rows = np.flatnonzero(~self.exists.any(axis=1))
        if len(rows):
            told = "; ".join(f"row {row} by {self.beyond_mm[row]:.4g} mm" for row in rows[:3])
            more = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
            raise RobotError(f"{self.robot.name}: out of reach: {told}{more}; check base, tool and unit (mm)")

    def check(self) -> None:
        """Raise `RobotError` that names rows out of reach, or else rows reached only beyond the joint limits."""
        self.check_reach()
        name, rows = self.robot.name, np.flatnonzero(~self.within_limits.any(axis=1))
        if len(rows):
            lower, upper = self.robot.limits.T
            q = self.q[rows[0]]
            over = np.nan_to_num(np.maximum(lower - q, q - upper), nan=np.inf)
            slot = int(np.argmin(over.max(axis=1)))
            joint = int(np.argmax(over[slot]))
            raise RobotError(
                f"{name}: within the joint limits there is no branch for {name_rows(rows)}; in row {rows[0]} the "
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
        Of up to six joints.
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        Poses of the flange, or of the TCP when `tool` is given.
    tool : (4, 4) array or (3,) array [mm], optional
        As in `Robot.forward`.
    nominal : Robot, optional
        The arm that a calibrated one stems from, with a closed form; made from `robot` when not given.

    Returns
    -------
    Branches

    Raises
    ------
    RobotError
        If the chain has more than six joints, or `nominal` has no closed form.
    DataError
        If poses or tool are no rigid transforms.

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
        beyond[lost] = _beyond(robot, arm, flange[lost]).min(axis=1)
    elif (nominal := nominal or nominal_of(robot)) is not None:
        q, moved, beyond = _from_nominal(robot, nominal, flange)
    else:
        q, beyond = _from_samples(robot, flange)
        moved = np.full(q.shape[:2], np.nan)
    q = wrap_into_limits(robot, q)
    sigma = smallest_singular(robot, q.reshape(-1, robot.dof)).reshape(q.shape[:2])
    return Branches(robot, q, sigma, moved, beyond)


def check_dof(robot: Chain) -> None:
    """Raise `RobotError` for a chain of more than six joints."""
    if robot.dof > 6:
        raise RobotError(
            f"{robot.name}: {robot.dof} joints reach a pose in infinitely many ways; inverse kinematics needs at most "
            "six: hold the others still and describe the rest as a chain"
        )


def wrap_into_limits(robot: Chain, q: FloatArray) -> FloatArray:
    """Return joints (…, dof) [rad] in (-pi, pi], or a turn away where that brings them within the limits."""
    turn = 2 * np.pi
    wrapped = np.asarray(q - turn * np.ceil((q - np.pi) / turn))
    for shift in (turn, -turn):
        moves = ~robot.within_limits(wrapped) & robot.within_limits(wrapped + shift)
        wrapped = np.where(moves, wrapped + shift, wrapped)
    return wrapped


def _from_nominal(robot: Chain, nominal: Chain, flange: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow each branch of the nominal arm to the calibrated one's; return q, moved and beyond_mm."""
    arm = closed_form(nominal)
    if arm is None:
        raise RobotError(f"{nominal.name}: the nominal arm has no closed-form inverse; name another, or none")
    start = arm.branches(flange)
    lost = np.isnan(start[..., 0])
    start[lost] = arm.branches(flange, _BENT)[lost]
    # where the nominal arm just fails to reach, the calibrated one may, and the other way round
    beyond = _beyond(nominal, arm, flange)
    rows, slots = np.nonzero(beyond < _MARGIN * differ_by(robot, nominal))
    found, miss = _followed(robot, flange[rows], start[rows, slots])
    q = np.full(start.shape, np.nan)
    q[rows, slots] = found
    moved = np.abs(half_turn(q - start)).max(axis=-1)
    q[_repeated(q, moved)] = np.nan
    moved[np.isnan(q[..., 0])] = np.nan
    beyond[rows, slots] = np.maximum(beyond[rows, slots], miss)
    return q, moved, np.where(np.isnan(q[..., 0]).all(axis=1), beyond.min(axis=1), 0.0)


def _followed(robot: Chain, flange: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return joints (n, dof), NaN where the pose is not reached, and by how much it is missed, (n,) [mm]."""
    found = solve(robot, flange, start)
    q, miss = np.where(found.reached[:, None], found.q, np.nan), found.miss_mm.copy()
    # a second chance near singularities: aside along the joint motion that hardly moves the flange
    for aside in _ASIDE:
        failed = np.flatnonzero(np.isnan(q[:, 0]))
        if not len(failed):
            break
        away = start[failed] + aside * smallest_direction(robot, start[failed])
        again = solve(robot, flange[failed], away)
        q[failed[again.reached]] = again.q[again.reached]
        miss[failed] = np.minimum(miss[failed], again.miss_mm)
    return q, miss


def _beyond(robot: Chain, arm: OrthoParallel | ThreeParallel, flange: FloatArray) -> FloatArray:
    """Return how far each branch stretched towards the pose, in its orientation, stays from it: (n, 8) [mm]."""
    nearest = half_turn(arm.branches(flange, 0.0))
    if not len(nearest):
        return np.zeros((0, 8))
    return np.asarray(np.linalg.norm(robot.forward(nearest)[..., :3, 3] - flange[:, None, :3, 3], axis=-1))


def _from_samples(robot: Chain, flange: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return up to 16 branches from the joint vectors whose poses are nearest, and beyond_mm."""
    joints, tree = _sampled(robot)
    q = np.full((len(flange), _MOST, robot.dof), np.nan)
    beyond = np.zeros(len(flange))
    for block in range(0, len(flange), _BLOCK):
        pose = flange[block : block + _BLOCK]
        _, near = tree.query(_features(robot, pose), _NEIGHBOURS)
        found = solve(robot, np.repeat(pose, _NEIGHBOURS, axis=0), joints[near.ravel()])
        shape = (len(pose), _NEIGHBOURS)
        ends = np.where(found.reached[:, None], found.q, np.nan).reshape(*shape, robot.dof)
        ends[_repeated(ends, np.zeros(shape))] = np.nan
        first = np.argsort(np.isnan(ends[..., 0]), axis=1, kind="stable")[:, :_MOST]
        q[block : block + _BLOCK] = np.take_along_axis(ends, first[..., None], axis=1)
        lost = np.isnan(ends[..., 0]).all(axis=1)
        beyond[block : block + _BLOCK] = np.where(lost, found.miss_mm.reshape(shape).min(axis=1), 0.0)
    return q, beyond


@lru_cache(maxsize=4)
def _sampled(robot: Chain) -> tuple[FloatArray, cKDTree]:
    """Return joint vectors over a full turn of each joint, and a tree of their poses."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (_SAMPLES, robot.dof))
    return joints, cKDTree(_features(robot, robot.forward(joints)))


def _features(robot: Chain, flange: FloatArray) -> FloatArray:
    """Return poses as points whose distances weigh position, in the arm's lengths, and orientation alike: (n, 12)."""
    length = np.abs(robot.a).sum() + np.abs(robot.d).sum()
    return np.concatenate([flange[:, :3, 3] / (0.3 * length), flange[:, :3, :3].reshape(-1, 9)], axis=1)


def _repeated(q: FloatArray, cost: FloatArray) -> BoolArray:
    """Return which of the branches (n, k, dof) repeats another one of the same pose that has a lower cost: (n, k)."""
    n, k, _ = q.shape
    repeated = np.zeros((n, k), bool)
    for slot in range(1, k):
        for other in range(slot):
            same = np.abs(half_turn(q[:, slot] - q[:, other])).max(axis=-1) < _ONE
            second = cost[:, slot] >= cost[:, other]
            repeated[:, slot] |= same & second
            repeated[:, other] |= same & ~second
    return repeated
