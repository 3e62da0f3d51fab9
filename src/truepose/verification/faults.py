"""Describe faults of a measuring campaign by size and probability; compare repeated reference points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.special import fdtrc

from truepose._typing import FloatArray, IntArray
from truepose.geometry.transforms import cross_matrix

Kind = Literal["moved", "drift", "scale", "reference", "alternating"]

SIGNIFICANT: Final = 1e-6
"""The largest p-value of a fault that is reported."""
SMALLEST_MM: Final = 0.05
"""The smallest effect that is reported: root mean square displacement of the samples [mm]."""
SMALLEST_SCALE: Final = 1e-3
"""The smallest scale that is reported; links are accurate to about a millimetre in a metre."""

_SPREAD: Final = 10.0  # mm: reference points nearer to a line do not determine a rotation
_KNOWN: Final = 100.0  # degrees of freedom of a known noise
_FLOOR: Final = 1e-4  # of a standard deviation [mm]


@dataclass(frozen=True, eq=False)
class Change:
    """A fault of a campaign.

    Attributes
    ----------
    kind : {"moved", "drift", "scale", "reference", "alternating"}
        The kind of fault: the tracker moved, a motion grows with time, lengths have a scale, reference points changed,
        readings are of two populations.
    shift, shift_std : float [mm]
        The length of the displacement of the samples' centre, from before to after or from first to last.
    turn, turn_std : float [rad]
        The angle of the rotation.
    scale, scale_std : float
        The ratio of measured to commanded lengths, minus 1.
    size, size_std : float [mm]
        The root mean square displacement of the samples.
    p_value : float
        The probability of an effect at least this large without a fault.
    rows : tuple of int
        The last sample before a motion and the first after it; for other faults the first and the last sample.
    points : int
        The number of reference points; 0 for other faults.
    members : tuple of int
        The samples of the smaller of two populations; empty for other faults.
    frame : str
        The frame in which two populations differ by a constant: ``flange`` or ``base``; empty for other faults.
    """

    kind: Kind
    shift: float
    shift_std: float
    turn: float
    turn_std: float
    scale: float
    scale_std: float
    size: float
    size_std: float
    p_value: float
    rows: tuple[int, int]
    points: int = 0
    members: tuple[int, ...] = ()
    frame: str = ""

    @property
    def notable(self) -> bool:
        """Whether the fault is significant and large enough to be reported."""
        large = abs(self.scale) > SMALLEST_SCALE if self.kind == "scale" else self.size > SMALLEST_MM
        return large and self.p_value < SIGNIFICANT


def reference_change(
    e: FloatArray, p: FloatArray, before: IntArray, after: IntArray, noise_std: float | None = None
) -> Change | None:
    """Compare the readings of reference points before and after.

    The noise is their scatter about the common motion if it exceeds the known noise or no noise is known. The motion
    includes a rotation if there are four or more points that are not on a line.

    Parameters
    ----------
    e, p : (n, 3) arrays [mm], base frame
        The errors and commanded positions in order of time.
    before, after : (m,) arrays of int
        The samples of the same commands at the start and at the end.
    noise_std : float [mm], optional
        The standard deviation of one reading in each direction, robot included; required below three points.

    Returns
    -------
    Change or None
        None without points, or if the noise is unknown.
    """
    m = len(before)
    if not m or (m < 3 and noise_std is None):
        return None
    centred = p[before] - p[before].mean(axis=0)
    columns = np.tile(np.eye(3), (m, 1, 1))
    if m >= 4 and np.linalg.svd(centred, compute_uv=False)[1] > _SPREAD:
        columns = np.concatenate([columns, -cross_matrix(centred)], axis=2)
    flat, moved = columns.reshape(3 * m, -1), (e[after] - e[before]).reshape(-1)
    estimate = np.asarray(np.linalg.lstsq(flat, moved, rcond=None)[0], np.float64)
    freedom = float(3 * m - flat.shape[1])
    left = moved - flat @ estimate
    std = float(np.sqrt(left @ left / freedom)) if m >= 3 else 0.0
    if noise_std is not None:
        std, freedom = max(std, np.sqrt(2.0) * noise_std), _KNOWN
    covariance = np.asarray(max(std, _FLOOR) ** 2 * np.linalg.inv(flat.T @ flat), np.float64)
    ends = int(before.min()), int(after.max())
    return replace(fault("reference", estimate, covariance, columns, freedom, 1, ends), points=m)


def fault(
    kind: Kind,
    theta: FloatArray,
    covariance: FloatArray,
    columns: FloatArray,
    freedom: float,
    tries: int,
    rows: tuple[int, int],
) -> Change:
    """Return the fault of coefficients θ (k,) of its columns (n, 3, k), tested by F with `freedom` degrees of freedom.

    Parameters
    ----------
    kind : str
        The kind of fault.
    theta, covariance : (k,), (k, k) arrays
        The coefficients and their covariance.
    columns : (n, 3, k) array
        The displacements of the samples per unit of each coefficient [mm].
    freedom : float
        The degrees of freedom of the noise.
    tries : int
        The number of positions that were tried (Bonferroni).
    rows : tuple of int
        The rows of the fault, see `Change`.
    """
    k = len(theta)
    squares = float(theta @ np.linalg.solve(covariance, theta))
    chance = min(1.0, tries * float(fdtrc(k, freedom, squares / k)))
    mean_square = np.einsum("nap,naq->pq", columns, columns) / len(columns)
    size = float(np.sqrt(theta @ mean_square @ theta))
    slope = mean_square @ theta / max(size, 1e-12)
    size_std = float(np.sqrt(slope @ covariance @ slope))
    shift, turn, scale = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    if kind == "scale":
        scale = float(theta[0]), float(np.sqrt(covariance[0, 0]))
    else:
        shift = _length(theta[:3], covariance[:3, :3])
        turn = _length(theta[3:6], covariance[3:6, 3:6]) if k == 6 else (0.0, 0.0)
    return Change(kind, *shift, *turn, *scale, size, size_std, chance, rows)


def _length(vector: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Return the length of a vector, and its standard deviation to first order."""
    length = float(np.linalg.norm(vector))
    along = vector / max(length, 1e-12)
    return length, float(np.sqrt(along @ covariance @ along))
