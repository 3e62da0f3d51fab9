"""The corrected commands of targets: solve (16) with the predictions of a map, and apply the guards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.compensation import Corrections, Guards, Policy, Solution, Starts, apply_policy, solve
from truepose.compensation.guards import TOO_UNCERTAIN
from truepose.error_map.approaching import approach_by_joints, approach_on_lines
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.target_joints import BranchTracker
from truepose.errors import DataError
from truepose.geometry import check_transforms, make_transform
from truepose.predictors.abilities import Differentiable
from truepose.robots import Robot
from truepose.samples import Poses, on_arm

_OTHER_SIDE: Final = "; joints come to it from a side that no sample had, so their lost motion is not known"


@dataclass(frozen=True, eq=False)
class Targets:
    """Poses that programs command, with the tool and the arm configuration of each.

    Attributes
    ----------
    p : (n, 3) array [mm], base frame
        The positions of the tool centre points.
    poses : (n, 4, 4) array [mm], base frame, optional
        The poses of the tools, where orientations are known.
    tf_flange_tool : (n, 4, 4) array [mm]
        The tool of each target.
    q : (n, dof) array [rad], optional
        The joints of the targets, where these were given.
    status, turn : (n,) arrays of int, optional
        The KUKA configuration of each target, −1 where it is not given.
    near : (n, dof) array [rad], optional
        The joints near which the controller reaches each target; NaN where they are not known.
    before : Starts, optional
        From where motions reach the targets.
    given : mapping of str to array or None
        The conditions of each target where these were stated, see `truepose.error_map.conditions.conditions_of`.
    """

    p: FloatArray
    poses: FloatArray | None
    tf_flange_tool: FloatArray
    q: FloatArray | None = None
    status: IntArray | None = None
    turn: IntArray | None = None
    near: FloatArray | None = None
    before: Starts | None = None
    given: Mapping[str, FloatArray | None] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        robot: Robot,
        given: Poses | ArrayLike,
        tf_flange_tool: ArrayLike,
        status: IntArray | None,
        turn: IntArray | None,
        near: FloatArray | None = None,
        before: FloatArray | Starts | None = None,
        load: FloatArray | None = None,
        p_load: FloatArray | None = None,
    ) -> Self:
        """Return targets given as poses (n, 4, 4), positions (n, 3), joints (n, dof), or a table of these.

        Raises
        ------
        DataError, RobotError
            If they have another shape, are not finite, or if joints come with Status and Turn.
        """
        q, p, poses = _parts(robot, given)
        n = len(next(part for part in (q, p, poses) if part is not None))
        tools = np.broadcast_to(np.asarray(tf_flange_tool, float), (n, 4, 4))
        if q is not None:
            if not all(part is None for part in (status, turn, near)):
                raise DataError("status, turn and near cannot be combined with joints, which name the configuration")
            poses = robot.forward(robot.check_joints(q)) @ tools
        if poses is not None:
            p = poses[:, :3, 3]
        assert p is not None
        if before is not None and not isinstance(before, Starts):
            before = Starts.of_lines(before)
        _sized("before", None if before is None else before.poses, (n, 4, 4))
        stated = {"payload": _sized("load", load, (n,)), "centre": _sized("p_load", p_load, (n, 3))}
        if load is not None and (np.isinf(load) | (np.asarray(load) < 0.0)).any():
            raise DataError("load has a mass that is negative or infinite; state kg, or NaN for the payload at work")
        if isinstance(given, Poses):
            if load is not None or p_load is not None:
                raise DataError("load and p_load cannot be combined with a table of poses, which states them itself")
            own = {"approach": given.approach, "temperature": given.temperature}
            stated = {**own, "payload": given.load, "centre": given.p_load}
        return cls(p, poses, tools, q, status, turn, near, before, stated)

    def branches(self, robot: Robot, q_samples: FloatArray | None, *, needed: bool) -> BranchTracker | None:
        """Return the tracker of the targets' joints; None where these are neither needed nor known."""
        if self.poses is None or q_samples is None or not (needed or robot.dof <= 6):
            return None
        return BranchTracker(
            robot, self.poses, self.tf_flange_tool, q_samples, self.status, self.turn, near=self.near, q=self.q
        )

    def approach(self, robot: Robot, branches: BranchTracker | None) -> FloatArray | None:
        """Return the sign of each joint's last motion, (n, dof); 0 where not known, None if nothing is stated."""
        stated, start = self.given.get("approach"), self.before
        if stated is not None or branches is None or start is None or self.poses is None:
            return stated
        signs = approach_on_lines(robot, branches.q_target, self.poses, start.poses)
        if len(rows := np.flatnonzero(start.by_joints & start.known)):
            q, of = branches.q_target[rows], start.take(rows)
            near = np.where((of.status < 0)[:, None], q, np.nan)
            at = BranchTracker(robot, of.poses, self.tf_flange_tool[rows], q, of.status, of.turn, near=near)
            signs[rows] = approach_by_joints(q, np.where(at.lost[:, None], np.nan, at.q_target))
        return signs


def _sized(name: str, values: FloatArray | None, shape: tuple[int, ...]) -> FloatArray | None:
    """Return an array that has a row for each target."""
    if values is not None and np.shape(values) != shape:
        raise DataError(f"{name} has shape {np.shape(values)}; expected {shape}, one for each target")
    return values


def _parts(robot: Robot, given: Poses | ArrayLike) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
    """Return joints, positions and poses of targets, each where it was given."""
    if isinstance(given, Poses):
        given = on_arm(given, robot)
        if given.q is not None or given.rotation_cmd is None:
            return given.q, given.p_cmd, None
        return None, None, make_transform(given.rotation_cmd, given.p_cmd)
    targets = np.asarray(given, float)
    if targets.ndim != 2:
        return None, None, check_transforms("targets", targets)
    if targets.shape[1] not in (3, robot.dof) or not np.isfinite(targets).all():
        raise DataError(
            f"expected poses (n, 4, 4), positions (n, 3) or joints (n, {robot.dof}), all finite; got targets of shape "
            f"{targets.shape}"
        )
    return (None, targets, None) if targets.shape[1] == 3 else (targets, None, None)


def correct(
    error_map: PredictingMap, targets: Targets, guards: Guards, policy: Policy, *, orientation: bool
) -> Corrections:
    """Return the guarded commands of targets; see `truepose.ErrorMap.correct`.

    Raises
    ------
    DataError
        If the map needs poses and positions were given, or knows no orientation.
    """
    cartesian = error_map.space == "cartesian"
    if targets.poses is None and (orientation or not cartesian):
        raise DataError(f"a map of {error_map.predictor_name!r} needs poses (n, 4, 4), for their joints")
    branches = targets.branches(error_map.robot, error_map.samples.q, needed=not cartesian)
    start = np.concatenate([targets.p, np.zeros((len(targets.p), 3 * orientation))], axis=1)
    approach = targets.approach(error_map.robot, branches)
    conditions = error_map.condition_columns(len(targets.p), {**targets.given, "approach": approach})
    solution = _solve(error_map, targets, branches, start, conditions)
    x = solution.command[:, :3] if cartesian or branches is None else branches.q
    inputs = np.concatenate([x, conditions], axis=1)
    variance = error_map.not_measured({name: targets.given.get(name) for name in ("temperature", "payload")})
    joints = targets.q if branches is None else branches.q_target
    lost = error_map.from_other_sides(joints, approach, targets.tf_flange_tool)
    _, std = error_map.predict_with_tool(
        inputs, targets.tf_flange_tool, orientation=orientation, variance=variance, lost_motion=lost
    )
    reasons = _reasons(error_map, targets, branches, guards, x, std, solution)
    if lost is not None:
        mostly = np.sum(lost[:, :3], axis=1) > 0.5 * np.sum(std[:, :3] ** 2, axis=1)
        reasons = [
            why + _OTHER_SIDE if most and why.startswith(TOO_UNCERTAIN) else why
            for why, most in zip(reasons, mostly, strict=True)
        ]
    change = solution.command - start
    share, verdict, reason = apply_policy(change, std, reasons, guards.limits, policy)
    change *= share[:, None]
    return Corrections(
        p_target=targets.p,
        p_command=targets.p + change[:, :3],
        p_mirror=solution.mirror[:, :3],
        e=solution.error[:, :3],
        std=std[:, :3],
        verdict=verdict,
        reason=reason,
        rotation=change[:, 3:] if orientation else None,
        rotation_mirror=solution.mirror[:, 3:] if orientation else None,
        rotation_std=std[:, 3:] if orientation else None,
    )


def _solve(
    error_map: PredictingMap,
    targets: Targets,
    branches: BranchTracker | None,
    start: FloatArray,
    conditions: FloatArray,
) -> Solution:
    """Solve (16) from targets (n, 3) [mm] or (n, 6) [mm, rad], under conditions (n, c)."""
    orientation = start.shape[1] > 3

    def predict(command: FloatArray, rows: IntArray) -> FloatArray:
        if error_map.space == "cartesian":
            x = command[:, :3]
        else:
            assert branches is not None
            x = np.concatenate([branches.joints(command, rows), conditions[rows]], axis=1)
        return error_map.predict_mean_with_tool(x, targets.tf_flange_tool[rows], orientation=orientation)

    predictor = error_map.predictor
    if error_map.space == "cartesian" and isinstance(predictor, Differentiable):
        return solve(start, predict, lambda command, _rows: predictor.gradient(command))
    return solve(start, predict)


def _reasons(
    error_map: PredictingMap,
    targets: Targets,
    branches: BranchTracker | None,
    guards: Guards,
    x: FloatArray,
    std: FloatArray,
    solution: Solution,
) -> list[str]:
    """Return the guards' reasons: those of the predictor's space, then those of the joints."""
    cartesian = error_map.space == "cartesian"
    more: dict[str, Any] = {}  # in joint space orientation and branch are in the distance to the samples
    if cartesian:
        rotation = None if targets.poses is None else Rotation.from_matrix(targets.poses[:, :3, :3])
        more = {"rotation": rotation, "status": targets.status}
    points = None if error_map.knows_orientation else targets.tf_flange_tool[:, :3, 3]
    unit = "mm" if cartesian else "rad"
    reasons = guards.reasons(x, unit, std, solution.converged, p_flange_tool=points, **more)
    if branches is None:
        return reasons
    if cartesian:
        branches.joints(solution.command, np.arange(len(x)))
    first, second = (reasons, branches.reasons()) if cartesian else (branches.reasons(), reasons)
    return [one or other for one, other in zip(first, second, strict=True)]
