"""The arm as a controller calculates with it, beside the nominal arm of the map.

Such a controller commands joints by an arm model of its own (Universal Robots: the calibration of the factory; Yaskawa:
the lengths that it stores). What a program means by joints is then the pose of that model, and the map must have been
measured with its commands.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.joint_targets import STATE, OwnArm, OwnLengths
from truepose.robots import Robot

_SAME_PLACE: Final = 0.02
"""The largest distance [mm] between the positions of two models that count as one."""
_SAME_ARM: Final = 20.0
"""The largest distance [mm] between the positions of two models of one arm."""


@lru_cache(maxsize=256)
def own_robot(arm: OwnArm | OwnLengths, nominal: Robot) -> Robot:
    """Return the controller's arm as a robot, with the limits of the nominal one."""
    if isinstance(arm, OwnLengths):
        pairs = (arm.a, nominal.a), (arm.d, nominal.d)
        a, d = (np.where(np.isnan(own), theirs, np.copysign(own, theirs)) for own, theirs in pairs)
        return replace(nominal, name=f"{nominal.name} of the controller", a=a, d=d)
    return Robot(
        f"{nominal.name} of the controller",
        alpha=np.array(arm.alpha),
        a=np.array(arm.a),
        d=np.array(arm.d),
        offset=np.array(arm.theta),
        limits=nominal.limits,
        convention="dh",
    )


def objections(arm: OwnArm | OwnLengths, nominal: Robot, q: FloatArray, tools: FloatArray) -> dict[int, str]:
    """Return why joints (n, dof) [rad] cannot be corrected, because the two models place the tool apart.

    `tools` (n, 4, 4) [mm] are flange to tool.
    """
    here, there = ((model.forward(q) @ tools)[:, :3, 3] for model in (own_robot(arm, nominal), nominal))
    apart = np.linalg.norm(here - there, axis=1)
    found: dict[int, str] = {}
    for k in np.flatnonzero(apart > _SAME_PLACE).tolist():
        places = f"its kinematics place the tool {apart[k]:.2f} mm from where {nominal.name} does"
        if apart[k] > _SAME_ARM:
            found[k] = f"{places}: it is a program of another robot"
        elif isinstance(arm, OwnArm) and not arm.stated:
            found[k] = f"{places}; {STATE}, or give the map's robot file these parameters"
    return found
