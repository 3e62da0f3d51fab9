"""Faults of a cell in addition to the usual errors: a damaged joint, a tilting pedestal, a creeping station."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.simulation.presets import Preset


@dataclass(frozen=True, eq=False)
class Troubles:
    """The faults of a virtual cell; each is zero when it is switched off.

    Attributes
    ----------
    step : (dof,) array [rad]
        The jump of each joint's offset; zero for all joints but one.
    step_at : (dof,) array [rad]
        The angle of each joint at which its offset jumps.
    tilt_per_mm : (2,) array [rad/mm]
        The tilt of the pedestal along x and y of the base frame, per extension of the arm along x and y.
    creep : (3,) array [mm]
        The displacement of the tracker's station during a campaign, tracker frame.
    """

    step: FloatArray
    step_at: FloatArray
    tilt_per_mm: FloatArray
    creep: FloatArray

    def joint_steps(self, q: FloatArray) -> FloatArray:
        """Return the jumps of the offsets at configurations (n, dof) [rad], (n, dof) [rad]."""
        return np.where(q > self.step_at, self.step, 0.0)

    def tilted(self, tf: FloatArray) -> FloatArray:
        """Return the poses (n, 4, 4) [mm] of an arm whose pedestal tilts about the base origin towards the tool."""
        if not self.tilt_per_mm.any():
            return tf
        tilt_x, tilt_y = (self.tilt_per_mm * tf[:, :2, 3]).T
        turn = Rotation.from_rotvec(np.stack([-tilt_y, tilt_x, np.zeros(len(tf))], axis=1)).as_matrix()
        tilted = tf.copy()
        tilted[:, :3] = turn @ tf[:, :3]
        return tilted

    def drift(self, time: FloatArray) -> FloatArray:
        """Return the errors of readings at times (n,) [s] due to creep of the station, (n, 3) [mm], tracker frame.

        The creep is linear in time, and zero halfway between the first and the last reading.
        """
        share = (time - time.min(initial=np.inf)) / max(np.ptp(time), np.finfo(float).tiny)
        return np.asarray((share[:, None] - 0.5) * self.creep)


def draw_troubles(preset: Preset, dof: int, effects: Collection[str], rng: np.random.Generator) -> Troubles:
    """Draw the faults of a cell; those switched off are drawn as well, and set to zero."""

    def on(name: str) -> float:
        return float(name in effects)

    step = np.zeros(dof)
    step[rng.integers(dof)] = rng.uniform(*preset.joint_step) * rng.choice([-1.0, 1.0])
    direction = rng.normal(size=3)
    return Troubles(
        step=step * on("joint-step"),
        step_at=np.deg2rad(preset.home_deg) + rng.uniform(-1.0, 1.0, dof) * np.deg2rad(preset.joint_step_within_deg),
        tilt_per_mm=1e-3 * rng.uniform(*preset.pedestal_tilt, 2) * on("pedestal"),
        creep=rng.uniform(*preset.creep_mm) * direction / np.linalg.norm(direction) * on("creep"),
    )
