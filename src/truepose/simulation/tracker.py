"""The noise of a laser tracker, and the reflectors on a tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.geometry.transforms import cross_matrix


@dataclass(frozen=True)
class TrackerNoise:
    """The standard deviations of a laser tracker's reading.

    Attributes
    ----------
    range_std : float [mm]
        The constant part along the beam.
    range_std_per_mm : float
        The part along the beam per distance.
    cross_std : float [mm]
        The constant part in each direction across the beam.
    cross_std_per_mm : float
        The part across the beam per distance.

    Notes
    -----
    The defaults describe a tracker with 5 µm + 0.5 µm/m along the beam and (15 µm + 6 µm/m)/2 across it.

    Examples
    --------
    >>> covariance = TrackerNoise().covariance(np.array([[2000.0, 0.0, 0.0]]))[0]
    >>> np.sqrt(np.diag(covariance)).round(4)
    array([0.006 , 0.0135, 0.0135])
    """

    range_std: float = 0.005
    range_std_per_mm: float = 0.5e-6
    cross_std: float = 0.0075
    cross_std_per_mm: float = 3e-6

    def covariance(self, p_tracker: FloatArray) -> FloatArray:
        """Return the covariances of readings at positions (n, 3) [mm] in the tracker frame, (n, 3, 3) [mm²]."""
        distance = np.linalg.norm(p_tracker, axis=1)
        beam = p_tracker / distance[:, None]
        along = (self.range_std + self.range_std_per_mm * distance) ** 2
        across = (self.cross_std + self.cross_std_per_mm * distance) ** 2
        outer = beam[:, :, None] * beam[:, None, :]
        covariance: FloatArray = across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * outer
        return covariance


def reflector_ring(count: int, radius: float) -> FloatArray:
    """Return positions of reflectors evenly on a circle about the tool point, across its z: (count, 3) [mm]."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)], axis=1)


def pose_covariance(p_body: FloatArray, rotation: Rotation, covariance: FloatArray) -> FloatArray:
    """Return the covariance of `fit_rigid`'s origin [mm] and rotation vector [rad]: (n, 6, 6), to first order.

    Parameters
    ----------
    p_body : (m, 3) array [mm]
        The positions of the reflectors on the tool.
    rotation : Rotation of length n
        The orientations of the tool.
    covariance : (n, m, 3, 3) array [mm²]
        The covariances of the readings, which are independent of each other.
    """
    arm = rotation.as_matrix() @ p_body.T  # (n, 3, m): from the origin to each point
    jacobian = np.zeros((len(arm), len(p_body), 3, 6))
    jacobian[..., :3] = np.eye(3)
    jacobian[..., 3:] = -cross_matrix(arm.transpose(0, 2, 1))
    normal = np.linalg.inv(np.einsum("nmij,nmik->njk", jacobian, jacobian))
    gain = np.einsum("njk,nmik->nmji", normal, jacobian)
    return np.asarray(np.einsum("nmji,nmik,nmlk->njl", gain, covariance, gain))
