"""Branches of arms without a closed form, found by damped Newton.

A calibrated arm starts from each branch of its nominal arm. Other chains of up to six joints start from those of
200,000 random joint vectors whose poses are nearest.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from truepose._typing import BoolArray, FloatArray
from truepose.errors import RobotError
from truepose.robots.chain import Chain
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.closed_form import ClosedForm, closed_form, differ_by
from truepose.robots.inverse.newton import damped_newton, smallest_direction

_ONE = 1e-6  # rad: solutions that differ by less are the same
_BENT = 0.1  # rad: starts of branches out of reach keep this distance from the stretched arm
_MARGIN = 3.0  # poses are tried up to this multiple of the arms' difference beyond the nominal arm's reach
_ASIDE = np.array([-0.3, 0.3, -1.0, 1.0])  # rad, along the joint motion that hardly moves the flange
_SAMPLES = 200_000
_NEIGHBOURS = 64
_MOST = 16  # branches of a chain of six joints
_BLOCK = 1024  # poses at once


def follow_nominal(robot: Chain, nominal: Chain, flange: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow each branch of the nominal arm to that of the calibrated arm; return q, moved and beyond_mm."""
    arm = closed_form(nominal)
    if arm is None:
        raise RobotError(f"{nominal.name}: the nominal arm has no closed-form inverse; pass another one, or none")
    start = arm.branches(flange)
    lost = np.isnan(start[..., 0])
    start[lost] = arm.branches(flange, _BENT)[lost]
    # the calibrated arm may reach a pose that the nominal arm just misses, and the reverse
    beyond = distance_beyond_reach(nominal, arm, flange)
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
    """Return joints (n, dof), NaN where the pose is not reached, and the distances by which it is missed, (n,) [mm]."""
    found = damped_newton(robot, flange, start)
    q, miss = np.where(found.reached[:, None], found.q, np.nan), found.miss_mm.copy()
    # near singularities: try again from starts displaced along the joint motion that hardly moves the flange
    for aside in _ASIDE:
        failed = np.flatnonzero(np.isnan(q[:, 0]))
        if not len(failed):
            break
        away = start[failed] + aside * smallest_direction(robot, start[failed])
        again = damped_newton(robot, flange[failed], away)
        q[failed[again.reached]] = again.q[again.reached]
        miss[failed] = np.minimum(miss[failed], again.miss_mm)
    return q, miss


def distance_beyond_reach(robot: Chain, arm: ClosedForm, flange: FloatArray) -> FloatArray:
    """Return the distance left when each branch is stretched towards the pose, in its orientation: (n, 8) [mm]."""
    nearest = half_turn(arm.branches(flange, 0.0))
    if not len(nearest):
        return np.zeros((0, 8))
    return np.asarray(np.linalg.norm(robot.forward(nearest)[..., :3, 3] - flange[:, None, :3, 3], axis=-1))


def search_from_samples(robot: Chain, flange: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return up to 16 branches from the joint vectors whose poses are nearest, and beyond_mm."""
    joints, tree = _sampled(robot)
    q = np.full((len(flange), _MOST, robot.dof), np.nan)
    beyond = np.zeros(len(flange))
    for block in range(0, len(flange), _BLOCK):
        pose = flange[block : block + _BLOCK]
        _, near = tree.query(_features(robot, pose), _NEIGHBOURS)
        found = damped_newton(robot, np.repeat(pose, _NEIGHBOURS, axis=0), joints[near.ravel()])
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
    """Return poses as points (n, 12) whose distances weigh relative position and orientation alike."""
    length = np.abs(robot.a).sum() + np.abs(robot.d).sum()
    return np.concatenate([flange[:, :3, 3] / (0.3 * length), flange[:, :3, :3].reshape(-1, 9)], axis=1)


def _repeated(q: FloatArray, cost: FloatArray) -> BoolArray:
    """Return which of the branches (n, k, dof) repeat another one of the same pose that has a lower cost: (n, k)."""
    n, k, _ = q.shape
    repeated = np.zeros((n, k), bool)
    for slot in range(1, k):
        for other in range(slot):
            same = np.abs(half_turn(q[:, slot] - q[:, other])).max(axis=-1) < _ONE
            second = cost[:, slot] >= cost[:, other]
            repeated[:, slot] |= same & second
            repeated[:, other] |= same & ~second
    return repeated
