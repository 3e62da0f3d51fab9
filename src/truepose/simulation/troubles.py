"""What goes wrong in a cell beyond the usual: a damaged joint, a pedestal that tilts, a station that creeps."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.simulation.presets import Preset


@dataclass(frozen=True, eq=False)
class Troubles:
    """Faults of a virtual cell; each is zero when it is switched off.

    Attributes
    ----------
    step : (dof,) array [rad]
        By how much the offset of each joint jumps; zero for all joints but one.
    step_at : (dof,) array [rad]
        Angle of each joint above which its offset has jumped.
    tilt_per_mm : (2,) array [rad/mm]
        Tilt of the pedestal along x and y of the base frame, per length by which the arm reaches out along x and y.
    creep : (3,) array [mm]
        Path of the tracker's station during a campaign, tracker frame.
    """

    step: FloatArray
    step_at: FloatArray
    tilt_per_mm: FloatArray
    creep: FloatArray

    def joint_steps(self, q: FloatArray) -> FloatArray:
        """Return the jumps of the offsets at configurations (n, dof) [rad], (n, dof) [rad]."""
        return np.where(q > self.step_at, self.step, 0.0)

    def tilted(self, tf: FloatArray) -> FloatArray:
        """Return poses (n, 4, 4) [mm] of an arm whose pedestal tilts about the base origin towards where it reaches."""
        if not self.tilt_per_mm.any():
            return tf
        tilt_x, tilt_y = (self.tilt_per_mm * tf[:, :2, 3]).T
        turn = Rotation.from_rotvec(np.stack([-tilt_y, tilt_x, np.zeros(len(tf))], axis=1)).as_matrix()
        tilted = tf.copy()
        tilted[:, :3] = turn @ tf[:, :3]
        return tilted

    def drift(self, time: FloatArray) -> FloatArray:
        """Return by how much readings at (n,) [s] are off since the station creeps, (n, 3) [mm], tracker frame.

        The creep is linear in time, and zero in the middle between the first reading and the last.
        """
        share = (time - time.min(initial=np.inf)) / max(np.ptp(time), np.finfo(float).tiny)
        return np.asarray((share[:, None] - 0.5) * self.creep)


def draw_troubles(preset: Preset, dof: int, effects: Collection[str], rng: np.random.Generator) -> Troubles:
    """Draw the faults of a cell; what is switched off is drawn as well, and is zero then."""

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
