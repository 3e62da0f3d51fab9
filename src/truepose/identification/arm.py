"""What is identified: changes x of named parameters of an arm, geometric ones first, then terms of the joints."""

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
    """Return how far a parameter may be from its nominal value, one standard deviation [its unit].

    Links are made to 1 mm and 1 mrad, wide for arms; base and tool are what registration left, to 30 mm and 30 mrad;
    joints deviate by 1 mrad, and by 5 µrad/Nm.
    """
    return (_WIDE if parameter.group in ("base", "tool") else _TOLERANCE)[parameter.unit]


@dataclass(frozen=True, eq=False)
class ParametricArm:
    """An arm whose parameters may change by x: (p,) [mm], [rad].

    Attributes
    ----------
    model : ErrorModel
    active : (g,) int array
        Which of the model's parameters may change.
    terms : JointTerms
        Deviations of the joints beside; none by default.
    """

    model: ErrorModel[Robot]
    active: IntArray
    terms: JointTerms

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
        """Return an arm of a robot.

        Parameters
        ----------
        robot : Robot
        tool : (4, 4) array or (3,) array [mm], optional
            tf_flange_tool.
        convention : str
            See `truepose.robots.CONVENTIONS`.
        parameters : sequence of str, optional
            Geometric parameters, by name or group; all when not given, but for positions without the tool's turns.
        terms : sequence of str
            See `truepose.robots.joint_terms`.
        load, gear_ratio
            For the terms.
        outputs : {"position", "pose"}
            What will be measured.
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
        """Their names."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def nominal(self) -> FloatArray:
        """Their nominal values; zero for terms: (p,)."""
        return np.concatenate([self.model.nominal[self.active], np.zeros(len(self.terms.parameters))])

    @cached_property
    def tolerance(self) -> FloatArray:
        """See `tolerance`: (p,)."""
        return np.array([tolerance(parameter) for parameter in self.parameters])

    def values(self, x: FloatArray) -> FloatArray:
        """Return all values of the model at changes (…, p)."""
        values = np.broadcast_to(self.model.nominal, (*x.shape[:-1], len(self.model.nominal))).copy()
        values[..., self.active] += x[..., : len(self.active)]
        return values

    def joints(self, q: FloatArray, x: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return the angles (n, dof) [rad] that the joints have when q is commanded."""
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
        names = [self.model.names[i] for i in self.active]
        columns = self.model.jacobian(moved, values, outputs=outputs, parameters=names)
        if not self.terms.parameters:
            return columns
        by_joint = self.model.joint_jacobian(moved, values, outputs=outputs)
        return np.concatenate([columns, by_joint[:, :, self.terms.joint] * self._basis(q, approach)], axis=2)

    def poses_of(self, q: FloatArray, many: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return the pose at one q (dof,) of arms that differ by (s, p): (s, 4, 4) [mm]."""
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
