"""A robot as URDF: its joints with their exact origins, also those of a calibrated arm."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from truepose._io.units import MM_PER
from truepose._typing import FloatArray
from truepose.robots.chain import Robot
from truepose.robots.error_model import turn


def robot_to_urdf(robot: Robot) -> str:
    """Return the text of a URDF file (m and rad, all digits); `load_urdf` reads the same arm back.

    Joint i turns about z of its frame, or −z where the robot's sign is −1, so that its zero and sense are the
    controller's.

    Examples
    --------
    >>> arm = Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0])
    >>> print(robot_to_urdf(arm).splitlines()[5].strip())
    <joint name="joint_1" type="continuous">
    """
    origins = robot.fixed.copy()
    origins[:-1] = origins[:-1] @ turn(2, robot.offset)
    names = ["base_link", *(f"link_{j}" for j in range(1, robot.dof + 1)), "tool0"]
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    lines += [f"  <link name={quoteattr(name)}/>" for name in names]
    for j in range(robot.dof):
        lower, upper = robot.limits[j]
        endless = not np.isfinite([lower, upper]).all()
        lines += [
            f'  <joint name="joint_{j + 1}" type="{"continuous" if endless else "revolute"}">',
            *_between(names[j], names[j + 1], origins[j]),
            f'    <axis xyz="0 0 {robot.sign[j]:.0f}"/>',
        ]
        if not endless:
            lines += [f'    <limit lower="{float(lower)!r}" upper="{float(upper)!r}" effort="0" velocity="0"/>']
        lines += ["  </joint>"]
    lines += ['  <joint name="flange" type="fixed">', *_between(names[-2], names[-1], origins[-1]), "  </joint>"]
    return "\n".join([*lines, "</robot>"]) + "\n"


def _between(parent: str, child: str, tf: FloatArray) -> list[str]:
    xyz = " ".join(repr(float(x)) for x in tf[:3, 3] / MM_PER["m"])
    rpy = " ".join(repr(float(x)) for x in _rpy(tf))
    return [
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
    ]


def _rpy(tf: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch, yaw of R = Rz(yaw) Ry(pitch) Rx(roll), exact also where yaw and roll turn about one line."""
    yaw = np.arctan2(tf[1, 0], tf[0, 0])
    rest = turn(2, -yaw) @ tf
    return float(np.arctan2(-rest[1, 2], rest[1, 1])), float(np.arctan2(-rest[2, 0], rest[0, 0])), float(yaw)
