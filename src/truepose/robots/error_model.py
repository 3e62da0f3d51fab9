"""Error models of arms: links as elementary motions, and the derivative of the tool point by each parameter.

    T = L_0 Rz(s_1 q_1) L_1 … Rz(s_n q_n) L_n

Each link L_k is a product of motions: turns about an axis, shifts along one, fixed transforms. A convention
(`truepose.robots.conventions`) defines these motions and their parameters. A parameter moves everything after it by a
twist that is constant in the frame of its link, so the Jacobian of a convention is that of the link frames times one
constant matrix: the chain rule of theory (3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RobotError
from truepose.robots.chain import Chain, ChainT, end_poses
from truepose.robots.conventions import parametrise, parametrise_links
from truepose.robots.convert import mdh_of_fixed
from truepose.robots.jacobian import Outputs, columns, joint_columns
from truepose.robots.motions import Motion, Parameter, cross, local_twists, transform

GROUPS: Final = ("base", "tool")
"""Groups of parameters that every convention has besides those of the links."""

_REMEMBERED: Final = 8

RobotT = TypeVar("RobotT", bound=Chain, covariant=True)


@dataclass(frozen=True, eq=False, repr=False)
class ErrorModel(Generic[RobotT]):
    """An arm in one convention: parameters by name, their nominal values, and the motions that they control.

    Attributes
    ----------
    robot : Robot
        The arm, which gives names, signs and limits.
    convention : str
        The convention of the parameters.
    parameters : tuple of Parameter
        The parameters of the links, then of the base (6) and the tool (6). Those of the base shift and turn the whole
        arm along the base axes; those of the tool act at the tool point, along its axes.
    nominal : (p,) array [mm], [rad]
        The nominal values; zero for base and tool.
    links : tuple of tuples of Motion
        The motions of the dof + 1 links.
    """

    robot: RobotT
    convention: str
    parameters: tuple[Parameter, ...]
    nominal: FloatArray
    links: tuple[tuple[Motion, ...], ...]

    def __repr__(self) -> str:
        groups = ", ".join(dict.fromkeys(parameter.group for parameter in self.parameters))
        return f"<ErrorModel of {self.robot.name}: {self.convention}, {len(self.parameters)} parameters ({groups})>"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def index(self, names: Sequence[str] | None) -> IntArray:
        """Return the indices of parameters, by name or group ("base", "theta"); None means all parameters.

        Raises
        ------
        RobotError
            If a parameter is unknown.
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
                    f"expected a name such as {self.names[0]}, or a group: {groups}"
                )
            found += here
        return np.array(list(dict.fromkeys(found)), dtype=np.intp)

    def fixed(self, values: FloatArray | None = None) -> FloatArray:
        """Return the links, (…, dof + 1, 4, 4) [mm], at values (…, p); at the nominal values when not given."""
        values = self.nominal if values is None else values
        links = []
        for motions in self.links:
            tf: FloatArray = np.broadcast_to(np.eye(4), (*values.shape[:-1], 4, 4))
            for motion in motions:
                tf = tf @ transform(motion, values)
            links.append(tf)
        return np.stack(links, axis=-3)

    @cached_property
    def _turns_tool(self) -> BoolArray:
        return np.array([name in ("tool rx", "tool ry", "tool rz") for name in self.names])

    @cached_property
    def _latest(self) -> dict[tuple[str, bytes], FloatArray]:
        """Links and twists at the latest values: predictions use the same values again and again."""
        return {}

    def _constant(self, make: Callable[[FloatArray], FloatArray], values: FloatArray | None) -> FloatArray:
        """Return `fixed` or `twists` at values (p,), made once for the latest `_REMEMBERED` of them."""
        values = self.nominal if values is None else values
        key, latest = (make.__name__, values.tobytes()), self._latest
        found = latest.get(key)
        if found is None:
            if len(latest) >= _REMEMBERED:
                latest.clear()
            found = make(values)
            found.setflags(write=False)
            latest[key] = found
        return found

    def twists(self, values: FloatArray | None = None) -> FloatArray:
        """Return the twists (v, ω) of the parameters in the frame of each link, (dof + 1, 6, p).

        The frame of link k is that after joint k has turned, the base for k = 0. A point p of the arm beyond the
        parameter moves by v + ω × p, with v in mm per unit of the parameter.
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
        tf = end_poses(self.robot.sign * joints.reshape(-1, self.robot.dof), self._constant(self.fixed, values))
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
            The joint vectors.
        values : (p,) array, optional
            The parameters at which the derivative is taken; the nominal values when not given.
        outputs : {"position", "pose"}
            The rows: mm, or mm and rad (rotation vector in the base frame).
        parameters : sequence of str, optional
            The columns by name or group; all when not given.
        """
        joints = self.robot.check_joints(q).reshape(-1, self.robot.dof)
        fixed = self._constant(self.fixed, values)
        twists = self._constant(self.twists, values)
        wanted = self.index(parameters)
        found = columns(self.robot.sign * joints, fixed, twists[..., wanted], outputs)
        if outputs == "position":  # exactly zero: turns of the tool about its own point
            found[:, :, self._turns_tool[wanted]] = 0.0
        return found

    def joint_jacobian(
        self, q: ArrayLike, values: FloatArray | None = None, *, outputs: Outputs = "position"
    ) -> FloatArray:
        """Return ∂P/∂q_j: (n, 3 or 6, dof) [mm/rad], base frame."""
        joints = self.robot.check_joints(q).reshape(-1, self.robot.dof)
        fixed = self._constant(self.fixed, values)
        return joint_columns(self.robot.sign * joints, fixed, self.robot.sign, outputs)

    def converted(self, convention: str, values: FloatArray | None = None) -> ErrorModel[RobotT]:
        """Return the same arm in another convention; the tool, and the values of base and tool parameters, are kept.

        Raises
        ------
        RobotError
            If the convention is unknown, or cannot describe these axes.
        """
        return ErrorModel(self.robot, convention, *parametrise_links(self.robot, self.fixed(values), convention))

    def to_robot(self, values: FloatArray | None = None) -> RobotT:
        """Return the arm in the parameters of theory (1), its flange at this model's last frame (tool included)."""
        return mdh_of_fixed(replace(self.robot, offset=np.zeros(self.robot.dof)), self.fixed(values))


def error_model(robot: ChainT, convention: str = "hayati", tool: ArrayLike | None = None) -> ErrorModel[ChainT]:
    """Return a robot's error model in a convention.

    Parameters
    ----------
    robot : Robot
        The arm.
    convention : str
        The convention, one of `truepose.robots.CONVENTIONS`.
    tool : (4, 4) array or (3,) array [mm], optional
        tf_flange_tool, or the tool point in the flange frame.

    Raises
    ------
    RobotError
        If the convention is unknown, or cannot describe this robot.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> model = error_model(load_robot("kuka-kr150-2"), tool=[0, 0, 100])
    >>> len(model.names), model.names[:3]
    (42, ('theta1', 'theta2', 'theta3'))
    """
    return ErrorModel(robot, convention, *parametrise(robot, convention, tool))
