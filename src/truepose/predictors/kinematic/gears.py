"""Columns of the errors that repeat with each turn of a motor: eccentric pinions, wave generators, resolvers.

An error of a motor's angle turns its joint by a harmonic of the motor's angle g q, with the gear ratio g. The first
harmonic is that of eccentric parts, the second that of wave generators and of resolvers with two phases that differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray

ORDERS: Final = (1, 2)
"""The harmonics of the motor's angle."""
RIPPLE_STD: Final = 3e-5
"""The prior standard deviation of the amplitude of each cosine and sine [rad]; ripple is 20 to 50 µrad."""


class Gears:
    """The harmonics of gears of known ratio.

    Parameters
    ----------
    ratio : (dof,) array
        The motor turns for one turn of each joint; empty if they are not known.

    Attributes
    ----------
    rows : (h, 2) array
        The joint and the factor of its angle of each harmonic.
    names : list of str
        The names of the 2 h columns: sine and cosine of each harmonic.

    Examples
    --------
    >>> Gears(np.array([100.0, 80.0])).names[2:6]
    ['gear sin 2 q1', 'gear cos 2 q1', 'gear sin 1 q2', 'gear cos 1 q2']
    """

    def __init__(self, ratio: FloatArray) -> None:
        every = [(joint, order) for joint in range(len(ratio)) for order in ORDERS]
        self.rows = np.array([(joint, order * ratio[joint]) for joint, order in every], float).reshape(-1, 2)
        self.names = [f"gear {wave} {order} q{joint + 1}" for joint, order in every for wave in ("sin", "cos")]

    @property
    def known(self) -> bool:
        """Whether there are any."""
        return bool(self.names)

    def columns(self, q: FloatArray, lever: FloatArray) -> FloatArray:
        """Return the columns at joints (n, dof) [rad] with levers (n, r, dof) [mm/rad]: (n, r, 2 h)."""
        joint = self.rows[:, 0].astype(int)
        angle = q[:, joint] * self.rows[:, 1]
        waves = np.stack([np.sin(angle), np.cos(angle)], axis=2)
        return np.asarray(lever[:, :, joint, None] * waves[:, None]).reshape(*lever.shape[:2], -1)


def amplitudes(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the amplitude of each harmonic from the parameters of `Gears.names`, none if the term was left out.

    Parameters
    ----------
    rows : sequence of mapping
        The rows of group ``gear`` of `KinematicKriging.parameters_`, sine and cosine of each harmonic in turn.

    Returns
    -------
    list of dict
        Rows with the same keys; the estimate is the root of the sum of squares [rad], its standard deviation that of a
        change along it.

    Examples
    --------
    >>> sine = {"name": "gear sin 1 q2", "estimate": 3e-5, "std": 1e-6, "unit": "rad", "told": True}
    >>> found = amplitudes([sine, {**sine, "name": "gear cos 1 q2", "estimate": 4e-5}])[0]
    >>> found["name"], round(1e6 * found["estimate"]), round(1e6 * found["std"])
    ('gear 1 q2', 50, 1)
    """
    if not any(row["told"] for row in rows):
        return []
    out = []
    for sine, cosine in zip(rows[::2], rows[1::2], strict=True):
        value, std = (np.array([row[key] for row in (sine, cosine)]) for key in ("estimate", "std"))
        size = float(np.hypot(*value))
        along = float(np.hypot(*(value * std))) / size if size else float(std.max())
        name = sine["name"].replace(" sin", "")
        row = {key: sine[key] for key in sine if key not in ("prior_std", "off")}  # an amplitude has no such prior
        out.append({**row, "name": name, "estimate": size, "std": along, "told": sine["told"] or cosine["told"]})
    return out
