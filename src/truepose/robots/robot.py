"""The robot as users hold it: a chain with its inverse kinematics and error Jacobian as methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.robots.chain import Chain
from truepose.robots.error_model import GROUPS, error_model
from truepose.robots.inverse.branches import inverse
from truepose.robots.jacobian import Outputs


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Chain):
    """A serial arm of revolute joints: nominal parameters, forward and inverse kinematics, error Jacobian.

    Joint i turns by theta_i = sign_i q_i + offset_i about its z axis and contributes, by convention,

    - "mdh", Craig's modified D-H with Hayati's beta, theory (1):
      A_i = Rx(alpha_i) Tx(a_i) Rz(theta_i) Tz(d_i) Ry(beta_i), where alpha_i and a_i are those of Craig's link i-1;
    - "dh", standard D-H: A_i = Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i).

    The flange is at tf_base_first A_1 … A_n tf_last_flange, theory (2).

    Parameters
    ----------
    name : str
        The library name, maker-model in lower case.
    alpha, offset : (dof,) array [rad]
        The twists of the links, and the joint offsets.
    a, d : (dof,) array [mm]
        The lengths of the links, and the offsets along the joint axes.
    beta : (dof,) array [rad], optional
        Hayati's parameters, only with "mdh"; zero when not given.
    sign : (dof,) array of -1 or +1, optional
        The senses of rotation; all +1 when not given.
    limits : (dof, 2) array [rad], optional
        The lower and upper limits of the joints; infinite when not given.
    gear_ratio : (dof,) array, optional
        The motor turns for one turn of each joint, above 0; empty when not known.
    coupling : sequence of (int, int, float), optional
        The couplings of the joints that the controller shows: a row (i, k, f) says that joint i of the model is joint i
        as shown plus f times joint k as shown, joints from 1. Empty where the joints shown are those of the model; by
        default that of the maker, see `truepose.robots.shown_joints`.
    convention : {"mdh", "dh"}
        The convention of the parameters.
    tf_base_first, tf_last_flange : (4, 4) array [mm], optional
        The fixed transforms before the first and after the last A_i; the identity when not given.
    maker, model, source : str
        The maker, the model as printed on the name plate, and the source of the numbers, for display.
    data_sheet : DataSheet, optional
        The reach, repeatability and payload that the maker states.

    Raises
    ------
    RobotError
        If the parameters have wrong shapes or invalid values.

    Examples
    --------
    >>> import numpy as np
    >>> arm = Robot("two-links", alpha=[0, 0], a=[0, 300], d=[0, 0], offset=[0, 0])
    >>> arm.forward(np.deg2rad([[0, 90], [90, 0]]), tool=[200, 0, 0])[:, :3, 3].round(6) + 0.0
    array([[300., 200.,   0.],
           [  0., 500.,   0.]])
    """

    def inverse(self, poses: ArrayLike, tool: ArrayLike | None = None, *, nominal: Chain | None = None) -> FloatArray:
        """Return all branches of the inverse kinematics; see `truepose.robots.inverse.branches.inverse`."""
        return inverse(self, poses, tool, nominal=nominal)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of `error_jacobian`: theta1 …, d1 …, a1 …, alpha1 …, beta1 …, as in theory (1)."""
        kinds = ("theta", "d", "a", "alpha", "beta")
        return tuple(f"{kind}{j}" for kind in kinds for j in range(1, self.dof + 1))

    def error_jacobian(
        self,
        q: ArrayLike,
        outputs: Outputs = "position",
        *,
        tool: ArrayLike | None = None,
        convention: str = "hayati",
        parameters: Sequence[str] | None = None,
    ) -> FloatArray:
        """Return the derivative of the TCP by the kinematic parameters, theory (3), at their nominal values.

        Parameters
        ----------
        q : (dof,) or (n, dof) array [rad]
            The joint vectors.
        outputs : {"position", "pose"}
            The rows: the position [mm], or position and rotation vector [rad], base frame.
        tool : (4, 4) array or (3,) array [mm], optional
            tf_flange_tool, or the TCP in the flange frame.
        convention : str
            The convention of the parameters, one of `truepose.robots.CONVENTIONS`. "hayati" is theory (1), to which
            other chains are converted.
        parameters : sequence of str, optional
            The columns by name or group ("theta", "base", "tool"), in this order. When not given: `parameter_names`, or
            for another convention all but base and tool.

        Returns
        -------
        (3 or 6, p) or (n, 3 or 6, p) array
            The derivative per mm or per rad of each parameter.

        Raises
        ------
        DataError
            As `forward`.
        RobotError
            If a convention or parameter is unknown, or the convention cannot describe this arm.

        Examples
        --------
        >>> arm = Robot("two-links", alpha=[0, 0], a=[0, 300], d=[0, 0], offset=[0, 0])
        >>> arm.error_jacobian([0, 0], tool=[200, 0, 0], parameters=["theta1", "a2"])[:2].round(6) + 0.0
        array([[  0.,   1.],
               [500.,   0.]])
        """
        model = error_model(self, convention, tool)
        if parameters is None:
            parameters = [parameter.name for parameter in model.parameters if parameter.group not in GROUPS]
        found = model.jacobian(q, outputs=outputs, parameters=parameters)
        return found[0] if np.ndim(q) == 1 else found

    def joint_jacobian(
        self, q: ArrayLike, outputs: Outputs = "position", *, tool: ArrayLike | None = None
    ) -> FloatArray:
        """Return the derivative of the TCP by the joints: (3 or 6, dof) or (n, 3 or 6, dof) [mm/rad], base frame.

        Parameters and errors are those of `error_jacobian`.
        """
        found = error_model(self, "poe", tool).joint_jacobian(q, outputs=outputs)
        return found[0] if np.ndim(q) == 1 else found
