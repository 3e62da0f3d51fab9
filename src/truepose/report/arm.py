"""The arm as rods, for pictures."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap


def rods(error_map: ErrorMap) -> FloatArray | None:
    """Return the joints' origins from the base to the measured point (m, 3) [mm], base frame.

    The pose is that of the sample nearest to the middle of the work region. None for samples without joints.
    """
    q = error_map.samples.q
    if q is None:
        return None
    middle = (error_map.p_cmd.min(axis=0) + error_map.p_cmd.max(axis=0)) / 2
    nearest = q[int(np.argmin(np.linalg.norm(error_map.p_cmd - middle, axis=1)))]
    robot = error_map.robot
    ends = (robot.forward(nearest)[:3, 3], robot.forward(nearest, tool=error_map.tf_flange_tool)[:3, 3])
    points = np.vstack([np.zeros(3), robot.frames(nearest)[:, :3, 3], *ends])
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
    return np.asarray(points[np.r_[True, apart]])
