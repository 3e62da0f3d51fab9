"""Where the arm of a URDF file stands in the base frame of a cell's arm, and how far its axes are off.

Frames of joints are a matter of convention and the zero of ROS's base is often not the controller's. The lines of the
axes with all joints at zero are a property of the arm; therefore they are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.geometry.transforms import axis_rotation, invert_transform
from truepose.robots import Robot
from truepose.robots.io.visuals import VisibleArm

NOTED_MM, NOTED_DEG = 1.0, 0.1
REFUSED_MM, REFUSED_DEG = 10.0, 1.0
"""The largest differences of axes at zero: beyond the first ones there is a note; beyond the second, another arm."""
_PARALLEL: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Match:
    """An arm of a URDF file in the base frame of a cell's arm.

    Attributes
    ----------
    tf_base_root : (4, 4) array [mm]
        The root link.
    distances : (dof,) array [mm]
        From each joint of the URDF file to the axis of the cell's arm, all joints at zero.
    angles : (dof,) array [rad]
        Between these axes.
    moved : bool
        Whether neither the root nor the link ``base`` is the base of the cell's arm, so that axis 1 gave the place.
    """

    tf_base_root: FloatArray
    distances: FloatArray
    angles: FloatArray
    moved: bool

    @property
    def worst(self) -> float:
        """The largest deviation as a share of what is refused."""
        return float(max(self.distances.max() / REFUSED_MM, np.rad2deg(self.angles.max()) / REFUSED_DEG))

    @property
    def noted(self) -> list[int]:
        """The joints, from 0, whose axes differ by more than a note deserves."""
        beyond = (self.distances > NOTED_MM) | (np.rad2deg(self.angles) > NOTED_DEG)
        return [int(k) for k in np.flatnonzero(beyond)]


def bodies_at_zero(robot: Robot) -> FloatArray:
    """Return the frames of the bodies with all joints at zero, (dof + 1, 4, 4) [mm], base frame; body 0 is the base."""
    poses = [np.eye(4)]
    for link in robot.links(np.eye(4))[:-1]:
        poses.append(poses[-1] @ link)
    return np.array(poses)


def match_arm(robot: Robot, arm: VisibleArm, name: str) -> Match:
    """Return where the arm of a URDF file stands.

    Raises
    ------
    RobotError
        If it is another arm: the number of joints, or axes at zero that differ by more than some mm.
    """
    count = len(arm.tf_root_axes)
    if count != robot.dof:
        title = f"{robot.maker} {robot.model}".strip() or robot.name
        raise RobotError(f"{name}: the arm has {count} turning joints, that of this cell ({title}) has {robot.dof}")
    axes = bodies_at_zero(robot)[1:]
    senses = axes @ np.array([np.diag([1.0, sign, sign, 1.0]) for sign in robot.sign])
    places = [(invert_transform(arm.tf_root_base), False), (np.eye(4), False)]
    places += [(place, True) for place in _along_first_axis(senses, arm.tf_root_axes)]
    found = [Match(place, *_deviations(axes, place @ arm.tf_root_axes), moved) for place, moved in places]
    best = next((one for one in found if not one.noted), min(found, key=lambda one: one.worst))
    if best.worst > 1.0:
        lengths = zip(best.distances, np.rad2deg(best.angles), strict=True)
        listed = "; ".join(f"joint {k}: {mm:.1f} mm, {deg:.1f}°" for k, (mm, deg) in enumerate(lengths, start=1))
        raise RobotError(
            f"{name}: the axes of the arm are not those of this cell's arm, all joints at zero ({listed}; at most "
            f"{REFUSED_MM:g} mm and {REFUSED_DEG:g}° are accepted); upload the URDF of this arm, with its zero"
        )
    return best


def _deviations(axes: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances of origins from lines, and the angles between lines without direction."""
    z, p = axes[:, :3, 2], others[:, :3, 3] - axes[:, :3, 3]
    across = np.linalg.norm(np.cross(z, others[:, :3, 2]), axis=1)
    along = np.abs(np.einsum("ij,ij->i", z, others[:, :3, 2]))
    return np.linalg.norm(np.cross(z, p), axis=1), np.arctan2(across, along)


def _along_first_axis(axes: FloatArray, others: FloatArray) -> list[FloatArray]:
    """Return the two transforms that put axis 1 and the first axis that is not parallel to it onto those of the arm."""
    here, there = _canonical(axes), _canonical(others)
    if here is None or there is None:
        return []
    return [here @ axis_rotation(2, turn) @ invert_transform(there) for turn in (0.0, np.pi)]


def _canonical(axes: FloatArray) -> FloatArray | None:
    """Return the frame on axis 1 at the common normal with the next axis that is not parallel, x along that normal."""
    z, p = axes[0, :3, 2], axes[0, :3, 3]
    for other in axes[1:]:
        normal = np.cross(z, other[:3, 2])
        length = float(np.linalg.norm(normal))
        if length > _PARALLEL:
            x = normal / length
            # the plane of the other axis and the normal cuts axis 1
            plane = np.cross(other[:3, 2], x)
            tf = np.eye(4)
            tf[:3, :3] = np.column_stack([x, np.cross(z, x), z])
            tf[:3, 3] = p + z * ((other[:3, 3] - p) @ plane) / (z @ plane)
            return tf
    return None
