"""What a fitted map of a cell's errors consists of, and the errors of its samples.

A map keeps what it was made from: cell, robot, samples, registration, tool, and a fitted predictor. Its predictions
are in `truepose.error_map.prediction`, its corrections in `truepose.error_map.correction`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.arm_check import UNCHECKED, ArmCheck, check_arm
from truepose.error_map.conditions import knows, with_conditions
from truepose.error_map.facts import Fact
from truepose.error_map.orientations import orientation_columns
from truepose.error_map.points import commanded_points, reflector_columns
from truepose.error_map.registration import check_limits, reading_noise
from truepose.error_map.rounding import rounding_variance
from truepose.error_map.selection import CellSamples
from truepose.error_map.worth import FEW, LeftOut, Worth, worth
from truepose.errors import DataError
from truepose.geometry import Registration, apply_transform
from truepose.predictors import Predictor, predictor_spec
from truepose.predictors.reflectors import whole_poses
from truepose.robots import Robot
from truepose.samples import Poses, Samples, on_arm


class StoredFile(NamedTuple):
    """The file that a map was read from, and the SHA-256 of its bytes as truepose wrote them."""

    path: Path
    sha256: str


@dataclass(frozen=True, eq=False, repr=False)
class MapData:
    """The content of an error map.

    Attributes
    ----------
    cell : Cell
        The cell that was measured.
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples used in the fit, with outliers removed.
    registration : Registration
        The transform from tracker frame to base frame; every error of this map is computed after it.
    tf_flange_tool : (4, 4) array [mm]
        The transform from flange to measured point, fitted or as stated in the cell.
    predictor_name : str
        The name of the predictor, see `truepose.predictors.predictor_spec`.
    predictor : Predictor
        The fitted predictor, in Cartesian space (commanded positions [mm]) or joint space ([rad]); see `space`.
    ranking : list of dict
        The candidates of ``auto`` in cross-validation, the chosen one first; empty when a predictor was named. See
        `truepose.predictors.Choice`, also for ``expected``.
    expected : dict
        The errors that ``auto`` leaves on unseen samples; empty when a predictor was named.
    excluded : list of dict
        The samples left out of the fit, by ``row``, ``point`` and ``line``, with the ``reason``.
    campaign : dict
        The result of the tests of the measuring campaign: ``tested`` samples, ``limit_mm``, ``suspected_drift_mm`` and
        ``faults``, each with its ``words``; see `truepose.error_map.campaign.CampaignCheck`. Empty for a map that was
        saved before these tests existed.
    p_flange_sampled : (3,) array [mm], optional
        The point at which the samples were measured, if the tool was changed since: see `update_map`.
    arm_check : ArmCheck
        The comparison of the nominal arm and the tool with the commanded positions.
    stated : tuple of Fact
        What a step found or a user accepted, beside what follows from the other parts; see `truepose.ErrorMap.facts`.
    known_worth : Worth, optional
        The comparison with no map made by `fit_cell`; None in maps of earlier versions and after an update.
    stored : StoredFile, optional
        The file that the map was read from.
    """

    cell: Cell
    robot: Robot
    samples: Samples
    registration: Registration
    tf_flange_tool: FloatArray
    predictor_name: str
    predictor: Predictor
    ranking: list[dict[str, Any]]
    expected: dict[str, Any]
    excluded: list[dict[str, Any]]
    campaign: dict[str, Any] = field(default_factory=dict)
    p_flange_sampled: FloatArray | None = None
    arm_check: ArmCheck = UNCHECKED
    stated: tuple[Fact, ...] = ()
    known_worth: Worth | None = None
    stored: StoredFile | None = None

    def changed(self, **fields: Any) -> Self:
        """Return a copy with other values of some fields; it is no longer the map of a file."""
        return replace(self, stored=None, **fields)

    @property
    def space(self) -> str:
        """The space of the predictor's input: ``cartesian`` or ``joint``."""
        return predictor_spec(self.predictor_name).space

    @property
    def tool_fitted(self) -> bool:
        """Whether the tool point was fitted together with the station."""
        return self.registration.p_flange_tool is not None

    @property
    def tf_flange_sampled(self) -> FloatArray:
        """Flange to the point where the samples were measured, (4, 4) [mm]; the tool, unless it was changed since."""
        tf = self.tf_flange_tool.copy()
        if self.p_flange_sampled is not None:
            tf[:3, 3] = self.p_flange_sampled
        return tf

    @cached_property
    def p_cmd(self) -> FloatArray:
        """Commanded positions of the samples, (n, 3) [mm], base frame."""
        return self._commanded(self.samples, self.tf_flange_sampled)

    @cached_property
    def e(self) -> FloatArray:
        """Positional errors of the samples after registration, (n, 3) [mm], base frame."""
        return apply_transform(self.registration.tf_base_tracker, self.samples.p_meas) - self.p_cmd

    def commanded_positions(self, poses: Poses) -> FloatArray:
        """Return the positions of the measured point by the nominal model, (n, 3) [mm], base frame.

        Raises
        ------
        DataError
            If the tool was fitted and there are no joints, or neither joints nor positions.
        RobotError
            If joints are beyond the robot's limits.
        """
        return self._commanded(on_arm(poses, self.robot), self.tf_flange_tool)

    def _commanded(self, poses: Poses, tf_flange_tool: FloatArray) -> FloatArray:
        if poses.q is not None:
            check_limits(self.robot, poses)
            return commanded_points(self.robot, self.cell, poses, tf_flange_tool)
        if self.tool_fitted:
            raise DataError(
                f"{poses.source}: the map's tool was fitted, so joints (q1_deg …) are needed, not positions"
            )
        assert poses.p_cmd is not None  # Poses holds one of them
        return poses.p_cmd

    def coordinates(self, poses: Poses) -> FloatArray:
        """Return the coordinates in the predictor's space: commanded positions (n, 3) [mm], or joints (n, dof) [rad].

        Raises
        ------
        DataError
            If the predictor needs joints and there are none; see also `commanded_positions`.
        """
        poses = on_arm(poses, self.robot)
        return self._in_space(poses, self.commanded_positions(poses))

    def inputs(self, poses: Poses) -> FloatArray:
        """Return `coordinates`, with the conditions that the predictor uses in further columns; NaN where not given."""
        return with_conditions(self.coordinates(poses), self.predictor, poses, self.cell)

    @property
    def fitted_inputs(self) -> FloatArray:
        """The predictor's `inputs` of the samples, at the point where they were measured."""
        x, samples = self._in_space(self.samples, self.p_cmd), self.samples
        turns = orientation_columns(self.robot, samples, self.registration)
        return with_conditions(x, self.predictor, samples, self.cell, time=samples.time, orientation=turns)

    def _in_space(self, poses: Poses, p_cmd: FloatArray) -> FloatArray:
        if self.space == "cartesian":
            return p_cmd
        if poses.q is None:
            raise DataError(f"{poses.source}: a predictor in joint space needs joints (q1_deg …)")
        return poses.q

    def errors(self, samples: Samples) -> FloatArray:
        """Return measured − commanded positions of any samples after this map's registration, (n, 3) [mm], base frame.

        Raises
        ------
        DataError
            If commanded positions of the samples prove another tool than this map's.
        """
        samples = on_arm(samples, self.robot)
        self.compared(samples)
        return apply_transform(self.registration.tf_base_tracker, samples.p_meas) - self.commanded_positions(samples)

    def compared(self, samples: Samples) -> ArmCheck:
        """Return the comparison of the arm and the tool of this map with the commanded positions of any samples.

        Raises
        ------
        DataError
            As `errors`.
        """
        fitted = self.tool_fitted or self.p_flange_sampled is not None
        return check_arm(self.robot, samples, self.tf_flange_tool, fit="pose" if fitted else "none")

    def rounding(self, samples: Samples, arm: ArmCheck) -> FloatArray:
        """Return the variance of errors of samples due to rounding, (n, 3) [mm²]; see `rounding_variance`."""
        return rounding_variance(self.robot, samples, self.tf_flange_tool, arm)

    def reading_noise(self, samples: Samples) -> FloatArray | None:
        """Return the known standard deviation of new readings, (n, 3) [mm], base frame.

        The mean of the map's own readings where table and cell state none; None if the map was fitted without.
        """
        own = self.predictor.noise_std_
        if own is None:
            return None
        known = reading_noise(self.cell, samples, self.registration)
        return np.broadcast_to(np.sqrt(np.mean(own**2, axis=0)), (len(samples), 3)) if known is None else known

    @cached_property
    def worth(self) -> Worth:
        """Whether the map is better than no map, on blocks of samples that it was fitted without."""
        if self.known_worth is not None:
            return self.known_worth
        return worth(self.p_cmd, self.e, self._without, self._pose)

    @property
    def _pose(self) -> IntArray | None:
        """The pose of each sample, (n,); None where each is one of its own."""
        own = reflector_columns(self.samples, self.cell)
        return None if own is None or self.samples.q is None else whole_poses(self.samples.q, own[:, 1])

    def _without(self, block: IntArray) -> LeftOut:
        """Return what is left of the samples' errors without their blocks, see `LeftOut`."""
        drifting, fleet = knows(self.predictor, "time"), getattr(self.predictor, "fleet", None)
        measured = CellSamples(self.cell, self.robot, self.samples, accepted=True, drifting=drifting, fleet=fleet)
        found = LeftOut(np.empty_like(self.e), np.empty_like(self.e))
        for k in np.unique(block):
            out, known = np.flatnonzero(block == k), np.flatnonzero(block != k)
            errors = measured.registered_by(known)
            found.alone[out] = errors.e[out]
            if len(block) <= FEW:
                predictor, _ = errors.fit(self.predictor_name, known)
                found.left[out] = errors.e[out] - predictor.predict(errors.inputs(self.predictor_name, predictor)[out])
        if len(block) > FEW:
            found.left[:] = self.predictor.leave_blocks_out(block).residual
        return found
