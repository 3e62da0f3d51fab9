"""The one engine under every convention: an arm as elementary motions, and its derivative by each parameter.

    T = L_0 Rz(s_1 q_1) L_1 … Rz(s_n q_n) L_n

Each link L_k is a product of motions: turns about an axis, shifts along one, fixed transforms. A convention
(`truepose.robots.conventions`) says which motions, and which of them are parameters. A parameter moves all that comes
after it by a twist that is constant in the frame of its link, so that a convention's Jacobian is one fixed matrix
behind the Jacobian of the link frames: the chain rule of theory (3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry.arrays import as_floats
from truepose.robots.chain import Robot
from truepose.robots.jacobian import Outputs, columns, joint_columns

Kind = Literal["turn", "shift", "tilt", "fixed"]
GROUPS: Final = ("base", "tool")


class Parameter(NamedTuple):
    """A parameter of an error model.

    Attributes
    ----------
    name : str
        Such as "theta2", "base rz", "sin1 q3".
    unit : str
        "mm", "rad", "rad/Nm", "1/K", or "1".
    group : str
        Its kind without the joint: "theta", "base", "sin1".
    """

    name: str
    unit: str
    group: str


class Motion(NamedTuple):
    """An elementary motion of a link.

    A "turn" about, or "shift" along, coordinate axis `axis` by `factor` times the value of a parameter; a "fixed"
    transform `tf`; or a "tilt", the smallest rotation that takes z to the unit vector b (Zhuang, Roth and Hamano 1992)
    of which two components are parameters and component `axis`, of sign `factor`, is dependent.
    """

    kind: Kind
    axis: int = 0
    parameters: tuple[int, ...] = ()
    factor: float = 1.0
    tf: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """An arm in one convention: parameters by name, their nominal values, and the motions that they drive.

    Attributes
    ----------
    robot : Robot
        Names, signs and limits.
    convention : str
    parameters : tuple of Parameter
        Of the links, then base (6) and tool (6). The base's shift and turn the whole arm about the base origin's axes;
        the tool's act at the tool point, along its axes.
    nominal : (p,) array
        Their values [mm], [rad]; zero for base and tool.
    links : tuple of tuples of Motion
        dof + 1 of them.
    """

    robot: Robot
    convention: str
    parameters: tuple[Parameter, ...]
    nominal: FloatArray
    links: tuple[tuple[Motion, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def index(self, names: Sequence[str] | None) -> IntArray:
        """Return where parameters stand; a group's name ("base", "theta") means all of it, None means all.

        Raises
        ------
        RobotError
            If there is no such parameter.
        """
        if names is None:
            return np.arange(len(self.parameters))
        found: list[int] = []
        for name in [names] if isinstance(names, str) else names:
            here = [i for i, p in enumerate(self.parameters) if name in (p.name, p.group)]
            if not here:
                groups = ", ".join(dict.fromkeys(p.group for p in self.parameters))
                raise RobotError(
                    f'{self.robot.name}: no parameter "{name}" in the convention "{self.convention}"; '
                    f"its groups are {groups}, its names such as {self.names[0]}"
                )
            found += here
        return np.array(list(dict.fromkeys(found)), dtype=np.intp)

    def fixed(self, values: FloatArray | None = None) -> FloatArray:
        """Return the links: (…, dof + 1, 4, 4) [mm] for values (…, p); the nominal ones when not given."""
        values = self.nominal if values is None else values
        links = []
        for motions in self.links:
            tf: FloatArray = np.broadcast_to(np.eye(4), (*values.shape[:-1], 4, 4))
            for motion in motions:
                tf = tf @ _transform(motion, values)
            links.append(tf)
        return np.stack(links, axis=-3)

    @cached_property
    def _nominal_fixed(self) -> FloatArray:
        return self.fixed()

    @cached_property
    def _nominal_twists(self) -> FloatArray:
        return self.twists()

    def twists(self, values: FloatArray | None = None) -> FloatArray:
        """Return what each parameter does, (dof + 1, 6, p): twist (v, ω) in the frame of each link.

        The frame of link k is that after joint k has turned, the base for k = 0; a point p of the arm beyond the
        parameter moves by v + ω × p, the unit of v being mm over that of the parameter.
        """
        values = self.nominal if values is None else values
        out = np.zeros((len(self.links), 6, len(self.parameters)))
        for k, motions in enumerate(self.links):
            tf = np.eye(4)
            for motion in motions:
                for parameter, v, w in _local_twists(motion, values):
                    spin = tf[:3, :3] @ w
                    out[k, :3, parameter] += tf[:3, :3] @ v + _cross(tf[:3, 3], spin)
                    out[k, 3:, parameter] += spin
                tf = tf @ _transform(motion, values)
        return out

    def forward(self, q: ArrayLike, values: FloatArray | None = None) -> FloatArray:
        """Return the pose of the tool point: (n, 4, 4) [mm], base frame, for joints (n, dof) [rad]."""
        return self._arm(values).forward(q)

    def jacobian(
        self,
        q: ArrayLike,
        values: FloatArray | None = None,
        *,
        outputs: Outputs = "position",
        parameters: Sequence[str] | None = None,
    ) -> FloatArray:
        """Return ∂P/∂psi (and the rotation), theory (3): (n, 3 or 6, p), base frame.

        Parameters
        ----------
        q : (n, dof) array [rad]
        values : (p,) array, optional
            Where the derivative is taken; at the nominal values when not given.
        outputs : {"position", "pose"}
            Rows: mm, or mm and rad (rotation vector in the base frame).
        parameters : sequence of str, optional
            Names or groups; all when not given.
        """
        joints = self.robot.check_joints(q).reshape(-1, self.robot.dof)
        fixed = self._nominal_fixed if values is None else self.fixed(values)
        twists = self._nominal_twists if values is None else self.twists(values)
        wanted = self.index(parameters)
        found = columns(self.robot.sign * joints, fixed, twists[..., wanted], outputs)
        if outputs == "position":  # exactly: a turn of the tool about its own point
            found[:, :, np.isin(wanted, self.index(["tool rx", "tool ry", "tool rz"]))] = 0.0
        return found

    def joint_jacobian(
        self, q: ArrayLike, values: FloatArray | None = None, *, outputs: Outputs = "position"
    ) -> FloatArray:
        """Return ∂P/∂q_j: (n, 3 or 6, dof) [mm/rad], base frame."""
        joints = self.robot.check_joints(q).reshape(-1, self.robot.dof)
        fixed = self._nominal_fixed if values is None else self.fixed(values)
        return joint_columns(self.robot.sign * joints, fixed, self.robot.sign, outputs)

    def converted(self, convention: str, values: FloatArray | None = None) -> ErrorModel:
        """Return the same arm in another convention; the tool, and what base and tool parameters said, is kept fixed.

        Raises
        ------
        RobotError
            If there is no such convention, or it cannot describe these axes.
        """
        from truepose.robots.conventions import of_links

        return of_links(self.robot, self.fixed(values), convention)

    def to_robot(self, values: FloatArray | None = None) -> Robot:
        """Return the arm in the parameters of theory (1), its flange at this model's last frame (tool included)."""
        from truepose.robots.convert import mdh_of_fixed

        return mdh_of_fixed(replace(self.robot, offset=np.zeros(self.robot.dof)), self.fixed(values))

    def _arm(self, values: FloatArray | None) -> _Arm:
        return _Arm(self.robot, self._nominal_fixed if values is None else self.fixed(values))


class _Arm(NamedTuple):
    """A robot's joints between other links."""

    robot: Robot
    fixed: FloatArray

    def forward(self, q: ArrayLike) -> FloatArray:
        from truepose.robots.jacobian import end_poses

        joints = self.robot.check_joints(q)
        tf = end_poses(self.robot.sign * joints.reshape(-1, self.robot.dof), self.fixed)
        return tf.reshape(*joints.shape[:-1], 4, 4)


def error_model(robot: Robot, convention: str = "hayati", tool: ArrayLike | None = None) -> ErrorModel:
    """Return a robot's error model in a convention.

    Parameters
    ----------
    robot : Robot
    convention : str
        One of `truepose.robots.CONVENTIONS`.
    tool : (4, 4) array or (3,) array [mm], optional
        tf_flange_tool, or the tool point in the flange frame.

    Raises
    ------
    RobotError
        If there is no such convention, or it cannot describe this robot.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> model = error_model(load_robot("kuka-kr150-2"), tool=[0, 0, 100])
    >>> len(model.names), model.names[:3]
    (42, ('theta1', 'theta2', 'theta3'))
    """
    from truepose.robots.conventions import build

    return build(robot, convention, tool)


def turn(axis: int, angle: FloatArray | float) -> FloatArray:
    """Return rotations about a coordinate axis: (…, 4, 4)."""
    angle = as_floats("angle", angle)
    tf = np.zeros((*angle.shape, 4, 4))
    tf[..., :, :] = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    tf[..., i, i] = tf[..., j, j] = np.cos(angle)
    tf[..., j, i] = np.sin(angle)
    tf[..., i, j] = -tf[..., j, i]
    return tf


def tilt(b: FloatArray) -> FloatArray:
    """Return the smallest rotations that take z to unit vectors b (…, 3): (…, 4, 4). Not defined at b = −z."""
    x, y, z = np.moveaxis(b, -1, 0)
    tf = np.zeros((*b.shape[:-1], 4, 4))
    tf[..., 0, 0], tf[..., 1, 1] = 1.0 - x * x / (1.0 + z), 1.0 - y * y / (1.0 + z)
    tf[..., 0, 1] = tf[..., 1, 0] = -x * y / (1.0 + z)
    tf[..., :3, 2] = b
    tf[..., 2, 0], tf[..., 2, 1] = -x, -y
    tf[..., 3, 3] = 1.0
    return tf


def _transform(motion: Motion, values: FloatArray) -> FloatArray:
    if motion.kind == "fixed":
        assert motion.tf is not None
        return motion.tf
    if motion.kind == "tilt":
        return tilt(_direction(motion, values))
    value = motion.factor * values[..., motion.parameters[0]]
    if motion.kind == "turn":
        return turn(motion.axis, value)
    tf = np.zeros((*value.shape, 4, 4))
    tf[..., :, :] = np.eye(4)
    tf[..., motion.axis, 3] = value
    return tf


def _direction(motion: Motion, values: FloatArray) -> FloatArray:
    free = [i for i in range(3) if i != motion.axis]
    b = np.zeros((*values.shape[:-1], 3))
    b[..., free] = values[..., list(motion.parameters)]
    b[..., motion.axis] = motion.factor * np.sqrt(1.0 - (b**2).sum(axis=-1))
    return b


def _local_twists(motion: Motion, values: FloatArray) -> list[tuple[int, FloatArray, FloatArray]]:
    """Return parameter, v and ω of a motion, in the frame before it."""
    zero = np.zeros(3)
    if motion.kind in ("turn", "shift"):
        unit = motion.factor * np.eye(3)[motion.axis]
        pair = (zero, unit) if motion.kind == "turn" else (unit, zero)
        return [(motion.parameters[0], *pair)]
    if motion.kind == "fixed":
        return []
    b = _direction(motion, values)
    free = [i for i in range(3) if i != motion.axis]
    found = []
    for parameter, i in zip(motion.parameters, free, strict=True):
        db = np.eye(3)[i] - b[i] / b[motion.axis] * np.eye(3)[motion.axis]
        moved = _cross(b, db)
        # the smallest rotation to b does not turn about b on its way from z: ω·b = −z·(b × db) / (1 + b_z)
        found.append((parameter, zero, moved - b * moved[2] / (1.0 + b[2])))
    return found


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b of two vectors; numpy's is made for arrays of them."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])
