"""Columns of compliance: each joint turns under the weight of masses of the arm and of its payload."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.robots import Robot

COMPLIANCE_STD: Final = 3e-4
"""The prior standard deviation of the deviation of a joint under the moment of one link's mass at 1 m [rad]."""
_MOMENT_ARM: Final = 1000.0  # mm


class Masses:
    """The masses under whose weight joints turn: one at each joint's frame and the tool point, and the payload's.

    The payload's is at its centre where this is known; otherwise at the wrist and at the tool point, which stands for
    any place between them.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    arm, payload, centre : bool
        Whether there are masses of the arm, those of payloads that vary, and whether their centres are known.

    Attributes
    ----------
    names : list of str
        The names of the columns.
    plain : int
        The number of those of the arm, which come first.
    centred : bool
        Whether payloads have their mass at a stated centre.
    """

    def __init__(self, robot: Robot, *, arm: bool, payload: bool, centre: bool) -> None:
        self._robot, dof = robot, robot.dof
        pairs = [(j, k) for j in range(dof) for k in range(j, dof + 1)] if arm else []
        self.plain = len(pairs)
        if arm and payload:
            pairs += [(j, k) for j in range(dof) for k in ((dof + 1,) if centre else (dof - 1, dof)) if j <= k]
        self.centred = arm and payload and centre
        self._joint, self._mass = np.array(pairs, np.int64).reshape(-1, 2).T
        places = {dof: "at tool", dof + 1: "at centre"}
        self.names = [
            f"joint {j + 1} under {'mass' if i < self.plain else 'payload'} {places.get(k, str(k + 1))}"
            for i, (j, k) in enumerate(pairs)
        ]

    def columns(
        self, q: FloatArray, p: FloatArray, lever: FloatArray, load: FloatArray | None, centre: FloatArray | None
    ) -> FloatArray:
        """Return ∂P/∂q_j (z_j × r)·e_g for each mass: the compliance of joint j under a unit weight, (n, r, columns).

        Parameters
        ----------
        q, p : (n, dof), (n, 3) arrays [rad], [mm]
            The joints, and the tool points.
        lever : (n, r, dof) array [mm/rad]
            The levers ∂P/∂q_j.
        load : (n, 1) array, optional
            The payloads over the largest one, to which their columns are in proportion.
        centre : (n, 3) array [mm], flange frame, optional
            Their centres of mass.
        """
        frames = self._robot.frames(q)
        joint = frames[:, :-1] @ self._robot.link_before
        places = [frames[:, 1:, :3, 3], p[:, None]]
        if self.centred and centre is not None:
            flange = self._robot.forward(q)
            places.append((flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], centre))[:, None])
        mass, j = np.concatenate(places, axis=1), self._joint
        arm, axis = mass[:, self._mass] - joint[:, :, :3, 3][:, j], joint[:, :, :3, 2][:, j]
        moment = axis[..., 0] * arm[..., 1] - axis[..., 1] * arm[..., 0]  # (z × r)_z, gravity along z of the base
        if load is not None:
            moment[:, self.plain :] *= load
        return np.asarray(lever[:, :, j] * (moment / _MOMENT_ARM)[:, None, :])

    @property
    def of_payload(self) -> tuple[IntArray, BoolArray]:
        """The joint of each column, and whether its mass is the payload's."""
        return self._joint, np.arange(len(self._joint)) >= self.plain

    def moments(self, estimate: FloatArray, load: float, power: int = 1) -> FloatArray:
        """Return the deviation of each joint by each mass per horizontal lever, (dof, dof + 1, …) [rad/mm].

        Parameters
        ----------
        estimate : (columns, …) array [rad/m]
            The coefficients; their squares for the variance, with `power` 2.
        load : float
            The payload at work over the largest one.

        Raises
        ------
        DataError
            If a payload has its mass at a stated centre, which arrays of a map cannot hold.
        """
        if self.centred:
            raise DataError(
                "a map of payloads with centres of mass cannot be frozen; fit it with conditions=payload, which does "
                "without the centres"
            )
        dof = self._robot.dof
        moment = np.zeros((dof, dof + 1, *estimate.shape[1:]))
        for i, (j, k, value) in enumerate(zip(self._joint, self._mass, estimate, strict=True)):
            moment[j, k] += value * ((1.0 if i < self.plain else load) / _MOMENT_ARM) ** power
        return moment
