"""Nongeometric errors: deviations of each joint's angle as named terms (theory, kinematics).

A term is the deviation of joint j at a configuration, δq_j = c f(q, approach), with one coefficient c to identify. The
columns of the Jacobian are (∂P/∂q_j) f. The model itself is F(q + Σ c f), which is exact for large c as well.

- "compliance q2": f = the torque of gravity about the joint [Nm], c [rad/Nm];
- "sin1 q2", "cos1 q2", "sin2 q2" …: harmonics of the joint's own angle, c [rad] (eccentric gear or encoder);
- "gearsin1 q2", "gearcos1 q2" …: harmonics of the motor's angle, gear ratio times q, c [rad];
- "backlash q2": f = −1, 0, +1, the sign of the joint's last motion, c [rad];
- "thermal a2", "thermal d1" …: growth of a length, f = length × (T − T_ref), c [1/K]. This is not the deviation of a
  joint: see `thermal_columns`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, RobotError
from truepose.geometry.arrays import as_floats
from truepose.robots.chain import Chain
from truepose.robots.error_model import ErrorModel
from truepose.robots.jacobian import Outputs
from truepose.robots.motions import Parameter

GRAVITY: Final = 9.80665  # m/s²
STEEL: Final = 1.2e-5  # 1/K, thermal expansion
UNITS: Final = {
    "compliance": "rad/Nm",
    "sin": "rad",
    "cos": "rad",
    "gearsin": "rad",
    "gearcos": "rad",
    "backlash": "rad",
    "thermal": "1/K",
}
"""The unit of the coefficient of each kind of term."""

_NAME: Final = re.compile(r"(compliance|backlash|(?:gear)?(?:sin|cos)(?P<order>[1-9]\d*))(?: q(?P<joint>[1-9]\d*))?")


@dataclass(frozen=True, eq=False)
class Load:
    """The masses that bend the arm.

    Attributes
    ----------
    payload_kg : float
        The mass of the payload.
    p_flange_payload : (3,) array [mm]
        The centre of mass of the payload, flange frame.
    link_kg : (dof,) array, optional
        The masses of the links, each in the middle between its axis and the next (the flange for the last). When not
        given, they are estimated roughly from the arm's reach; the fitted coefficients absorb most of the error.

    Examples
    --------
    >>> Load(payload_kg=120.0, p_flange_payload=np.array([0.0, 0.0, 200.0])).payload_kg
    120.0
    """

    payload_kg: float = 0.0
    p_flange_payload: FloatArray = field(default_factory=lambda: np.zeros(3))
    link_kg: FloatArray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class JointTerms:
    """Deviations of joints by named terms, linear in their coefficients.

    Attributes
    ----------
    robot : Robot
        The arm.
    parameters : tuple of Parameter
        The coefficients of the k terms.
    joint : (k,) int array
        The joint of each term, from 0.
    load : Load
        The masses for compliance.
    gear_ratio : (dof,) array
        The motor turns for one turn of each joint.
    """

    robot: Chain
    parameters: tuple[Parameter, ...]
    joint: IntArray
    load: Load
    gear_ratio: FloatArray

    def __repr__(self) -> str:
        names = ", ".join(parameter.name for parameter in self.parameters) or "none"
        return f"<JointTerms of {self.robot.name}: {names}>"

    @property
    def needs_approach(self) -> bool:
        """Whether a term requires the approach signs."""
        return any(parameter.group == "backlash" for parameter in self.parameters)

    def basis(self, q: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return f of each term: (n, k), in [rad] over the coefficient's unit.

        Parameters
        ----------
        q : (n, dof) array [rad]
            The joint vectors.
        approach : (n, dof) array of -1, 0, +1, optional
            The signs of the last motion of each joint, required by backlash.

        Raises
        ------
        DataError
            If backlash is among the terms and `approach` is missing.
        """
        if self.needs_approach and approach is None:
            raise DataError("backlash needs the approach signs: -1, 0 or +1 for the last motion of each joint")
        out = np.empty((len(q), len(self.parameters)))
        torque = None
        for k, (parameter, j) in enumerate(zip(self.parameters, self.joint, strict=True)):
            kind = parameter.group.rstrip("0123456789")
            if kind == "compliance":
                torque = gravity_torque(self.robot, q, self.load) if torque is None else torque
                out[:, k] = torque[:, j]
            elif kind == "backlash":
                assert approach is not None
                out[:, k] = approach[:, j]
            else:
                ratio = self.gear_ratio[j] if kind.startswith("gear") else 1.0
                wave = np.sin if kind.endswith("sin") else np.cos
                out[:, k] = wave(int(parameter.group[len(kind) :]) * ratio * q[:, j])
        return out

    def frozen(self, coefficients: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return moment, mass and harmonics of `truepose.numerics.frozen.Constants` at coefficients (k,).

        `basis` times the coefficients is the deviation that these arrays describe; they know no backlash.
        """
        robot, dof, load = self.robot, self.robot.dof, self.load
        newton = np.append(rough_masses(robot) if load.link_kg is None else load.link_kg, load.payload_kg) * GRAVITY
        flange = robot.links(np.eye(4))
        mass = np.concatenate([flange[1:, :3, 3] / 2.0, flange[-1:, :3, 3]])  # in the middle between two joints
        mass[-1] += flange[-1, :3, :3] @ np.asarray(load.p_flange_payload, float)
        moment, harmonics = np.zeros((dof, dof + 1)), []
        for parameter, j, value in zip(self.parameters, self.joint.tolist(), coefficients.tolist(), strict=True):
            kind = parameter.group.rstrip("0123456789")
            if kind == "compliance":
                moment[j, j:] = -value * robot.sign[j] * newton[j:] * 1e-3
            elif kind != "backlash":
                factor = int(parameter.group[len(kind) :]) * (self.gear_ratio[j] if kind.startswith("gear") else 1.0)
                wave = (value, 0.0) if kind.endswith("sin") else (0.0, value)
                harmonics.append((float(j), factor, *wave))
        return moment, mass, np.array(harmonics).reshape(-1, 4)

    def spread(self, per_term: FloatArray) -> FloatArray:
        """Return the sums over each joint of values of terms (…, k): (…, dof)."""
        return np.asarray(per_term @ (self.joint[:, None] == np.arange(self.robot.dof)))

    def jacobian(self, q: FloatArray, by_joint: FloatArray, approach: FloatArray | None = None) -> FloatArray:
        """Return (∂P/∂q_j) f_j of each term: (n, 3 or 6, k), from ∂P/∂q (n, 3 or 6, dof)."""
        return np.asarray(by_joint[:, :, self.joint] * self.basis(q, approach)[:, None, :])


def joint_terms(
    robot: Chain, names: Sequence[str], load: Load | None = None, gear_ratio: ArrayLike | None = None
) -> JointTerms:
    """Return the terms of given names; a name without a joint ("sin1", "compliance") means all joints.

    Parameters
    ----------
    robot : Robot
        The arm.
    names : sequence of str
        The names of the terms.
    load : Load, optional
        The masses for compliance.
    gear_ratio : (dof,) array, optional
        The motor turns for one turn of each joint, for "gearsin" and "gearcos"; default: those of the robot.

    Raises
    ------
    RobotError
        If a term or joint is unknown, or the gear ratios are missing.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> terms = joint_terms(load_robot("kuka-kr150-2"), ["sin1", "backlash q2"])
    >>> [parameter.name for parameter in terms.parameters][-2:]
    ['sin1 q6', 'backlash q2']
    """
    if gear_ratio is None and robot.gear_ratio.size:
        gear_ratio = robot.gear_ratio
    found: dict[str, tuple[Parameter, int]] = {}
    for name in names:
        match = _NAME.fullmatch(name)
        if match is None:
            kinds = 'compliance, backlash, sin1, cos1, gearsin1, gearcos1 (any order), alone or with a joint: "sin1 q2"'
            raise RobotError(f'unknown term "{name}"; expected {kinds}')
        group = match[1]
        kind = group.rstrip("0123456789")
        if kind.startswith("gear") and gear_ratio is None:
            raise RobotError(f'"{name}" needs gear_ratio, the motor turns for one turn of each joint')
        joints = range(robot.dof) if match["joint"] is None else [int(match["joint"]) - 1]
        for j in joints:
            if j >= robot.dof:
                raise RobotError(f'"{name}": {robot.name} has {robot.dof} joints')
            full = f"{group} q{j + 1}"
            found[full] = (Parameter(full, UNITS[kind], group), j)
    ratio = np.ones(robot.dof) if gear_ratio is None else as_floats("gear_ratio", gear_ratio)
    if ratio.shape != (robot.dof,):
        raise RobotError(f"expected gear_ratio of shape ({robot.dof},) for {robot.name}, got {ratio.shape}")
    return JointTerms(
        robot,
        tuple(parameter for parameter, _ in found.values()),
        np.array([j for _, j in found.values()], dtype=np.intp),
        load or Load(),
        ratio,
    )


def gravity_torque(robot: Chain, q: FloatArray, load: Load | None = None) -> FloatArray:
    """Return the torque of gravity about each joint, positive with the joint's own turn: (n, dof) [Nm].

    τ_j = s_j z_j · Σ_m (c_m − p_j) × m g, summed over the masses beyond joint j, with gravity along −z of the base.
    """
    load = load or Load()
    kg = rough_masses(robot) if load.link_kg is None else np.asarray(load.link_kg, float)
    if kg.shape != (robot.dof,):
        raise RobotError(f"expected link_kg of shape ({robot.dof},) for {robot.name}, got {kg.shape}")
    frames = robot.frames(q)
    # the joint's axis: z of the frame before it, moved by the link's constant part
    joints = frames[:, :-1] @ robot.link_before
    flange = frames[:, -1] @ robot.tf_last_flange
    origin = np.concatenate([joints[:, :, :3, 3], flange[:, None, :3, 3]], axis=1)
    middle = (origin[:, :-1] + origin[:, 1:]) / 2.0
    payload = flange[:, :3, 3] + flange[:, :3, :3] @ np.asarray(load.p_flange_payload, float)
    centre = np.concatenate([middle, payload[:, None]], axis=1) * 1e-3  # m
    newton = np.append(kg, load.payload_kg) * GRAVITY
    beyond = np.cumsum((centre * newton[:, None])[:, ::-1], axis=1)[:, ::-1]  # Σ m g c over the masses beyond
    weight = np.cumsum(newton[::-1])[::-1]
    moment_arm = (beyond - weight[:, None] * np.append(origin[:, :-1], origin[:, -1:], axis=1) * 1e-3)[:, :-1]
    axis = robot.sign[:, None] * joints[:, :, :3, 2]
    # z · (r × (0, 0, −1)) = −(z_x r_y − z_y r_x)
    return np.asarray(axis[..., 1] * moment_arm[..., 0] - axis[..., 0] * moment_arm[..., 1])


def rough_masses(robot: Chain) -> FloatArray:
    """Return an estimate of the link masses (dof,) [kg]: 40 kg m^-2.7 reach^2.7, shared by the lengths of the links.

    The exponent matches makers' figures for arms of 0.6 to 3 m reach within a factor of two.
    """
    lengths = np.linalg.norm(robot.fixed[1:, :3, 3], axis=1) + 50.0  # mm; no link is empty
    total = 40.0 * (lengths.sum() * 1e-3) ** 2.7
    return np.asarray(total * lengths / lengths.sum())


def thermal_columns(
    model: ErrorModel[Chain], q: ArrayLike, temperature_difference: ArrayLike, outputs: Outputs = "position"
) -> tuple[tuple[Parameter, ...], FloatArray]:
    """Return the columns of thermal growth: one for each length other than zero, with coefficient c [1/K].

    Parameters
    ----------
    model : ErrorModel
        The arm in a convention.
    q : (n, dof) array [rad]
        The joint vectors.
    temperature_difference : (n,) array [K]
        The differences T − T_ref.
    outputs : {"position", "pose"}
        The rows: position, or position and rotation vector.

    Returns
    -------
    parameters : tuple of Parameter
        The coefficients.
    columns : (n, 3 or 6, k) array
        The derivatives ∂P/∂length × length × (T − T_ref).
    """
    place = [
        i
        for i, parameter in enumerate(model.parameters)
        if parameter.unit == "mm" and parameter.group not in ("base", "tool") and model.nominal[i]
    ]
    grown = tuple(Parameter(f"thermal {model.names[i]}", UNITS["thermal"], "thermal") for i in place)
    difference = as_floats("temperature_difference", temperature_difference)
    names = [model.names[i] for i in place]
    found = model.jacobian(q, outputs=outputs, parameters=names)
    if difference.shape != (len(found),):
        raise DataError(f"expected temperature_difference of shape ({len(found)},), got {difference.shape}")
    return grown, found * model.nominal[place] * difference[:, None, None]
