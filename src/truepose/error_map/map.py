"""A fitted map of a cell's errors: registration, tool and predictor in one, from samples to corrections.

A map is made by `truepose.fit_cell`, asked by `ErrorMap.predict_measured` and `ErrorMap.correct`, and kept in a file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._io import files
from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.compensation import (
    Corrections,
    Guards,
    Limits,
    LimitsInForce,
    Policy,
    Solution,
    apply_policy,
    solve,
    supported_angle,
)
from truepose.error_map.arm_check import UNCHECKED, ArmCheck, check_arm
from truepose.error_map.guards import arm_branches, found_limits, stated_limits
from truepose.error_map.registration import check_limits, reading_noise
from truepose.error_map.selection import CellSamples
from truepose.error_map.target_joints import Follower
from truepose.error_map.worth import FEW, LeftOut, Worth, worth
from truepose.errors import DataError, RefusedError
from truepose.geometry import Registration, apply_transform, check_transforms, invert_transform
from truepose.predictors import PREDICTORS, PosePredictor, Predictor
from truepose.robots import Robot
from truepose.samples import Poses, Samples
from truepose.verification import RP_PER_STD, usual_groups
from truepose.verification import held_out as verify

if TYPE_CHECKING:
    from truepose.error_map.update import Recheck


@dataclass(frozen=True, eq=False, repr=False)
class ErrorMap:
    """What is known of the positional errors of one cell; made by `fit_cell`.

    Attributes
    ----------
    cell : Cell
    robot : Robot
        Nominal.
    samples : Samples
        That the map was fitted to, outliers taken out.
    registration : Registration
        Tracker frame to base frame; every error of this map is after it.
    tf_flange_tool : (4, 4) array [mm]
        Flange to the measured point, fitted or as the cell says.
    predictor_name : str
    predictor : Predictor
        Fitted; in Cartesian space (commanded positions [mm]) or joint space ([rad]), see `space`.
    ranking : list of dict
        How the candidates of ``auto`` did in cross-validation, that which was taken first; empty when a predictor was
        named. See `truepose.predictors.Choice`, for ``expected``, too.
    expected : dict
        What ``auto`` itself leaves on samples that it has not seen; empty when a predictor was named.
    excluded : list of dict
        Samples left out of the fit, by ``row``, with the reason.
    campaign : dict
        What the tests of the measuring campaign found: ``tested`` samples, ``limit_mm``, ``suspected_drift_mm`` and
        ``faults``, each with its ``words``; see `truepose.error_map.campaign.CampaignCheck`. Empty for a map that was
        saved before such tests.
    p_flange_sampled : (3,) array [mm], optional
        Where the samples were measured, if the tool has been changed since: see `update`.
    arm_check : ArmCheck
        What commanded positions said of the arm's model and the tool, or that none came.
    known_worth : Worth, optional
        What `fit_cell` found the map to be worth; None in maps of earlier versions and after new samples joined.
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
    known_worth: Worth | None = None

    def __repr__(self) -> str:
        checked = "checked" if self.arm_check.checked else "not checked"
        weak = "; weak: not shown to be better than none" if self.worth.weak else ""
        return (
            f"<ErrorMap of {self.robot.name}: {self.predictor_name}, {len(self.samples)} samples; "
            f"arm and tool {checked}{weak}>"
        )

    @cached_property
    def worth(self) -> Worth:
        """Whether the map is better than no map, on blocks of samples that it was fitted without."""
        if self.known_worth is not None:
            return self.known_worth
        return worth(self.p_cmd, self.e, self._without)

    def _without(self, block: IntArray) -> LeftOut:
        """Return what is left of the samples' errors without their blocks, see `LeftOut`."""
        measured = CellSamples(self.cell, self.robot, self.samples, accepted=True)
        found = LeftOut(np.empty_like(self.e), np.empty_like(self.e))
        for k in np.unique(block):
            out, known = np.flatnonzero(block == k), np.flatnonzero(block != k)
            errors = measured.registered_by(known)
            found.alone[out] = errors.e[out]
            if len(block) <= FEW:
                predictor, _ = errors.fit(self.predictor_name, known)
                found.left[out] = errors.e[out] - predictor.predict(errors.coordinates[self.space][out])
        if len(block) > FEW:
            found.left[:] = self.predictor.leave_blocks_out(block).residual
        return found

    @property
    def space(self) -> str:
        """``cartesian`` or ``joint``: what the predictor takes."""
        return PREDICTORS[self.predictor_name].space

    @property
    def tool_fitted(self) -> bool:
        """Whether the tool point was found together with the station."""
        return self.registration.p_flange_tool is not None

    @cached_property
    def p_cmd(self) -> FloatArray:
        """Commanded positions of the samples, (n, 3) [mm], base frame."""
        return self._commanded(self.samples, self.tf_flange_sampled)

    @property
    def tf_flange_sampled(self) -> FloatArray:
        """Flange to the point where the samples were measured, (4, 4) [mm]; the tool, unless it was changed since."""
        tf = self.tf_flange_tool.copy()
        if self.p_flange_sampled is not None:
            tf[:3, 3] = self.p_flange_sampled
        return tf

    @cached_property
    def e(self) -> FloatArray:
        """Positional errors of the samples after registration, (n, 3) [mm], base frame."""
        return apply_transform(self.registration.tf_base_tracker, self.samples.p_meas) - self.p_cmd

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the map's file."""
        return hashlib.sha256(self._bytes).hexdigest()

    def commanded_positions(self, poses: Poses) -> FloatArray:
        """Return where the nominal model puts the measured point, (n, 3) [mm], base frame.

        Raises
        ------
        DataError
            If the tool was fitted and there are no joints, or neither joints nor positions.
        RobotError
            If joints are beyond the robot's limits.
        """
        return self._commanded(poses, self.tf_flange_tool)

    def _commanded(self, poses: Poses, tf_flange_tool: FloatArray) -> FloatArray:
        if poses.q is not None:
            check_limits(self.robot, poses)
            p_cmd: FloatArray = self.robot.forward(poses.q, tool=tf_flange_tool)[:, :3, 3]
            return p_cmd
        if self.tool_fitted:
            raise DataError(
                f"{poses.source}: the map's tool was fitted, so joints (q1_deg …) are needed, not positions"
            )
        assert poses.p_cmd is not None  # Poses holds one of them
        return poses.p_cmd

    def errors(self, samples: Samples) -> FloatArray:
        """Return measured − commanded of any samples after this map's registration, (n, 3) [mm], base frame.

        Raises
        ------
        DataError
            If commanded positions of the samples prove another tool than this map's.
        """
        fitted = self.tool_fitted or self.p_flange_sampled is not None
        check_arm(self.robot, samples, self.tf_flange_tool, fit="pose" if fitted else "none")
        return apply_transform(self.registration.tf_base_tracker, samples.p_meas) - self.commanded_positions(samples)

    @cached_property
    def unexplained(self) -> FloatArray:
        """Variance of what the arm does beyond the predictor's field, in each direction, (3,) [mm²], base frame.

        The predictor's nugget less what is known of repeatability; the noise of readings is not in the nugget where it
        is known. What is not known is not taken off, and counts as error of the arm. A nugget is taken one standard
        error larger than it was estimated: near the repeatability, the difference is mostly that error. A drift that
        the tests of the campaign found or suspect comes on top, also below their limit, and twice: it goes on after the
        campaign, as an arm does that warmed up while it was measured.
        """
        faults = self.campaign.get("faults", [])
        sizes = [fault["size"] for fault in faults if fault["kind"] in ("drift", "moved")]
        drift = sum((2.0 * size) ** 2 for size in (*sizes, self.campaign.get("suspected_drift_mm", 0.0))) / 3.0
        nugget, known = self._nugget_and_known
        return np.asarray(nugget - known + drift)

    @cached_property
    def _nugget_and_known(self) -> tuple[FloatArray, FloatArray]:
        """The nugget with one standard error, that of a variance of 3n readings; what of it is known, (3,) [mm²]."""
        nugget, reading = self.predictor.nugget_, self.predictor.noise_std_
        noise = 0.0 if reading is None else np.mean(reading**2, axis=0)
        nugget = np.where(nugget > 0.0, nugget + np.sqrt(2.0 / (3 * len(self.samples))) * (nugget + noise), 0.0)
        repeatability = (self.cell.robot.repeatability_mm or 0.0) / RP_PER_STD
        return nugget, np.minimum(nugget, repeatability**2)

    def predict_errors(self, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors and their deviation at commanded poses, both (n, 3) [mm], base frame.

        The deviation is the standard deviation of what the prediction leaves of the true error: what guards, records
        and reports speak of. Its variance is that of the predictor's field, with what is `unexplained`; the noise of
        one motion and of one reading is not in it, see `predict_reading`.
        """
        return self.predict_at(self.coordinates(poses))

    def predict_at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `predict_errors` at coordinates of the predictor, (n, 3) [mm] or (n, dof) [rad]."""
        e, std = self._predict(x, self.tf_flange_tool, return_std=True)
        return e, std

    def predict_reading(self, samples: Samples) -> tuple[FloatArray, FloatArray]:
        """Return what errors (n, 3) [mm] are expected of new samples, and the std of that with a reading's noise."""
        e, std = self.predict_errors(samples)
        known = self.reading_noise(samples)
        return e, np.sqrt(std**2 + self._nugget_and_known[1] + (0.0 if known is None else known**2))

    def reading_noise(self, samples: Samples) -> FloatArray | None:
        """Return what is known beforehand of the noise of new samples, (n, 3) [mm], base frame: see `reading_noise`.

        That of the map's own in the mean where they tell nothing; None where the map was fitted without.
        """
        own = self.predictor.noise_std_
        if own is None:
            return None
        known = reading_noise(self.cell, samples, self.registration)
        return np.broadcast_to(np.sqrt(np.mean(own**2, axis=0)), (len(samples), 3)) if known is None else known

    def predict_measured(self, q: ArrayLike | Poses) -> tuple[FloatArray, FloatArray]:
        """Predict where the tracker will see the measured point.

        Parameters
        ----------
        q : (n, dof) array [rad], or Poses
            Commanded configurations; Poses may instead hold commanded positions for a map in Cartesian space.

        Returns
        -------
        p : (n, 3) array [mm], tracker frame
        std : (n, 3) array [mm], tracker frame
            The deviation of `predict_errors`; the noise of a reading comes on top.
        """
        poses = q if isinstance(q, Poses) else Poses(q=np.atleast_2d(np.asarray(q, float)), source="poses")
        e, std = self.predict_errors(poses)
        tf_tracker_base = invert_transform(self.registration.tf_base_tracker)
        p = apply_transform(tf_tracker_base, self.commanded_positions(poses) + e)
        return p, np.sqrt(std**2 @ (tf_tracker_base[:3, :3] ** 2).T)

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return residuals of each sample predicted from the others, and their standard deviation, (n, 3) [mm].

        The registration and the hyperparameters are those of all samples.
        """
        return self.predictor.leave_one_out()

    def validate(self, held_out: Samples) -> dict[str, Any]:
        """Compare errors before and after on samples that took no part in the fit.

        Returns
        -------
        dict
            As `truepose.verification.HeldOut.to_dict` (intervals hold prediction and noise), with ``seen``: how many of
            the samples are in the map; and ``worth``: what was found of the map itself, see `Worth`.
        """
        e = self.errors(held_out)
        expected, std = self.predict_reading(held_out)
        groups = usual_groups(self.commanded_positions(held_out), q=held_out.q, robot=self.robot, time=held_out.time)
        figures = verify(e, e - expected, std, noise=self._noise(held_out), groups=groups)
        known = {row.tobytes() for row in self.samples.p_meas}
        seen = sum(row.tobytes() in known for row in held_out.p_meas)
        return {**figures.to_dict(), "seen": seen, "worth": self.worth.to_dict()}

    def _noise(self, samples: Samples) -> FloatArray | None:
        """Return the std of repeatability and reading together, (n, 3) [mm], base frame; None unless both are known."""
        reading = reading_noise(self.cell, samples, self.registration)
        repeatability = self.cell.robot.repeatability_mm
        if reading is None or repeatability is None:
            return None
        return np.asarray(np.sqrt(reading**2 + (repeatability / RP_PER_STD) ** 2))

    def predict_pose_errors(self, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors of position and orientation at commanded configurations, and their std.

        Returns
        -------
        error : (n, 6) array [mm, rad], base frame
            e, and w, the rotation vector of R_meas R_cmdᵀ.
        std : (n, 6) array [mm, rad], base frame
            The deviation, as of `predict_errors`; what is `unexplained` turns the tool as well.

        Raises
        ------
        DataError
            If the map knows positions only, or there are no joints.
        """
        error, std = self._predict(self.coordinates(poses), self.tf_flange_tool, return_std=True, orientation=True)
        return error, std

    def recheck(self, samples: Samples) -> Recheck:
        """Test whether this map still holds for new samples, and what may have happened: see `Recheck`."""
        from truepose.error_map.update import recheck

        return recheck(self, samples)

    def update(self, samples: Samples, refit: Literal["station", "tool", "both"] | None = None) -> ErrorMap:
        """Return this map with new samples taken in: see `truepose.error_map.update.update_map`."""
        from truepose.error_map.update import update_map

        return update_map(self, samples, refit)

    def correct(
        self,
        poses: ArrayLike,
        *,
        tf_flange_tool: ArrayLike | None = None,
        status: IntArray | None = None,
        turn: IntArray | None = None,
        on_guard: Policy | None = None,
        limits: LimitsInForce | None = None,
        orientation: bool = False,
        accept_weak_map: bool = False,
    ) -> Corrections:
        """Return the commands whose predicted outcome is the target (16), guarded.

        Parameters
        ----------
        poses : (n, 4, 4) array [mm]
            Targets, base to tool centre point; or (n, 3) positions at the samples' orientation.
        tf_flange_tool : (n, 4, 4) or (4, 4) array [mm], optional
            The tool of each target; the measured one when not given.
        status, turn : (n,) arrays of int, optional
            KUKA configuration of each target, −1 where it is not given.
        on_guard : {"refuse", "skip", "clip"}, optional
            The policy, instead of the one that `limits` names. Under ``refuse`` the verdicts say which targets refuse
            the program; the caller stops then.
        limits : LimitsInForce, optional
            See `limits_in_force`; by default those of the map's own cell.
        orientation : bool
            Solve for orientation together with position: R_c = exp(−ŵ) R_t.
        accept_weak_map : bool
            Use the map although nothing shows that it is better than no map (see `worth`), or although its predictor
            has one standard deviation for all poses, as interpolators have.

        Returns
        -------
        Corrections

        Raises
        ------
        RefusedError
            If the map is weak, unless that is accepted.
        DataError
            If a target is no pose; if the map predicts in joint space or orientation is asked for, and only positions
            came; if the map knows no orientation.

        Notes
        -----
        A predictor in joint space is asked at the joints by which the controller reaches the command: on the branch
        that Status and Turn name, or on that of the nearest sample where they are not given.
        """
        if not accept_weak_map:
            self._refuse_to_correct()
        p_target, targets = self._targets(poses, positions_suffice=self.space == "cartesian" and not orientation)
        n = len(p_target)
        limits = limits or self.limits_in_force()
        guards = self.guards_of(limits.limits)
        tools = np.broadcast_to(self.tf_flange_tool if tf_flange_tool is None else tf_flange_tool, (n, 4, 4))
        follower = self._follower(targets, tools, status, turn)

        def coordinates(command: FloatArray, rows: IntArray) -> FloatArray:
            if self.space == "cartesian":
                return command[:, :3]
            assert follower is not None
            return follower.joints(command, rows)

        start = np.concatenate([p_target, np.zeros((n, 3 * orientation))], axis=1)
        slope = getattr(self.predictor, "gradient", None) if self.space == "cartesian" else None
        solution = solve(
            start,
            lambda command, rows: self._predict(coordinates(command, rows), tools[rows], orientation=orientation),
            None if slope is None else lambda command, _rows: slope(command),
        )
        x = solution.command[:, :3] if self.space == "cartesian" or follower is None else follower.q
        _, std = self._predict(x, tools, return_std=True, orientation=orientation)
        reasons = self._reasons(guards, x, std, solution, targets, tools, status, follower)
        change = solution.command - start
        share, verdict, reason = apply_policy(change, std, reasons, guards.limits, on_guard or limits.on_guard)
        change *= share[:, None]
        return Corrections(
            p_target=p_target,
            p_command=p_target + change[:, :3],
            p_mirror=solution.mirror[:, :3],
            e=solution.error[:, :3],
            std=std[:, :3],
            verdict=verdict,
            reason=reason,
            rotation=change[:, 3:] if orientation else None,
            rotation_mirror=solution.mirror[:, 3:] if orientation else None,
            rotation_std=std[:, 3:] if orientation else None,
        )

    def _refuse_to_correct(self) -> None:
        """Raise RefusedError where corrections of this map cannot be relied on."""
        if self.worth.weak:
            why, remedy = self.worth.words, "measure more samples, try another predictor"
        elif not self.predictor.has_local_std:
            why = f"{self.predictor_name} has one standard deviation for all poses, so no guard can tell where it fails"
            remedy = "fit a Kriging or kinematic predictor"
        else:
            return
        raise RefusedError(f"{why}; {remedy}, or accept it with --accept-weak-map (Python: accept_weak_map=True)")

    def _follower(
        self, targets: FloatArray | None, tools: FloatArray, status: IntArray | None, turn: IntArray | None
    ) -> Follower | None:
        """Return what follows the targets in joint space; None where nothing needs it and it cannot be."""
        if targets is None or self.samples.q is None or (self.space == "cartesian" and self.robot.dof > 6):
            return None
        return Follower(self.robot, targets, tools, self.samples.q, status, turn)

    def _reasons(
        self,
        guards: Guards,
        x: FloatArray,
        std: FloatArray,
        solution: Solution,
        targets: FloatArray | None,
        tools: FloatArray,
        status: IntArray | None,
        follower: Follower | None,
    ) -> list[str]:
        """Return the guards' reasons: those of the predictor's space, then those of the joints."""
        cartesian: dict[str, Any] = {}  # in joint space orientation and branch are in the distance to the samples
        if self.space == "cartesian":
            rotation = None if targets is None else Rotation.from_matrix(targets[:, :3, :3])
            cartesian = {"rotation": rotation, "status": status}
        unit = "mm" if self.space == "cartesian" else "rad"
        points = None if self._knows_orientation else tools[:, :3, 3]
        reasons = guards.reasons(x, unit, std, solution.converged, p_flange_tool=points, **cartesian)
        if follower is None:
            return reasons
        if self.space == "cartesian":
            follower.joints(solution.command, np.arange(len(x)))
        of_joints = follower.reasons()
        if self.space == "cartesian":
            return [first or second for first, second in zip(reasons, of_joints, strict=True)]
        return [second or first for first, second in zip(reasons, of_joints, strict=True)]

    def _predict(
        self, x: FloatArray, tf_flange_tool: FloatArray, *, return_std: bool = False, orientation: bool = False
    ) -> Any:
        """Ask the predictor, at another point of the tool than the sampled one where it knows the arm.

        The standard deviation is that of `predict_errors`.
        """
        rows = slice(None) if orientation else slice(3)
        if orientation and not self._knows_orientation:
            raise DataError(
                f"a map of {self.predictor_name!r} knows errors of position only; for orientation, fit one that knows "
                "the arm: truepose fit --predictor kinematic-kriging (or calibration), with joints in the samples"
            )
        away = tf_flange_tool[..., :3, 3] - self.tf_flange_sampled[:3, 3]
        offset = None
        if self._knows_orientation and np.abs(away).max() > 0:
            turned = self.robot.forward(x)[:, :3, :3]
            offset = np.einsum("nij,nj->ni", turned, np.broadcast_to(away, (len(x), 3)))
        if offset is None and not orientation:
            if not return_std:
                return self.predictor.predict(x)
            error, std = self.predictor.predict(x, return_std=True)
            return error, np.sqrt(std**2 + self.unexplained)
        predict_pose: Callable[..., Any] = self.predictor.predict_pose
        if not return_std:
            return self._with_tool_turn(x, predict_pose(x, offset=offset))[:, rows]
        error, std = predict_pose(x, return_std=True, offset=offset, unexplained=self.unexplained)
        std[:, 3:] = np.hypot(std[:, 3:], self.tool_turn[1])
        return self._with_tool_turn(x, error)[:, rows], std[:, rows]

    @cached_property
    def tool_turn(self) -> tuple[FloatArray, float]:
        """Rotation vector (3,) [rad], tool frame, by which the tool is mounted askew, and its std [rad].

        The mean of what measured orientations are beside those predicted; zero where none were measured.
        """
        samples = self.samples
        if samples.q is None or samples.rotation_meas is None or self.p_flange_sampled is not None:
            return np.zeros(3), 0.0
        error = self.predictor.predict_pose(samples.q)
        nominal = Rotation.from_matrix(self.robot.forward(samples.q, tool=self.tf_flange_tool)[:, :3, :3])
        expected = Rotation.from_rotvec(error[:, 3:]) * nominal
        measured = Rotation.from_matrix(self.registration.tf_base_tracker[:3, :3]) * samples.rotation_meas
        turns = expected.inv() * measured
        mean = turns.mean()
        return mean.as_rotvec(), float((turns * mean.inv()).as_rotvec().std() / np.sqrt(len(samples)))

    def _with_tool_turn(self, x: FloatArray, error: FloatArray) -> FloatArray:
        """Return errors of poses (n, 6) with the turn of the tool in them, R_meas = exp(w) R_cmd exp(t)."""
        turn, _ = self.tool_turn
        if not turn.any():
            return error
        nominal = Rotation.from_matrix(self.robot.forward(x, tool=self.tf_flange_tool)[:, :3, :3])
        turned = Rotation.from_rotvec(error[:, 3:]) * nominal * Rotation.from_rotvec(turn) * nominal.inv()
        return np.concatenate([error[:, :3], turned.as_rotvec()], axis=1)

    @property
    def _knows_orientation(self) -> bool:
        return self.space == "joint" and isinstance(self.predictor, PosePredictor)

    def _targets(self, poses: ArrayLike, positions_suffice: bool) -> tuple[FloatArray, FloatArray | None]:
        """Return positions (n, 3) and, where they came, poses (n, 4, 4) of targets."""
        targets = np.asarray(poses, float)
        if targets.ndim != 2:
            targets = check_transforms("targets", targets)
            return targets[:, :3, 3], targets
        if targets.shape[1:] != (3,) or not np.isfinite(targets).all():
            raise DataError(
                f"targets of shape {targets.shape} came; finite (n, 3) positions or (n, 4, 4) poses were expected"
            )
        if not positions_suffice:
            raise DataError(f"a map of {self.predictor_name!r} needs poses (n, 4, 4), for their joints")
        return targets, None

    def limits_in_force(self, cell: Cell | None = None, **options: Any) -> LimitsInForce:
        """Return the limits of corrections and who stated each.

        An option wins over the cell file, the cell file over this map's own cell, and that over the defaults; each
        origin replaces only the settings that it states.

        Parameters
        ----------
        cell : Cell, optional
            A cell file that is used instead of the map's own.
        **options
            Settings of ``[correction]`` that were asked for, by key; None is not stated.

        Raises
        ------
        DataError
            If a stated limit can have no effect on this map.
        """
        limits = stated_limits(self.cell, cell, options, self.space)
        stated = self.cell if cell is None or cell.robot.repeatability_mm is None else cell
        repeatability = stated.robot.repeatability_mm
        limits = found_limits(limits, self.guards_of(limits.limits), self.space, repeatability)
        if self.space == "cartesian" and self.rotation is not None:
            angle = float(np.rad2deg(self.supported_angle))
            limits = limits.at_most("max_angle_deg", angle, "as far as the samples' orientations support it")
        return limits

    @cached_property
    def rotation(self) -> Rotation | None:
        """Orientations of the tool at the samples, base frame; None where nothing is known of them."""
        if self.samples.q is None:
            return self.samples.rotation_cmd
        return Rotation.from_matrix(self.robot.forward(self.samples.q, tool=self.tf_flange_tool)[:, :3, :3])

    @cached_property
    def supported_angle(self) -> float:
        """How far from the samples' orientations a map in Cartesian space may be asked [rad]: see `supported_angle`."""
        if self.rotation is None:
            raise DataError(f"{self.samples.source}: nothing is known of the samples' orientations")
        return supported_angle(self.predictor.leave_blocks_out, self.rotation)

    def guards_of(self, limits: Limits) -> Guards:
        """Return the guards of corrections under some limits."""
        if limits not in self._guards:
            status, point = arm_branches(self.robot, self.samples), self.tf_flange_sampled[:3, 3]
            self._guards[limits] = Guards(self.coordinates(self.samples), limits, point, self.rotation, status)
        return self._guards[limits]

    @cached_property
    def _guards(self) -> dict[Limits, Guards]:
        return {}

    @cached_property
    def _bytes(self) -> bytes:
        from truepose.error_map.file import to_bytes

        return to_bytes(self)

    def save(self, path: str | Path) -> None:
        """Write the map to a file (zip of JSON and .npy), whole or not at all."""
        files.write_atomic(path, self._bytes)

    def coordinates(self, poses: Poses) -> FloatArray:
        """Return what the predictor takes, (n, 3) [mm] or (n, dof) [rad]."""
        return predictor_coordinates(self.space, poses, self.commanded_positions(poses))


def predictor_coordinates(space: str, poses: Poses, p_cmd: FloatArray) -> FloatArray:
    """Return the coordinates of poses in a predictor's space: commanded positions [mm], or joints [rad].

    Raises
    ------
    DataError
        If joints are asked for and there are none.
    """
    if space == "cartesian":
        return p_cmd
    if poses.q is None:
        raise DataError(f"{poses.source}: a predictor in joint space needs joints (q1_deg …)")
    return poses.q
