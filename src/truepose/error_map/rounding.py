"""The noise that samples have because their numbers were rounded when they were written.

A number that was rounded to a step is off by a uniformly distributed error with the variance step²/12. It is known from
the digits alone, and is no error of the arm.

Joints may have few digits because they were commanded so, and are exact then. That they were rounded is known only if
commanded positions, which have digits of their own, disagree with them: this limits what is believed.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map.arm_check import ArmCheck
from truepose.robots import Robot
from truepose.samples import Samples, decimal_step

_DEGREE: Final = float(np.pi / 180.0)
_INCH: Final = 25.4
_MEDIAN: Final = 1.538  # length of a standard normal vector in space, in the middle


def rounding_variance(robot: Robot, samples: Samples, tf_flange_tool: FloatArray, arm: ArmCheck) -> FloatArray:
    """Return the variance of errors due to rounded readings and joints, (n, 3) [mm²], base frame.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples.
    tf_flange_tool : (4, 4) array [mm]
        The transform from flange to measured point.
    arm : ArmCheck
        The comparison of their joints with their commanded positions.
    """
    of_readings = decimal_step(samples.p_meas, (1.0, _INCH)) ** 2 / 12.0
    variance = np.full((len(samples), 3), of_readings)
    if samples.q is None or samples.p_cmd is None or arm.residual_mm is None:
        return variance
    step = decimal_step(samples.q, (1.0, _DEGREE))
    if not step:
        return variance
    columns = robot.joint_jacobian(samples.q, tool=tf_flange_tool)
    of_joints = np.sum(columns**2, axis=2) * step**2 / 12.0
    of_commands = decimal_step(samples.p_cmd, (1.0, _INCH)) ** 2 / 12.0
    seen = max((arm.residual_mm / _MEDIAN) ** 2 - of_commands, 0.0)
    return np.asarray(variance + of_joints * min(1.0, seen / max(float(of_joints.mean()), np.finfo(float).tiny)))
