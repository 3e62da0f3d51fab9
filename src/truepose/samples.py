"""The one table that everything passes on: commanded configurations with their measurements (method.md §0).

Positions are mm, angles rad. Commanded quantities are in the robot base frame, measured ones in the tracker frame: they
become comparable by a registration (`truepose.geometry`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import DataError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Samples:
    """Commanded configurations and what the tracker read at each.

    Parameters
    ----------
    p_meas : (n, 3) array [mm], tracker frame
        Measured positions of the reflector.
    q : (n, dof) array [rad], optional
        Joint vectors, in the robot's own order and sign.
    p_cmd : (n, 3) array [mm], base frame, optional
        Commanded positions of the tool centre point.
    rotation_cmd : Rotation of length n, optional
        Commanded orientations of the tool, base frame.
    rotation_meas : Rotation of length n, optional
        Measured orientations, tracker frame.
    p_std : (n, 3) array [mm], tracker frame, optional
        Standard deviation of each reading.
    rotation_std : (n, 3) array [rad], optional
        Standard deviation of the measured orientation.
    approach : (n, dof) array of -1, 0, +1, optional
        Sign of the last motion of each joint.
    time : (n,) array [s], optional
    temperature : (n,) array [°C], optional
    load : (n,) array [kg], optional
    row : (n,) array of int, optional
        The row's name in messages; counted from 0 when not given.
    source : str
        Where the table came from, for messages.

    Raises
    ------
    DataError
        If shapes disagree, or neither joints nor commanded positions are there.
    """

    p_meas: FloatArray
    q: FloatArray | None = None
    p_cmd: FloatArray | None = None
    rotation_cmd: Rotation | None = None
    rotation_meas: Rotation | None = None
    p_std: FloatArray | None = None
    rotation_std: FloatArray | None = None
    approach: FloatArray | None = None
    time: FloatArray | None = None
    temperature: FloatArray | None = None
    load: FloatArray | None = None
    row: NDArray[np.int64] | None = None
    source: str = "samples"

    def __post_init__(self) -> None:
        n = len(self.p_meas)
        if self.row is None:
            object.__setattr__(self, "row", np.arange(n))
        if self.q is None and self.p_cmd is None:
            raise DataError(f"{self.source}: neither joints (q1_deg …) nor commanded positions (x_cmd_mm …) are given")
        for name in self.columns():
            value = getattr(self, name)
            if len(value) != n:
                raise DataError(f"{self.source}: {name} has {len(value)} rows, p_meas has {n}")

    def __len__(self) -> int:
        return len(self.p_meas)

    def __getitem__(self, index: NDArray[Any] | slice) -> Self:
        """Return the rows that a mask, an index array or a slice selects."""
        return replace(self, **{name: getattr(self, name)[index] for name in self.columns()})

    def columns(self) -> list[str]:
        """Return the names of the quantities that this table holds."""
        return [f.name for f in fields(self) if f.name != "source" and getattr(self, f.name) is not None]
