"""An arm with identified parameters as plain arrays, for `truepose.numerics.frozen`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.identification.arm import ParametricArm
from truepose.numerics.frozen import Constants, anchored, limits_of
from truepose.robots.chain import tool_transform


def constants_of(arm: ParametricArm, x: FloatArray, tool: ArrayLike | None) -> Constants:
    """Return the arrays of an arm at changes x (p,), with the tool of its model; joints turn by their deviations.

    Raises
    ------
    DataError
        If backlash is among the terms.
    """
    robot, dof, terms = arm.model.robot, arm.model.robot.dof, arm.terms
    if terms.needs_approach:
        raise DataError(
            "a calibration with backlash cannot be frozen: it needs the approach signs; fit without backlash"
        )
    moment, mass, harmonics = terms.frozen(x[len(arm.active) :])
    anchors, weights, scale = anchored(np.empty((0, 0)), np.empty((0, 3)), np.empty(0))
    links = np.stack([robot.links(tool_transform(tool)), arm.model.fixed(arm.values(x))])
    return Constants(
        links=links[:, :, :3].copy(),
        sign=robot.sign.copy(),
        limits=limits_of(robot.limits),
        twist=np.zeros((dof + 1, 6)),
        tables=np.zeros((dof, 0)),
        harmonics=harmonics,
        moment=moment,
        mass=mass,
        anchors=anchors,
        weights=weights,
        place_scale=scale,
        by_joints=np.zeros(1),
        away=np.zeros(3),
        linear=np.zeros(1),
    )
