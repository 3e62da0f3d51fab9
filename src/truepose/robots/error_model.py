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
from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import RobotError
from truepose.robots.chain import Chain, ChainT, end_poses
from truepose.robots.conventions import parametrise, parametrise_links
from truepose.robots.convert import mdh_of_fixed
from truepose.robots.jacobian import Outputs, columns, joint_columns
from truepose.robots.motions import Motion, Parameter, cross, local_twists, transform

GROUPS: Final = ("base", "tool")
"""Groups of parameters that every convention has besides those of the links."""

RobotT = TypeVar("RobotT", bound=Chain, covariant=True)


@dataclass(frozen=True, eq=False)
class ErrorModel(Generic[RobotT]):
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

    robot: RobotT
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
                tf = tf @ transform(motion, values)
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
                for parameter, v, w in local_twists(motion, values):
                    spin = tf[:3, :3] @ w
                    out[k, :3, parameter] += tf[:3, :3] @ v + cross(tf[:3, 3], spin)
                    out[k, 3:, parameter] += spin
                tf = tf @ transform(motion, values)
        return out

    def forward(self, q: ArrayLike, values: FloatArray | None = None) -> FloatArray:
        """Return the pose of the tool point: (n, 4, 4) [mm], base frame, for joints (n, dof) [rad]."""
        joints = self.robot.check_joints(q)
        tf = end_poses(self.robot.sign * joints.reshape(-1, self.robot.dof), self._fixed_at(values))
        return tf.reshape(*joints.shape[:-1], 4, 4)

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
        fixed = self._fixed_at(values)
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
        fixed = self._fixed_at(values)
        return joint_columns(self.robot.sign * joints, fixed, self.robot.sign, outputs)

    def converted(self, convention: str, values: FloatArray | None = None) -> ErrorModel[RobotT]:
        """Return the same arm in another convention; the tool, and the values of base and tool parameters, are kept.

        Raises
        ------
        RobotError
            If there is no such convention, or it cannot describe these axes.
        """
        return ErrorModel(self.robot, convention, *parametrise_links(self.robot, self.fixed(values), convention))

    def to_robot(self, values: FloatArray | None = None) -> RobotT:
        """Return the arm in the parameters of theory (1), its flange at this model's last frame (tool included)."""
        return mdh_of_fixed(replace(self.robot, offset=np.zeros(self.robot.dof)), self.fixed(values))

    def _fixed_at(self, values: FloatArray | None) -> FloatArray:
        return self._nominal_fixed if values is None else self.fixed(values)


def error_model(robot: ChainT, convention: str = "hayati", tool: ArrayLike | None = None) -> ErrorModel[ChainT]:
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
    return ErrorModel(robot, convention, *parametrise(robot, convention, tool))
