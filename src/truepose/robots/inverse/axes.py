"""The joint axes of a chain at q = 0, from which the closed-form inverses derive their lengths and angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry.transforms import apply_transform, invert_transform, make_transform
from truepose.robots.chain import Chain

PARALLEL = 1e-9  # rad
TOUCHING = 1e-6  # mm
SINGULAR = 1e-12  # sine of the middle wrist joint below which the axes of the outer two coincide
_STRETCHED = 1e-12  # cosines that exceed 1 by rounding only: the arm is stretched, not out of reach


@dataclass(frozen=True)
class Axes:
    """Joint axes at q = 0, base frame: unit directions (positive turn) and points on them [mm]; and the flange."""

    direction: FloatArray
    point: FloatArray
    tf_base_flange: FloatArray

    @classmethod
    def of(cls, robot: Chain) -> Axes:
        """Return the axes of a robot."""
        zero = np.zeros(robot.dof)
        # each joint turns about z of the frame before it, moved by the constant part of the link
        joints = robot.frames(zero)[:-1] @ robot.link_before
        return cls(robot.sign[:, None] * joints[:, :3, 2], joints[:, :3, 3], robot.forward(zero))

    def parallel(self, i: int, j: int) -> bool:
        """Whether axes i and j have the same or opposite directions."""
        return bool(np.linalg.norm(np.cross(self.direction[i], self.direction[j])) < PARALLEL)

    def square(self, i: int, j: int) -> bool:
        """Whether axes i and j are at right angles."""
        return bool(abs(self.direction[i] @ self.direction[j]) < PARALLEL)

    def crossing(self, i: int, j: int) -> FloatArray | None:
        """Return the intersection [mm] of axes i and j at right angles, or None if they do not intersect."""
        between = self.point[j] - self.point[i]
        if abs(between @ np.cross(self.direction[i], self.direction[j])) > TOUCHING:
            return None
        return np.asarray(self.point[i] + (between @ self.direction[i]) * self.direction[i])

    def root(self) -> FloatArray:
        """Return a frame on axis 1, tf_base_root [mm]: z along axis 1 and up, y along axis 2, at right angles to it."""
        up = self.direction[0] if self.direction[0, 2] >= 0 else -self.direction[0]
        rotation = np.column_stack([np.cross(self.direction[1], up), self.direction[1], up])
        return make_transform(rotation, self.point[0])

    def seen_from(self, root: FloatArray, p_base: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return directions, points and one more point in the frame tf_base_root."""
        tf_root_base = invert_transform(root)
        seen = (apply_transform(tf_root_base, point) for point in (self.point, p_base))
        return (self.direction @ root[:3, :3], *seen)  # type: ignore[return-value]  # two of them


def shoulder_angle(x: FloatArray, y: FloatArray, b: float, branch: FloatArray, bent: float | None = None) -> FloatArray:
    """Return t1 [rad] that aligns (x, y) [mm] with the side offset b: forward (branch +1) or over the back (-1).

    Where (x, y) is nearer to the axis than b: NaN, or with `bent` [rad] the nearest angle, kept off by that much.
    """
    beside = _arcsin(b / np.maximum(np.hypot(x, y), np.finfo(float).tiny), bent)
    return np.asarray(np.arctan2(y, x) - np.where(branch > 0, beside, np.pi - beside))


def triangle_angles(
    forward: FloatArray, up: FloatArray, upper: float, fore: float, branch: FloatArray, bent: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return shoulder and elbow angle, from upright, of two links that reach (forward, up) [mm].

    Out of reach: NaN, or with `bent` [rad] the nearest angles with an elbow bent by that much.
    """
    cosine = (forward**2 + up**2 - upper**2 - fore**2) / (2 * upper * fore)
    elbow = branch * (np.pi / 2 - _arcsin(cosine, bent))
    shoulder = np.arctan2(forward, up) - np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
    return shoulder, elbow


def _arcsin(value: FloatArray, bent: float | None) -> FloatArray:
    """Return the arc sine, NaN beyond ±1 up to rounding; with `bent` kept off ±pi/2 by that angle."""
    if bent is not None:
        return np.asarray(np.arcsin(np.clip(value, -np.cos(bent), np.cos(bent))))
    inside = np.abs(value) <= 1.0 + _STRETCHED
    return np.asarray(np.arcsin(np.where(inside, np.clip(value, -1.0, 1.0), np.nan)))


def half_turn(angle: FloatArray) -> FloatArray:
    """Wrap angles into [-pi, pi) [rad]."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def turn_y(angle: FloatArray | float) -> FloatArray:
    """Return the rotation about y: (…, 3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack([np.stack(row, axis=-1) for row in ((c, zero, s), (zero, one, zero), (-s, zero, c))], axis=-2)


def turn_z(angle: FloatArray | float) -> FloatArray:
    """Return the rotation about z: (…, 3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack([np.stack(row, axis=-1) for row in ((c, -s, zero), (s, c, zero), (zero, zero, one))], axis=-2)
