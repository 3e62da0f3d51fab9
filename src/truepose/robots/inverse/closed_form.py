"""Closed-form inverses, and the nominal arm with a closed form nearest to a calibrated arm."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from truepose.errors import RobotError
from truepose.robots.chain import Chain
from truepose.robots.convert import to_mdh
from truepose.robots.inverse.ortho_parallel import OrthoParallel
from truepose.robots.inverse.three_parallel import ThreeParallel

ClosedForm = OrthoParallel | ThreeParallel

_TILT = 0.05  # rad: axes out of square or parallel by less are errors, by more they are designed so
_SHIFT = 0.02  # of the arm's length: the same for axes that should intersect
_QUARTER = np.pi / 2


@lru_cache(maxsize=64)
def closed_form(robot: Chain) -> ClosedForm | None:
    """Return a robot's closed-form inverse, checked against its forward kinematics; None if there is none.

    Raises
    ------
    RobotError
        If the two disagree.
    """
    arm = OrthoParallel.of(robot) or ThreeParallel.of(robot)
    if arm is None:
        return None
    pose = robot.forward(np.linspace(0.3, 0.8, 6))[None]
    branches = arm.branches(pose)[0]
    found = branches[~np.isnan(branches).any(axis=1)]
    if not len(found) or np.abs(robot.forward(found) - pose).max() > 1e-6:
        raise RobotError(
            f"{robot.name}: its closed-form inverse disagrees with its forward kinematics; please report it"
        )
    return arm


@lru_cache(maxsize=64)
def nominal_of(robot: Chain) -> Chain | None:
    """Return the nominal arm, with a closed-form inverse, of a calibrated arm; None if there is none.

    An arm with a closed form is returned itself. Otherwise axes out of square or parallel by less than 0.05 rad are
    made square or parallel, and wrist axes that miss each other by less than 2 % of the arm's length intersect.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> nominal_of(replace(robot, beta=[0, 1e-3, 0, 0, 0, 0])).beta.any()
    np.False_
    """
    if robot.dof != 6 or closed_form(robot) is not None:
        return robot if robot.dof == 6 else None
    arm = to_mdh(robot)
    quarters = _QUARTER * np.round(arm.alpha / _QUARTER)
    square = replace(
        arm,
        alpha=np.where(np.abs(arm.alpha - quarters) < _TILT, quarters, arm.alpha),
        beta=np.where(np.abs(arm.beta) < _TILT, 0.0, arm.beta),
    )
    short = _SHIFT * float(np.abs(arm.a).sum() + np.abs(arm.d).sum())
    a = np.where((np.arange(6) >= 4) & (np.abs(arm.a) < short), 0.0, arm.a)
    d = np.where((np.arange(6) == 4) & (np.abs(arm.d) < short), 0.0, arm.d)
    made = (replace(square, a=a, d=d), replace(square, a=a))  # a spherical wrist, or the offset wrist of UR arms
    return next((nominal for nominal in made if closed_form(nominal) is not None), None)


def differ_by(robot: Chain, nominal: Chain) -> float:
    """Return the largest distance between the flanges of two arms [mm] over 256 random joint vectors."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (256, robot.dof))
    apart = robot.forward(q)[:, :3, 3] - nominal.forward(q)[:, :3, 3]
    return float(np.linalg.norm(apart, axis=1).max())


def ortho_parallel(robot: Chain) -> OrthoParallel:
    """Return the closed form of a six-axis arm with parallel base pair and spherical wrist, or of its nominal arm.

    Raises
    ------
    RobotError
        If the arm is of another kind: arm configurations name branches of this kind only.
    """
    nominal = nominal_of(robot)
    arm = None if nominal is None else closed_form(nominal)
    if not isinstance(arm, OrthoParallel):
        raise RobotError(
            f"{robot.name}: arm configurations need a parallel base pair and a spherical wrist; choose among the "
            "branches of robot.inverse by reference joints (nearest_branch)"
        )
    return arm
