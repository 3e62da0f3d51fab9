"""The parameters to identify: changes x of named parameters of an arm, geometric ones first, then joint terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.geometry.transforms import axis_rotation
from truepose.robots import ErrorModel, JointTerms, Load, Parameter, Robot, error_model, joint_terms
from truepose.robots.jacobian import Outputs

_TOLERANCE: Final = {"mm": 1.0, "rad": 1e-3, "1": 1e-3, "rad/Nm": 5e-6}
_WIDE: Final = {"mm": 30.0, "rad": 3e-2}


def tolerance(parameter: Parameter) -> float:
    """Return the standard deviation of a parameter about its nominal value, in the unit of the parameter.

    Links are taken to be accurate to 1 mm and 1 mrad, which is wide for arms. Base and tool, which registration has
    already fitted, have 30 mm and 30 mrad. Joint terms have 1 mrad and 5 µrad/Nm.

    Examples
    --------
    >>> tolerance(Parameter("a2", "mm", "a"))
    1.0
    """
    return (_WIDE if parameter.group in ("base", "tool") else _TOLERANCE)[parameter.unit]


@dataclass(frozen=True, eq=False, repr=False)
class ParametricArm:
    """An arm whose parameters change by x: (p,) [mm], [rad].

    Attributes
    ----------
    model : ErrorModel
        The geometry.
    active : (g,) int array
        The indices of the model's parameters that may change.
    terms : JointTerms
        The deviations of the joints; none by default.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> ParametricArm.of(load_robot("kuka-kr150-2"), parameters=["theta", "d3"], terms=["sin1 q2"])
    <ParametricArm of kuka-kr150-2: hayati, 8 parameters (theta, d, sin1)>
    """

    model: ErrorModel[Robot]
    active: IntArray
    terms: JointTerms

    def __repr__(self) -> str:
        groups = ", ".join(dict.fromkeys(parameter.group for parameter in self.parameters))
        name, count = self.model.robot.name, len(self.parameters)
        return f"<ParametricArm of {name}: {self.model.convention}, {count} parameters ({groups})>"

    @classmethod
    def of(
        cls,
        robot: Robot,
        tool: ArrayLike | None = None,
        *,
        convention: str = "hayati",
        parameters: Sequence[str] | None = None,
        terms: Sequence[str] = (),
        load: Load | None = None,
        gear_ratio: ArrayLike | None = None,
        outputs: Outputs = "position",
    ) -> ParametricArm:
        """Return the arm of a robot with selected parameters.

        Parameters
        ----------
        robot : Robot
            The arm.
        tool : (4, 4) array or (3,) array [mm], optional
            tf_flange_tool, or the TCP's position in the flange frame.
        convention : str
            The convention, one of `truepose.robots.CONVENTIONS`.
        parameters : sequence of str, optional
            The geometric parameters by name or group. When not given: all, or for positions all but the rotations of
            the tool.
        terms : sequence of str
            The joint terms, see `truepose.robots.joint_terms`.
        load : Load, optional
            The masses for compliance.
        gear_ratio : (dof,) array, optional
            The motor turns for one turn of each joint; default: those of the robot.
        outputs : {"position", "pose"}
            The measured quantity.

        Raises
        ------
        RobotError
            If a convention, parameter or term is unknown.
        """
        model = error_model(robot, convention, tool)
        active = model.index(parameters)
        if parameters is None and outputs == "position":
            active = np.setdiff1d(active, model.index(["tool rx", "tool ry", "tool rz"]))
        return cls(model, active, joint_terms(robot, terms, load, gear_ratio))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in the order of x."""
        return (*(self.model.parameters[i] for i in self.active), *self.terms.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def nominal(self) -> FloatArray:
        """The nominal values of the parameters; zero for terms: (p,)."""
        return np.concatenate([self.model.nominal[self.active], np.zeros(len(self.terms.parameters))])

    @cached_property
    def tolerance(self) -> FloatArray:
        """The standard deviations of the parameters, see `tolerance`: (p,)."""
        return np.array([tolerance(parameter) for parameter in self.parameters])

    def values(self, x: FloatArray) -> FloatArray:
        """Return all values of the model at changes (…, p)."""
        values = np.broadcast_to(self.model.nominal, (*x.shape[:-1], len(self.model.nominal))).copy()
        values[..., self.active] += x[..., : len(self.active)]
        return values

    def joints(self, q: FloatArray, x: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return the actual joint angles (n, dof) [rad] at commanded joints q."""
        if not self.terms.parameters:
            return q
        return q + self.terms.spread(self.terms.basis(q, approach) * x[len(self.active) :])

    def pose(self, q: FloatArray, x: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return the tool point's poses (n, 4, 4) [mm], base frame."""
        return self.model.forward(self.joints(q, x, approach), self.values(x))

    def jacobian(
        self, q: FloatArray, x: FloatArray, approach: FloatArray | None = None, outputs: Outputs = "position"
    ) -> FloatArray:
        """Return the derivative of positions (and rotation vectors) by x: (n, 3 or 6, p), base frame."""
        moved, values = self.joints(q, x, approach), self.values(x)
        columns = self.model.jacobian(moved, values, outputs=outputs)[:, :, self.active]
        if not self.terms.parameters:
            return columns
        by_joint = self.model.joint_jacobian(moved, values, outputs=outputs)
        return np.concatenate([columns, by_joint[:, :, self.terms.joint] * self._basis(q, approach)], axis=2)

    def poses_of(self, q: FloatArray, many: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return the poses at one q (dof,) of arms with different changes (s, p): (s, 4, 4) [mm]."""
        fixed = self.model.fixed(self.values(many))
        joints = np.broadcast_to(q, (len(many), len(q)))
        if self.terms.parameters:
            basis = self.terms.basis(q[None], None if approach is None else approach[None])
            joints = joints + self.terms.spread(basis * many[:, len(self.active) :])
        tf = fixed[:, 0]
        for k, sign in enumerate(self.model.robot.sign):
            tf = tf @ axis_rotation(2, sign * joints[:, k]) @ fixed[:, k + 1]
        return np.asarray(tf)

    def _basis(self, q: FloatArray, approach: FloatArray | None) -> FloatArray:
        return self.terms.basis(q, approach)[:, None, :]
