"""The lengths of an arm that grow with its temperature."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.robots import Robot

_SHORTEST: Final = 1.0  # mm, of a length that grows


def growing(robot: Robot) -> FloatArray:
    """Return the twists of growth by 1 per unit of length: of all lengths, then of each, (dof + 1, 6, g) [mm].

    The lengths are those of each link along the axis of the joint before it, and across.
    """
    shift = robot.links(np.eye(4))[:, :3, 3]
    parts = []
    for k, (x, y, z) in enumerate(shift):
        for part in ((x, y, 0.0), (0.0, 0.0, z)):
            if np.linalg.norm(part) > _SHORTEST:
                twist = np.zeros((len(shift), 6))
                twist[k, :3] = part
                parts.append(twist)
    return np.stack([np.sum(parts, axis=0), *parts], axis=2)
