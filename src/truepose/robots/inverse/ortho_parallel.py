"""Arms with a parallel base pair and a spherical wrist: eight branches in closed form.

The symbols are those of Brandstötter, Angerer and Hofbaur (2014), "An analytical solution of the inverse kinematics
problem of industrial serial manipulators with an ortho-parallel basis and a spherical wrist":

    R = Rz(t1) Ry(t2 + t3) Rz(t4) Ry(t5) Rz(t6), and the wrist centre at
    P = Rz(t1) [a1 + c2 sin t2 + k sin(t23 + psi),  b,  c1 + c2 cos t2 + k cos(t23 + psi)],

with k and psi the length and angle of (a2, c3). t1 follows from the y of P, t2 and t3 from the triangle of upper arm
and forearm, the wrist from the rest of R. Each angle is computed from those before it, so that rounding cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.geometry.transforms import invert_transform, make_transform
from truepose.robots.chain import Chain
from truepose.robots.inverse.axes import (
    SINGULAR,
    TOUCHING,
    Axes,
    half_turn,
    shoulder_angle,
    triangle_angles,
    turn_y,
    turn_z,
)


@dataclass(frozen=True)
class OrthoParallel:
    """The dimensions of an ortho-parallel arm [mm], and its joints in the paper's sense: theta = sign q + offset.

    Upright (theta = 0) the base pair turns about z and y, the upper arm c2 and the forearm c3 point up, and the wrist
    centre lies a1 + a2 in front of axis 1 and b beside it.
    """

    a1: float
    a2: float
    b: float
    c1: float
    c2: float
    c3: float
    sign: FloatArray
    offset: FloatArray
    tf_base_root: FloatArray
    tf_wrist_flange: FloatArray

    @classmethod
    def of(cls, robot: Chain) -> OrthoParallel | None:
        """Return the closed form of a robot, or None if it is not an ortho-parallel arm."""
        if robot.dof != 6:
            return None
        axes = Axes.of(robot)
        w, p = axes.direction, axes.point
        if not (axes.square(0, 1) and axes.parallel(1, 2) and axes.square(2, 3)):
            return None
        if not (axes.square(3, 4) and axes.square(4, 5)):
            return None
        wrist_base, same = axes.crossing(3, 4), axes.crossing(4, 5)
        if wrist_base is None or same is None or np.linalg.norm(wrist_base - same) > TOUCHING:
            return None
        root = axes.root()
        w, p, wrist = axes.seen_from(root, wrist_base)
        sign = np.array([np.sign(w[0, 2]), 1.0, np.sign(w[2, 1]), 1.0, 1.0, 1.0])
        upper = p[2] - p[1]
        offset_2 = np.arctan2(upper[0], upper[2])
        forearm, side = wrist - p[2], np.sign((wrist - p[2]) @ w[3]) or 1.0
        sign[3] = side
        tilt = np.arctan2(side * w[3, 0], side * w[3, 2])  # theta_2 + theta_3 at q = 0
        across = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
        in_forearm = w[4] @ turn_y(tilt)
        offset_4 = np.arctan2(-in_forearm[0], in_forearm[1])
        before_5 = turn_y(tilt) @ turn_z(offset_4)
        # axis 6 points from the wrist to the flange
        sign[5] = -1.0 if axes.direction[5] @ (axes.tf_base_flange[:3, 3] - wrist_base) < 0 else 1.0
        last = sign[5] * w[5] @ before_5
        offset_5 = np.arctan2(last[0], last[2])
        wrist_frame = make_transform(before_5 @ turn_y(offset_5), wrist)
        arm = cls(
            a1=float(p[1, 0]),
            a2=float(forearm @ across),
            b=float(wrist[1]),
            c1=float(p[1, 2]),
            c2=float(np.hypot(upper[0], upper[2])),
            c3=float(side * (forearm @ w[3])),
            sign=sign,
            offset=np.array([0.0, offset_2, tilt - offset_2, offset_4, offset_5, 0.0]),
            tf_base_root=root,
            tf_wrist_flange=invert_transform(root @ wrist_frame) @ axes.tf_base_flange,
        )
        return arm if min(arm.c2, arm.c3) > TOUCHING else None

    @property
    def elbow_angle(self) -> float:
        """The angle t3 at which upper arm and wrist centre are in line, atan2(-a2, c3) = -psi [rad]: KUKA's phi."""
        return float(np.arctan2(-self.a2, self.c3))

    @property
    def reach(self) -> float:
        """The length of the forearm with its offset, k [mm]."""
        return float(np.hypot(self.a2, self.c3))

    def slot(self, q: FloatArray) -> IntArray:
        """Return the slots of `branches` of joints (…, 6) [rad]: (…)."""
        _, t2, t3, _, t5, _ = np.moveaxis(self.sign * q + self.offset, -1, 0)
        elbow = t3 - self.elbow_angle
        x = self.a1 + self.c2 * np.sin(t2) + self.reach * np.sin(t2 + elbow)
        return np.asarray(4 * (x < 0) + 2 * (half_turn(elbow) < 0) + (half_turn(t5) < 0), dtype=np.int64)

    def branches(self, tf_base_flange: FloatArray, bent: float | None = None) -> FloatArray:
        """Return the eight branches, (n, 8, 6) [rad], of flange poses (n, 4, 4); slots keep their meaning.

        The slot is 4 · (reaching back) + 2 · (t3 + psi < 0) + (t5 < 0). A branch that does not exist is NaN, or with
        `bent` [rad] the joints nearest to the pose with elbow (and shoulder offset) that far from stretched.
        """
        pose = invert_transform(self.tf_base_root) @ tf_base_flange @ invert_transform(self.tf_wrist_flange)
        n = len(pose)
        back, elbow, flip = (np.array([1.0, -1.0]).reshape(shape) for shape in ((2, 1, 1), (1, 2, 1), (1, 1, 2)))
        pose = pose[:, None, None, None]
        x, y, z = (pose[..., i, 3] for i in range(3))
        t1 = shoulder_angle(x, y, self.b, back, bent)
        forward = np.cos(t1) * x + np.sin(t1) * y - self.a1
        t2, at_elbow = triangle_angles(forward, z - self.c1, self.c2, self.reach, elbow, bent)
        t3 = at_elbow + self.elbow_angle
        m = np.swapaxes(turn_z(t1) @ turn_y(t2 + t3), -1, -2) @ pose[..., :3, :3]
        sine = np.hypot(m[..., 0, 2], m[..., 1, 2])
        t4 = np.where(sine > SINGULAR, np.arctan2(flip * m[..., 1, 2], flip * m[..., 0, 2]), 0.0)
        t5 = np.arctan2(flip * sine, m[..., 2, 2])
        c4, s4 = np.cos(t4), np.sin(t4)
        t6 = np.arctan2(c4 * m[..., 1, 0] - s4 * m[..., 0, 0], c4 * m[..., 1, 1] - s4 * m[..., 0, 1])
        theta = np.stack(np.broadcast_arrays(t1, t2, t3, t4, t5, t6), axis=-1).reshape(n, 8, 6)
        theta[np.isnan(theta).any(axis=-1)] = np.nan
        return np.asarray(self.sign * (theta - self.offset))
