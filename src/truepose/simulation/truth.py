"""The true motion of a virtual robot: the real arm at the real angles of its joints (theory, kinematics and §7)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.robots import Robot
from truepose.robots.nongeometric import Load, gravity_torque, rough_masses
from truepose.simulation.presets import EFFECTS, Preset
from truepose.simulation.troubles import Troubles

_ORDERS: Final = 48
_PAYLOAD_CENTRE_STD: Final = 5.0  # mm
COLD: Final = 20.0
"""The temperature [°C] at which the lengths are those of the true robot."""


@dataclass(frozen=True, eq=False)
class JointCurves:
    """The errors of each joint's angle as functions of this angle: f_j(q) = Σ_k a_jk sin(m_jk q) + b_jk cos(m_jk q).

    Attributes
    ----------
    order : (dof, k) array
        The orders m: 1, 2, … for errors that repeat with the joint, the gear ratio for those of the motor.
    sine, cosine : (dof, k) array [rad]
        The coefficients a and b.
    """

    order: FloatArray
    sine: FloatArray
    cosine: FloatArray

    def __call__(self, q: FloatArray) -> FloatArray:
        """Return f_j(q_j), (n, dof) [rad], of joint vectors (n, dof) [rad]."""
        angle = q[..., None] * self.order
        return np.asarray((self.sine * np.sin(angle) + self.cosine * np.cos(angle)).sum(axis=-1))

    def __add__(self, other: JointCurves) -> JointCurves:
        pairs = ((self.order, other.order), (self.sine, other.sine), (self.cosine, other.cosine))
        return JointCurves(*(np.concatenate(pair, axis=1) for pair in pairs))

    def __mul__(self, factor: float) -> JointCurves:
        return JointCurves(self.order, factor * self.sine, factor * self.cosine)

    @classmethod
    def waves(cls, order: ArrayLike, amplitude: FloatArray, rng: np.random.Generator) -> JointCurves:
        """Return Σ_k amplitude_k sin(order_k q + phase_k) with random phases; amplitudes (dof, k) [rad]."""
        phase = rng.uniform(0.0, 2.0 * np.pi, amplitude.shape)
        order = np.broadcast_to(np.asarray(order, dtype=np.float64), amplitude.shape)
        return cls(order, amplitude * np.cos(phase), amplitude * np.sin(phase))

    @classmethod
    def smooth(cls, std: FloatArray, length: FloatArray, rng: np.random.Generator) -> JointCurves:
        """Return random functions on the circle with a Matérn 3/2 spectrum, of std and correlation length (dof,) [rad].

        Rasmussen and Williams 2006, (4.15) in one dimension: S(m) ∝ (3/ℓ² + m²)⁻².
        """
        order = np.arange(1.0, _ORDERS + 1.0)
        spectrum = (3.0 / length[:, None] ** 2 + order**2) ** -2.0
        scale = std[:, None] * np.sqrt(spectrum / spectrum.sum(axis=1, keepdims=True))
        return cls(np.broadcast_to(order, scale.shape), *(scale * rng.normal(size=(2, *scale.shape))))


@dataclass(frozen=True, eq=False)
class Conditions:
    """The conditions of a measurement in addition to the joints.

    Attributes
    ----------
    approach : (n, dof) array of -1, 0, +1
        The sign of each joint's last motion.
    payload_kg : (n,) array
        The mass on the flange.
    time : (n,) array [s]
        The time after a cold start.
    warm_up_kelvin, warm_up_s : float
        The final rise of temperature, and its time constant.
    """

    approach: FloatArray
    payload_kg: FloatArray
    time: FloatArray
    warm_up_kelvin: float
    warm_up_s: float

    @property
    def temperature(self) -> FloatArray:
        """The temperature of the arm, (n,) [°C]."""
        return np.asarray(COLD + self.warm_up_kelvin * -np.expm1(-self.time / self.warm_up_s))


@dataclass(frozen=True, eq=False)
class Truth:
    """The true properties of a virtual cell, which its user does not know.

    Attributes
    ----------
    robot : Robot
        The real arm, cold and without load.
    tf_flange_tool : (4, 4) array [mm]
        The real tool.
    tf_base_tracker : (4, 4) array [mm]
        The tracker's station.
    joint_error : JointCurves
        The errors of the joint angles from harmonics and transmission, a function of joint vectors.
    ripple : JointCurves
        The errors that repeat with each turn of the motors: too fast to be learned from some hundred poses.
    compliance : (dof,) array [rad/Nm]
        The rotation of each joint per torque of gravity.
    link_kg, p_flange_payload : (dof,) array, (3,) array [mm]
        The masses of the links, and the centre of mass of the payload.
    backlash : (dof,) array [rad]
        The mean lost motion; a joint lags by half of the lost motion in its direction of approach.
    backlash_wave : JointCurves
        The change of the lost motion with the angle, as a share of the mean; a function of joint vectors.
    expansion : (dof,) array [1/K]
        The thermal expansion of the lengths a and d of each link.
    troubles : Troubles
        The further faults; none in the presets paper, hard and ideal.
    seed : int
        The seed of all random values.
    """

    robot: Robot
    tf_flange_tool: FloatArray
    tf_base_tracker: FloatArray
    joint_error: JointCurves
    ripple: JointCurves
    compliance: FloatArray
    link_kg: FloatArray
    p_flange_payload: FloatArray
    backlash: FloatArray
    backlash_wave: JointCurves
    expansion: FloatArray
    troubles: Troubles
    seed: int

    def joints(self, q: FloatArray, conditions: Conditions) -> FloatArray:
        """Return the real joint angles (n, dof) [rad] at commanded joints (n, dof) [rad]."""
        loads, which = np.unique(conditions.payload_kg, return_inverse=True)
        torque = np.empty_like(q)
        for k, kg in enumerate(loads):
            rows = which == k
            torque[rows] = gravity_torque(self.robot, q[rows], Load(float(kg), self.p_flange_payload, self.link_kg))
        lag = 0.5 * self.backlash * (1.0 + self.backlash_wave(q)) * conditions.approach
        usual = q + self.joint_error(q) + self.ripple(q) + self.compliance * torque - lag
        return np.asarray(usual + self.troubles.joint_steps(q))

    def forward(self, q: FloatArray, conditions: Conditions) -> FloatArray:
        """Return the true poses of the tool without noise, (n, 4, 4) [mm], base frame.

        Positions are linear in the lengths, so the growth per kelvin times the temperature difference is exact.
        """
        joints = self.joints(q, conditions)
        tf = self.robot.forward(joints, tool=self.tf_flange_tool)
        if self.expansion.any():
            grown = 1.0 + self.expansion
            warm = replace(self.robot, a=self.robot.a * grown, d=self.robot.d * grown)
            per_kelvin = warm.forward(joints, tool=self.tf_flange_tool)[:, :3, 3] - tf[:, :3, 3]
            tf[:, :3, 3] += (conditions.temperature - COLD)[:, None] * per_kelvin
        return self.troubles.tilted(tf)


def draw_joints(preset: Preset, robot: Robot, effects: Collection[str], rng: np.random.Generator) -> dict[str, Any]:
    """Draw the errors of joints and lengths of `Truth`; those switched off are drawn as well, and set to zero."""
    dof = robot.dof
    on = {name: float(name in effects) for name in EFFECTS}
    stiff, soft = preset.compliance
    low, high = np.array([stiff] * min(3, dof) + [soft] * max(dof - 3, 0)).T
    harmonics = JointCurves.waves([1, 2], rng.uniform(*preset.harmonic, (dof, 2)), rng)
    transmission = JointCurves.smooth(
        rng.uniform(*preset.transmission, dof), rng.uniform(*preset.transmission_length, dof), rng
    )
    gear_ratio = rng.uniform(*preset.gear_ratio, (dof, 1)).round()
    gear_ratio = robot.gear_ratio[:, None] if robot.gear_ratio.size else gear_ratio
    wave_rng = rng.spawn(1)[0]  # drawn apart: other values stay as they are
    ripple = JointCurves.waves(gear_ratio, rng.uniform(*preset.ripple, (dof, 1)), rng)
    return {
        "ripple": ripple * on["ripple"],
        "joint_error": harmonics * on["harmonics"] + transmission * on["transmission"],
        "compliance": rng.uniform(low, high) * on["compliance"],
        "link_kg": rough_masses(robot) * rng.uniform(*preset.own_weight, size=dof),
        "p_flange_payload": np.asarray(preset.payload_mm) + rng.normal(scale=_PAYLOAD_CENTRE_STD, size=3),
        "backlash": rng.uniform(*preset.backlash, size=dof) * on["backlash"],
        "backlash_wave": JointCurves.waves([1], wave_rng.uniform(*preset.backlash_wave, (dof, 1)), wave_rng),
        "expansion": rng.uniform(*preset.expansion, size=dof) * on["thermal"],
    }
