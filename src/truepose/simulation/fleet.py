"""A virtual fleet: robots of one type, whose errors have a common part."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.robots import Robot
from truepose.simulation.presets import Preset
from truepose.simulation.truth import Truth
from truepose.simulation.virtual_cell import VirtualCell

_LENGTHS_AND_ANGLES: Final = ("a", "d", "alpha", "offset", "beta")
_POSITIVE: Final = ("compliance", "link_kg", "expansion")


class VirtualFleet:
    """Virtual cells whose robots share a part of the variance of their errors.

    Geometry and joint errors of each robot are √share times those of the type plus √(1 − share) times its own;
    compliances and masses are the mean of both with these weights squared. Tool, station and noise are its own.

    Parameters
    ----------
    preset : str or Preset
        The preset of all cells, see `VirtualCell`.
    robot : str or Path, optional
        The library name or the file of another robot.
    share : float
        The part of the variance that all robots have in common, 0 to 1.
    seed : int
        The seed of the fleet; it decides all of it.
    effects : collection of str, optional
        The effects that are switched on, see `VirtualCell`.

    Raises
    ------
    DataError
        If the share is not within 0 and 1, or the preset or an effect is unknown.
    RobotError
        If the robot is unknown, or cannot reach the work region.

    Examples
    --------
    >>> fleet = VirtualFleet("paper", share=1.0, seed=2)
    >>> bool(np.allclose(fleet.cell(0).truth.robot.d, fleet.cell(1).truth.robot.d))
    True
    """

    def __init__(
        self,
        preset: str | Preset = "hard",
        robot: str | Path | None = None,
        share: float = 0.5,
        seed: int = 0,
        effects: Collection[str] | None = None,
    ) -> None:
        if not 0.0 <= share <= 1.0:
            raise DataError(f"share must lie within 0 and 1, got {share}")
        self.preset, self.share, self.seed = preset, share, seed
        self._robot, self._effects = robot, effects
        self._common = VirtualCell(preset, robot, seed, effects)

    def __repr__(self) -> str:
        return f"<VirtualFleet of {self._common.robot.name}, seed {self.seed}: share {self.share:g}>"

    def cell(self, number: int) -> VirtualCell:
        """Return the cell of a robot of the fleet; the same number always gives the same robot.

        Parameters
        ----------
        number : int
            The number of the robot, from 0.
        """
        own = VirtualCell(self.preset, self._robot, 1000 * (self.seed + 1) + number, self._effects)
        own.truth = self._mixed(own.robot, own.truth)
        return own

    def _mixed(self, nominal: Robot, own: Truth) -> Truth:
        common, root = self._common.truth, np.sqrt([self.share, 1.0 - self.share])
        arm: dict[str, Any] = {}
        for name in _LENGTHS_AND_ANGLES:
            base = getattr(nominal, name)
            parts = [getattr(one.robot, name) - base for one in (common, own)]
            arm[name] = base + root[0] * parts[0] + root[1] * parts[1]
        mean: dict[str, Any] = {name: _mean(self.share, common, own, name) for name in _POSITIVE}
        joint_error = common.joint_error * float(root[0]) + own.joint_error * float(root[1])
        return replace(own, robot=replace(nominal, **arm), joint_error=joint_error, **mean)


def _mean(share: float, common: Truth, own: Truth, name: str) -> FloatArray:
    return np.asarray(share * getattr(common, name) + (1.0 - share) * getattr(own, name))
