"""Arms with three parallel axes and a wrist of perpendicular, intersecting axes (Universal Robots): closed form.

With R = Rz(t1) Ry(t2 + t3 + t4) Rz(t5) Ry(t6) and, upright, the wrist point P (axes 5 and 6) at

    P = Rz(t1) [a1 + l2 sin t2 + l3 sin t23 + l5 sin t234,  b,  c1 + l2 cos t2 + l3 cos t23 + l5 cos t234],

t1 follows from the y of P, t5 and t6 from the second row of Rz(-t1) R, t234 from the rest, t2 and t3 from the triangle
of upper arm and forearm. (Own derivation; compare Hawkins 2013, "Analytic inverse kinematics for the Universal
Robots UR-5/UR-10 arms".)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry.transforms import invert_transform, make_transform
from truepose.robots.chain import Chain
from truepose.robots.inverse.axes import SINGULAR, TOUCHING, Axes, shoulder_angle, triangle_angles, turn_y, turn_z


@dataclass(frozen=True)
class ThreeParallel:
    """The dimensions in the formulas above [mm], and the joints in their sense: theta = sign q + offset."""

    a1: float
    b: float
    c1: float
    l2: float
    l3: float
    l5: float
    sign: FloatArray
    offset: FloatArray
    tf_base_root: FloatArray
    tf_wrist_flange: FloatArray

    @classmethod
    def of(cls, robot: Chain) -> ThreeParallel | None:
        """Return the closed form of a robot, or None if it is not such an arm."""
        if robot.dof != 6:
            return None
        axes = Axes.of(robot)
        if not (axes.square(0, 1) and axes.parallel(1, 2) and axes.parallel(1, 3)):
            return None
        if not (axes.square(3, 4) and axes.square(4, 5)):
            return None
        wrist = axes.crossing(4, 5)
        if wrist is None or axes.crossing(3, 4) is None:
            return None
        root = axes.root()
        w, p, wrist = axes.seen_from(root, wrist)
        upper, fore = p[2] - p[1], p[3] - p[2]
        at_2 = np.arctan2(upper[0], upper[2])  # t2, t2 + t3 and t2 + t3 + t4 at q = 0
        at_3 = np.arctan2(fore[0], fore[2])
        at_4 = np.arctan2(w[4, 0], w[4, 2])
        last = w[5] @ turn_y(at_4)
        at_5 = np.arctan2(-last[0], last[1])
        wrist_frame = make_transform(turn_y(at_4) @ turn_z(at_5), wrist)
        arm = cls(
            a1=float(p[1, 0]),
            b=float(wrist[1]),
            c1=float(p[1, 2]),
            l2=float(np.hypot(upper[0], upper[2])),
            l3=float(np.hypot(fore[0], fore[2])),
            l5=float((wrist - p[3]) @ w[4]),
            sign=np.array([np.sign(w[0, 2]), 1.0, np.sign(w[2, 1]), np.sign(w[3, 1]), 1.0, 1.0]),
            offset=np.array([0.0, at_2, at_3 - at_2, at_4 - at_3, at_5, 0.0]),
            tf_base_root=root,
            tf_wrist_flange=invert_transform(root @ wrist_frame) @ axes.tf_base_flange,
        )
        return arm if min(arm.l2, arm.l3) > TOUCHING else None

    def branches(self, tf_base_flange: FloatArray, bent: float | None = None) -> FloatArray:
        """Return the eight branches, (n, 8, 6) [rad], of flange poses (n, 4, 4); slots keep their meaning.

        The slot is 4 · (other shoulder) + 2 · (t5 < 0) + (other elbow). A branch that does not exist is NaN, or with
        `bent` [rad] the joints nearest to the pose with elbow (and shoulder offset) that far from stretched.
        """
        pose = invert_transform(self.tf_base_root) @ tf_base_flange @ invert_transform(self.tf_wrist_flange)
        n = len(pose)
        shoulder, wrist, elbow = (np.array([1.0, -1.0]).reshape(shape) for shape in ((2, 1, 1), (1, 2, 1), (1, 1, 2)))
        pose = pose[:, None, None, None]
        x, y, z = (pose[..., i, 3] for i in range(3))
        t1 = shoulder_angle(x, y, self.b, shoulder, bent)
        m = np.swapaxes(turn_z(t1), -1, -2) @ pose[..., :3, :3]
        sine = np.hypot(m[..., 1, 0], m[..., 1, 2])
        t5 = np.arctan2(wrist * sine, m[..., 1, 1])
        t6 = np.where(sine > SINGULAR, np.arctan2(wrist * m[..., 1, 2], wrist * m[..., 1, 0]), 0.0)
        c6, s6 = np.cos(t6), np.sin(t6)
        t234 = np.arctan2(c6 * m[..., 0, 2] - s6 * m[..., 0, 0], c6 * m[..., 2, 2] - s6 * m[..., 2, 0])
        forward = np.cos(t1) * x + np.sin(t1) * y - self.a1 - self.l5 * np.sin(t234)
        up = z - self.c1 - self.l5 * np.cos(t234)
        t2, t3 = triangle_angles(forward, up, self.l2, self.l3, elbow, bent)
        theta = np.stack(np.broadcast_arrays(t1, t2, t3, t234 - t2 - t3, t5, t6), axis=-1).reshape(n, 8, 6)
        theta[np.isnan(theta).any(axis=-1)] = np.nan
        return np.asarray(self.sign * (theta - self.offset))
