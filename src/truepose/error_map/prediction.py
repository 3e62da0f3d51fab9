"""The predictions of a map: errors, standard deviations and readings at commanded poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._io.tables import by_axis, data_frame, facts_table
from truepose._typing import FloatArray
from truepose.error_map.conditions import (
    centres_at_work,
    conditions_of,
    knows,
    models,
    not_measured,
    not_modelled,
    with_conditions,
    work_of,
)
from truepose.error_map.data import MapData
from truepose.error_map.lost_motion import from_other_sides, lost_motion_std, sampled_sides
from truepose.error_map.repeatability import Repeatability
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors import LeaveOneOut, PosePredictor
from truepose.predictors.abilities import Conditional, TailKnowing
from truepose.predictors.conditions import joined
from truepose.predictors.tails import Tails
from truepose.samples import Poses, Samples, on_arm
from truepose.verification import RP_PER_STD

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """Predicted errors and readings of commanded poses.

    Attributes
    ----------
    e : (n, 3) array [mm], base frame
        The predicted positional error, measured − commanded.
    std : (n, 3) array [mm], base frame
        Its standard deviation, without the noise of one motion and one reading: see `ErrorMap.predict_errors`.
    p_measured : (n, 3) array [mm], tracker frame
        The position at which the tracker will see the measured point.
    std_measured : (n, 3) array [mm], tracker frame
        The same standard deviation along the tracker's axes.
    """

    e: FloatArray
    std: FloatArray
    p_measured: FloatArray
    std_measured: FloatArray

    def __len__(self) -> int:
        return len(self.e)

    def __repr__(self) -> str:
        found = self.to_dict()
        return (
            f"<Prediction of {found['n']} poses: error {found['mean_error_mm']:.3f} mm (mean), standard deviation "
            f"{found['mean_std_mm']:.3f} mm (mean), {found['max_std_mm']:.3f} mm (max)>"
        )

    def _repr_html_(self) -> str:
        found = {name.replace("_", " ").removesuffix(" mm"): value for name, value in self.to_dict().items()}
        return facts_table("Prediction, lengths in mm", found)

    def to_frame(self) -> DataFrame:
        """Return a pandas table with one row for each pose, in mm; needs pandas."""
        return data_frame(
            {
                **by_axis(self.e, "{}_error_mm"),
                **by_axis(self.std, "{}_std_mm"),
                **by_axis(self.p_measured, "{}_pred_mm"),
                **by_axis(self.std_measured, "{}_pred_std_mm"),
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the number of poses, and the mean and largest lengths of errors and standard deviations."""
        error, std = np.linalg.norm(self.e, axis=1), np.linalg.norm(self.std_measured, axis=1)
        return {
            "n": len(self.e),
            "mean_error_mm": float(error.mean()),
            "max_error_mm": float(error.max()),
            "mean_std_mm": float(std.mean()),
            "max_std_mm": float(std.max()),
        }


@dataclass(frozen=True, eq=False, repr=False)
class PredictingMap(MapData):
    """An error map that predicts; its fields are those of `MapData`."""

    @cached_property
    def unexplained(self) -> FloatArray:
        """Variance of the arm's errors beyond the predictor's field, in each direction, (3,) [mm²], base frame.

        The predictor's nugget less the known part of the repeatability; the noise of readings is not in the nugget
        where it is known. What is not known is not subtracted, and counts as error of the arm. A fault that the tests
        of the campaign found or suspect is added, also below their limit, and twice: a drift goes on after the
        campaign, as it does for an arm that warmed up during the measurement. A drift is not added where the effect of
        time is in the model. The effect of conditions at work that the predictor does not know is added, too.
        """
        faults = self.campaign.get("faults", [])
        timed = models(self.predictor, "time")
        sizes = [fault["size"] for fault in faults if not (timed and fault["kind"] == "drift")]
        if not timed:
            sizes.append(self.campaign.get("suspected_drift_mm", 0.0))
        drift = sum((2.0 * size) ** 2 for size in sizes) / 3.0
        arm = self._nugget - self._known
        return np.asarray(arm + drift + not_modelled(self.predictor, self.samples, self.cell, self.p_cmd))

    @cached_property
    def _nugget(self) -> FloatArray:
        """The variance of the errors beyond the predictor's field and the noise of readings, (3,) [mm²]."""
        return np.asarray(self.predictor.nugget_ * self._tails.share)

    @cached_property
    def _known(self) -> FloatArray:
        """The known part of the nugget, by repeatability and rounding, (3,) [mm²]."""
        rounding = np.mean(self.rounding(self.samples, self.arm_check), axis=0)
        return np.asarray(np.minimum(self._nugget, self._repeatability + rounding))

    @cached_property
    def _tails(self) -> Tails:
        return self.predictor.tails() if isinstance(self.predictor, TailKnowing) else Tails()

    @property
    def _repeatability(self) -> float:
        """The variance of a motion in each direction that is known [mm²]."""
        return float((Repeatability.of(self.cell, self.robot).known or 0.0) / RP_PER_STD) ** 2

    def predict(self, poses: Poses | ArrayLike) -> Prediction:
        """Predict errors and readings at commanded poses, as ``truepose predict`` does.

        Parameters
        ----------
        poses : Poses, or (n, dof) array [rad]
            The commanded configurations, for example from `truepose.read_poses`; Poses may instead hold commanded
            positions for a map in Cartesian space with a stated tool.

        Returns
        -------
        Prediction

        Raises
        ------
        DataError
            If the map needs joints and there are none.
        RobotError
            If joints are beyond the robot's limits.

        Examples
        --------
        >>> from truepose import VirtualCell, fit_cell
        >>> virtual = VirtualCell("paper")
        >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(30)), "registration")
        >>> found = error_map.predict(virtual.design(5, seed=1))
        >>> len(found), found.p_measured.shape
        (5, (5, 3))
        """
        poses = poses if isinstance(poses, Poses) else Poses(q=np.atleast_2d(np.asarray(poses, float)), source="poses")
        poses = on_arm(poses, self.robot)
        p_cmd = self.commanded_positions(poses)
        x = with_conditions(self._in_space(poses, p_cmd), self.predictor, poses, self.cell)
        e, std = self.predict_with_tool(x, self.tf_flange_tool, **self._not_covered(poses))
        tf_tracker_base = invert_transform(self.registration.tf_base_tracker)
        p = apply_transform(tf_tracker_base, p_cmd + e)
        return Prediction(e, std, p, np.sqrt(std**2 @ (tf_tracker_base[:3, :3] ** 2).T))

    def predict_measured(self, q: Poses | ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Predict where the tracker will see the measured point.

        Parameters
        ----------
        q : (n, dof) array [rad], or Poses
            The commanded configurations; see `predict`.

        Returns
        -------
        p : (n, 3) array [mm], tracker frame
        std : (n, 3) array [mm], tracker frame
            The standard deviation of `predict_errors`; the noise of a reading comes on top.
        """
        found = self.predict(q)
        return found.p_measured, found.std_measured

    def predict_errors(self, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors and their standard deviation at commanded poses, both (n, 3) [mm], base frame.

        The standard deviation is that of the difference between prediction and true error; guards, records and reports
        use it. Its variance is that of the predictor's field plus `unexplained`; it does not include the noise of one
        motion and of one reading, see `predict_reading`.
        """
        return self.predict_with_tool(self.inputs(poses), self.tf_flange_tool, **self._not_covered(poses))

    def predict_at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `predict_errors` at `inputs` of the predictor, (n, 3) [mm] or (n, dof) [rad] with conditions."""
        return self.predict_with_tool(x, self.tf_flange_tool)

    def predict_reading(self, samples: Samples) -> tuple[FloatArray, FloatArray]:
        """Return expected errors (n, 3) [mm] of new samples, and their standard deviation with a reading's noise."""
        e, std = self.predict_errors(samples)
        return e, self.reading_std(samples, std)

    def reading_std(self, samples: Samples, std: FloatArray) -> FloatArray:
        """Return the standard deviations of predictions (n, 3) [mm] with the noise of a motion and of a reading."""
        known, nugget = self.reading_noise(samples), self._nugget
        own = np.minimum(nugget, self._repeatability) + self.rounding(samples, self.compared(samples))
        return np.sqrt(std**2 + own + (0.0 if known is None else known**2 * self._tails.factor))

    def predict_pose_errors(self, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors of position and orientation at commanded configurations, and their std.

        Returns
        -------
        error : (n, 6) array [mm, rad], base frame
            e, and w, the rotation vector of R_meas R_cmdᵀ.
        std : (n, 6) array [mm, rad], base frame
            The standard deviation, as in `predict_errors`; what is `unexplained` turns the tool as well.

        Raises
        ------
        DataError
            If the map knows positions only, or there are no joints.
        """
        more = self._not_covered(poses)
        return self.predict_with_tool(self.inputs(poses), self.tf_flange_tool, orientation=True, **more)

    def _not_covered(self, poses: Poses) -> dict[str, Any]:
        """Return the variances of `predict_with_tool` due to conditions of poses that no sample had."""
        poses = on_arm(poses, self.robot)
        return {
            "variance": self.not_measured({"temperature": poses.temperature, "payload": poses.load}),
            "lost_motion": self.from_other_sides(poses.q, poses.approach, self.tf_flange_tool),
        }

    @cached_property
    def lost_motion(self) -> FloatArray:
        """The lost motion of each joint that all samples reached from one side, with its sign, (dof,) [rad].

        It is not measured, but what a prior says; 0 where it is measured, or no sample states a side.
        """
        approach = conditions_of(self.samples, self.cell).get("approach")
        sides = sampled_sides(approach, self.robot.dof)
        return sides * lost_motion_std(self.robot) if sides.any() else sides

    def from_other_sides(
        self, q: FloatArray | None, approach: FloatArray | None, tf_flange_tool: FloatArray
    ) -> FloatArray | None:
        """Return the variance of poses whose joints come from sides that no sample had, (m, 6) [mm², rad²].

        None where nothing is stated: joints then come from the side of the samples. See
        `truepose.error_map.lost_motion.from_other_sides`.
        """
        if q is None or approach is None or not self.lost_motion.any():
            return None
        return from_other_sides(self.robot, self.lost_motion, q, approach, tf_flange_tool[..., :3, 3])

    def not_measured(self, given: Mapping[str, FloatArray | None]) -> FloatArray:
        """Return the variance due to temperatures and payloads that no sample had, (m,) or (1,) [mm²].

        See `truepose.error_map.conditions.not_measured`.
        """
        if all(values is None for values in given.values()):
            return np.zeros(1)
        return not_measured(self.predictor, self.samples, self.cell, self.p_cmd, given)

    @property
    def payload_at_work(self) -> tuple[float, float] | None:
        """The payload at work twice, or the range of the samples' payloads [kg]; None where nothing is known."""
        stated = work_of(self.cell).get("payload")
        if stated is not None:
            return stated, stated
        known = conditions_of(self.samples, self.cell).get("payload")
        return None if known is None else (float(np.nanmin(known)), float(np.nanmax(known)))

    @property
    def knows_approach(self) -> bool:
        """Whether predictions depend on the direction in which the joints come to a configuration."""
        return knows(self.predictor, "approach")

    @property
    def depends_on_approach(self) -> bool:
        """Whether predictions or their standard deviations depend on this direction."""
        return self.knows_approach or bool(self.lost_motion.any())

    def condition_columns(self, n: int, given: Mapping[str, FloatArray | None]) -> FloatArray:
        """Return the columns that follow the joints of n targets in `inputs`, (n, c).

        Conditions that are not given, or NaN, are unknown; payload and temperature are those at work then, and the
        centre of mass is that of the cell's payload.
        """
        used = self.predictor.conditions if isinstance(self.predictor, Conditional) else ()
        centre = centres_at_work(n, given.get("centre"), self.cell)
        return joined(np.empty((n, self.robot.dof)), used, {**given, "centre": centre})[:, self.robot.dof :]

    def leave_one_out(self) -> LeaveOneOut:
        """Return the residual of each sample predicted from the others, and its standard deviation, (n, 3) [mm].

        The registration and the hyperparameters are those of all samples.
        """
        return self.predictor.leave_one_out()

    def predict_with_tool(
        self,
        x: FloatArray,
        tf_flange_tool: FloatArray,
        *,
        orientation: bool = False,
        variance: FloatArray | None = None,
        lost_motion: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return errors (n, 3) [mm] or (n, 6) [mm, rad] of a tool, and their standard deviation as `predict_errors`.

        Parameters
        ----------
        x : (n, 3) array [mm], or (n, dof) array [rad] with the columns of conditions or without
            The predictor's inputs.
        tf_flange_tool : (4, 4) or (n, 4, 4) array [mm]
            The tool. Its point may differ from the sampled one if the predictor knows the arm.
        orientation : bool
            Whether to predict orientation together with position.
        variance : (n,) or (1,) array [mm²], optional
            The variance in each direction in addition to `unexplained`, see `not_measured`.
        lost_motion : (n, 6) array [mm², rad²], optional
            The variance of position and orientation to add, see `from_other_sides`.
        """
        more = np.zeros((1, 6)) if lost_motion is None else lost_motion
        offset = self._offset(x, tf_flange_tool)
        unexplained = self.unexplained if variance is None else self.unexplained + variance[:, None]
        if offset is None and not orientation:
            error, std = self.predictor.predict(x, return_std=True)
            return error, np.sqrt(std**2 + unexplained + more[:, :3])
        rows = slice(6 if orientation else 3)
        error, std = self._pose_predictor().predict_pose(x, return_std=True, offset=offset, unexplained=unexplained)
        std[:, 3:] = np.hypot(std[:, 3:], self.tool_turn[1])
        std = np.sqrt(std**2 + more)
        return self._with_tool_turn(x, error)[:, rows], std[:, rows]

    def predict_mean_with_tool(
        self, x: FloatArray, tf_flange_tool: FloatArray, *, orientation: bool = False
    ) -> FloatArray:
        """Return the errors of `predict_with_tool` alone, which is faster."""
        offset = self._offset(x, tf_flange_tool)
        if offset is None and not orientation:
            return self.predictor.predict(x)
        error = self._pose_predictor().predict_pose(x, offset=offset)
        return self._with_tool_turn(x, error)[:, : 6 if orientation else 3]

    def _offset(self, x: FloatArray, tf_flange_tool: FloatArray) -> FloatArray | None:
        """Return the vectors from the sampled point to that of a tool, (n, 3) [mm], base frame; None where unused."""
        away = tf_flange_tool[..., :3, 3] - self.tf_flange_sampled[:3, 3]
        if not self.knows_orientation or np.abs(away).max() == 0:
            return None
        turned = self.robot.forward(x[:, : self.robot.dof])[:, :3, :3]
        return np.asarray(np.einsum("nij,nj->ni", turned, np.broadcast_to(away, (len(x), 3))))

    @property
    def knows_orientation(self) -> bool:
        """Whether the predictor knows the arm, and so errors of orientation and of other points of the tool."""
        return self.space == "joint" and isinstance(self.predictor, PosePredictor)

    def _pose_predictor(self) -> PosePredictor:
        if self.space == "joint" and isinstance(self.predictor, PosePredictor):
            return self.predictor
        raise DataError(
            f"a map of {self.predictor_name!r} knows errors of position only; for orientation, fit one that knows "
            "the arm: truepose fit --predictor kinematic-kriging (or calibration), with joints in the samples"
        )

    @cached_property
    def tool_turn(self) -> tuple[FloatArray, float]:
        """Rotation vector (3,) [rad], tool frame, of the tool's mounting error, and its standard deviation [rad].

        The mean difference between measured and predicted orientations; zero where no orientations were measured.
        """
        samples = self.samples
        if samples.q is None or samples.rotation_meas is None or self.p_flange_sampled is not None:
            return np.zeros(3), 0.0
        error = self._pose_predictor().predict_pose(self.inputs(samples))
        nominal = Rotation.from_matrix(self.robot.forward(samples.q, tool=self.tf_flange_tool)[:, :3, :3])
        expected = Rotation.from_rotvec(error[:, 3:]) * nominal
        measured = Rotation.from_matrix(self.registration.tf_base_tracker[:3, :3]) * samples.rotation_meas
        turns = expected.inv() * measured
        mean = turns.mean()
        return mean.as_rotvec(), float((turns * mean.inv()).as_rotvec().std() / np.sqrt(len(samples)))

    def _with_tool_turn(self, x: FloatArray, error: FloatArray) -> FloatArray:
        """Return errors of poses (n, 6) that include the turn of the tool, R_meas = exp(w) R_cmd exp(t)."""
        turn, _ = self.tool_turn
        if not turn.any():
            return error
        nominal = Rotation.from_matrix(self.robot.forward(x[:, : self.robot.dof], tool=self.tf_flange_tool)[:, :3, :3])
        turned = Rotation.from_rotvec(error[:, 3:]) * nominal * Rotation.from_rotvec(turn) * nominal.inv()
        return np.concatenate([error[:, :3], turned.as_rotvec()], axis=1)
