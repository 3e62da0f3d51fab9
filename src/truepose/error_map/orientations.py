"""The measured orientations of samples, as readings of the arm's turns."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.geometry import Registration
from truepose.robots import Robot
from truepose.samples import Samples

_FAR: Final = 6.0  # times the median turn from the mean
_ROUNDS: Final = 5


def orientation_columns(
    robot: Robot, samples: Samples, registration: Registration, mounting: Rotation | None = None
) -> FloatArray | None:
    """Return rotation vectors of the arm's error and their standard deviations, (n, 6) [rad], base frame.

    The turn of the target on the flange is not known; the mean over the samples is taken out.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples.
    registration : Registration
        Their registration.
    mounting : Rotation, optional
        The turn of the target on the flange; by default `mounting_of` the samples.

    Returns
    -------
    (n, 6) array, or None without joints, without measured orientations, or without their standard deviations. Readings
    of several reflectors show the turns of the tool themselves.
    """
    turned, std = samples.rotation_meas, samples.rotation_std
    if samples.q is None or turned is None or std is None or samples.reflector is not None:
        return None
    mounting = mounting_of(robot, samples, registration) if mounting is None else mounting
    to_base = registration.tf_base_tracker[:3, :3]
    flange = Rotation.from_matrix(robot.forward(samples.q)[:, :3, :3])
    vector = (Rotation.from_matrix(to_base) * turned * mounting.inv() * flange.inv()).as_rotvec()
    return np.concatenate([vector, np.sqrt(std**2 @ (to_base**2).T)], axis=1)


def mounting_of(robot: Robot, samples: Samples, registration: Registration) -> Rotation:
    """Return the mean turn of the target on the flange, without orientations that are far from it."""
    assert samples.q is not None
    assert samples.rotation_meas is not None
    flange = Rotation.from_matrix(robot.forward(samples.q)[:, :3, :3])
    turns = flange.inv() * Rotation.from_matrix(registration.tf_base_tracker[:3, :3]) * samples.rotation_meas
    mean = turns.mean()
    for _ in range(_ROUNDS):
        away = (mean.inv() * turns).magnitude()
        mean = turns[np.flatnonzero(away <= _FAR * np.median(away))].mean()
    return mean
