"""Correct joint targets: forward with the nominal arm, corrected as poses, and back to the nearest joints.

The pose that joints mean is that of the map's nominal arm with the tool in force. The corrected pose is reached from
those joints by Newton's method: on the same branch, every joint within the same turn. Joints have few digits, so the
written joints miss the wanted position by the remaining distance, which is stated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry import euler, invert_transform
from truepose.programs.agreement import foreign_maker
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.joint_digits import by_form, moved_joints
from truepose.programs.core.joint_targets import MOST_JOINTS, JointForm
from truepose.programs.core.outcomes import DONE, Outcomes
from truepose.programs.core.own_arm import objections, own_robot
from truepose.programs.core.program import IDENTITY
from truepose.programs.corrector import CorrectionContext
from truepose.robots import Robot, ShownJoints, shown_joints, status_turn
from truepose.robots.inverse.branches import SINGULAR
from truepose.robots.inverse.newton import damped_newton, smallest_singular
from truepose.robots.pendant import ground_objection

_KIND: Final = "joint target"
_CORRECTED: Final = (1, 2)
_LINEARISED: Final = 1.01  # of what half a digit of each joint can move the tool, which is added up
_SHARE: Final = 0.5
"""The largest share of a correction that may remain because of the digits; beyond it the target stays nominal."""


class PosedJoints(NamedTuple):
    """Joint targets with the poses of their joints; n targets.

    Attributes
    ----------
    rows : (n,) array of int
        Their places among the targets of the program.
    columns : TargetColumns
        The targets as the program writes them.
    q : (n, dof) array [rad]
        The joints of the robot.
    poses : TargetColumns
        The same targets as poses in the base frame.
    """

    rows: IntArray
    columns: TargetColumns
    q: FloatArray
    poses: TargetColumns

    def take(self, some: IntArray) -> PosedJoints:
        """Return some of them."""
        return PosedJoints(self.rows[some], self.columns.take(some), self.q[some], self.poses.take(some))


@dataclass(frozen=True, eq=False)
class JointCorrection:
    """The joint targets of a program in the course of its correction.

    Parameters
    ----------
    outcomes : Outcomes
        The outcomes, which are filled in.
    known : CorrectionContext
        The robot of the map, and the tool of targets that name none.
    objected : str
        The verdict on a target that cannot be corrected: ``refuse`` or ``skip``.
    """

    outcomes: Outcomes
    known: CorrectionContext
    objected: str

    def posed(self) -> Iterator[PosedJoints]:
        """Yield the joint targets with poses, some thousand at a time; the outcomes say why others have none."""
        robot, joints = self.known.robot, self.outcomes.joints
        for rows, columns in self.outcomes.program.joint_columns():
            q, why = self._joints(columns)
            self.outcomes.code[rows[list(why)]] = DONE.index(self.objected)
            self.outcomes.why.update({int(rows[k]): f"{_KIND}: {reason}" for k, reason in why.items()})
            known = np.flatnonzero(np.isfinite(q).all(axis=1))
            if robot is None or joints is None or not len(known):
                continue
            rows, columns, q = rows[known], columns.take(known), q[known]
            poses = self._forward(columns, q)
            joints.p[rows], joints.change[rows] = poses[:, :3, 3], 0.0  # paths start also at those that stay nominal
            posed = PosedJoints(rows, columns, q, _as_poses(columns, robot, q, poses))
            if len(good := np.flatnonzero([k not in why for k in known.tolist()])):
                yield posed.take(good)

    def _joints(self, columns: TargetColumns) -> tuple[FloatArray, dict[int, str]]:
        """Return the robot's joints of targets, (n, dof) [rad], and the reasons why some cannot be corrected."""
        robot, n = self.known.robot, len(columns)
        assert columns.joints is not None  # these are joint targets
        if robot is None:
            return np.full((n, 1), np.nan), dict.fromkeys(range(n), "the map knows no robot")
        q, why = np.full((n, robot.dof), np.nan), dict[int, str]()
        for form, rows in by_form(columns):
            if reason := _unlike(form, robot, foreign_maker(robot, self.outcomes.program)):
                why.update(dict.fromkeys(rows.tolist(), reason))
            else:
                q[rows] = self._shown(form).to_model(form.joints(columns.joints[rows]))
                if form.arm is not None:
                    tools = columns.take(rows).tf_flange_tool(self.known.tf_flange_tool)
                    others = objections(form.arm, robot, q[rows], tools)
                    why.update({int(rows[k]): reason for k, reason in others.items()})
        known = np.flatnonzero(np.isfinite(q).all(axis=1))
        why.update({int(known[k]): reason for k, reason in _objections(robot, q[known], "is").items()})
        return q, why

    def _arm(self, form: JointForm) -> Robot:
        """Return the arm that joints of a form belong to."""
        assert self.known.robot is not None  # the targets have poses
        return self.known.robot if form.arm is None else own_robot(form.arm, self.known.robot)

    def _shown(self, form: JointForm) -> ShownJoints:
        """Return the conversion between the joints of a form and those of the model."""
        assert self.known.robot is not None  # as above
        return shown_joints(self.known.robot, ground=form.ground)

    def _forward(self, columns: TargetColumns, q: FloatArray) -> FloatArray:
        """Return the poses (n, 4, 4) [mm] of joints (n, dof) [rad], base to tool."""
        poses = columns.tf_flange_tool(self.known.tf_flange_tool)
        for form, rows in by_form(columns):
            poses[rows] = self._arm(form).forward(q[rows]) @ poses[rows]
        return poses

    def settle(
        self, posed: PosedJoints, change: FloatArray, code: NDArray[np.int8], resolution: float
    ) -> dict[int, str]:
        """Note the joints that are written; return why some are not, and change their codes.

        Parameters
        ----------
        posed : PosedJoints
            The n targets.
        change : (n, 3) array [mm] or (n, 6) array [mm, rad], base frame
            The corrections of the poses.
        code : (n,) array of int
            The verdicts by their places in `DONE`.
        resolution : float [mm]
            The step of corrections.
        """
        robot, joints = self.known.robot, self.outcomes.joints
        assert robot is not None  # the targets have poses
        assert joints is not None  # there are joint targets
        done = np.flatnonzero(np.isin(code, _CORRECTED))
        if not len(done):
            return {}
        before = posed.poses.take(done).poses_base()
        written = self._written(posed.take(done), _moved(before, change[done]))
        why, coarse = written.objections(robot, np.linalg.norm(change[done, :3], axis=1), resolution)
        for verdict, reasons in (("skip", coarse), (self.objected, why)):
            code[done[list(reasons)]] = DONE.index(verdict)
        kept = np.flatnonzero(np.isin(code[done], _CORRECTED))
        rows = posed.rows[done[kept]]
        joints.after[rows], joints.remaining[rows] = written.after[kept], written.remaining[kept]
        joints.change[rows] = written.p[kept] - before[kept, :3, 3]
        return {int(done[k]): f"{_KIND}: {reason}" for k, reason in {**coarse, **why}.items()}

    def _written(self, posed: PosedJoints, wanted: FloatArray) -> _Written:
        """Return the joints that are written for wanted poses (n, 4, 4) [mm]."""
        columns, data = posed.columns, self._data(posed.columns)
        tools = columns.tf_flange_tool(self.known.tf_flange_tool)
        change, reached = np.zeros((len(columns), MOST_JOINTS)), np.zeros(len(columns), np.bool_)
        flanges = wanted @ invert_transform(tools)
        for form, rows in by_form(columns):
            found = damped_newton(self._arm(form), flanges[rows], posed.q[rows])
            change[rows, : form.count] = form.numbers(self._shown(form).from_model(found.q - posed.q[rows]))
            reached[rows] = found.reached
        after = moved_joints(data, columns, change)
        q, p, reach = np.empty_like(posed.q), np.empty((len(columns), 3)), np.zeros(len(columns))
        for form, rows in by_form(columns):
            robot, numbers, tool = self._arm(form), after[rows, : form.count], tools[rows]
            shown = self._shown(form)
            q[rows] = shown.to_model(form.joints(numbers))
            p[rows] = (robot.forward(q[rows]) @ tool)[:, :3, 3]
            for axis in range(form.count):
                half = 0.5 * form.step * np.eye(form.count)[axis]
                beside = (robot.forward(shown.to_model(form.joints(numbers + half))) @ tool)[:, :3, 3]
                reach[rows] += np.linalg.norm(beside - p[rows], axis=1)
        return _Written(after, q, p, np.linalg.norm(p - wanted[:, :3, 3], axis=1), reach, reached)

    def _data(self, columns: TargetColumns) -> bytes:
        path = columns.path
        return next(source.data for source in self.outcomes.program.sources if source.path == path)

    def finish(self) -> None:
        """Forget what was noted for targets that are left as they are after all."""
        if (joints := self.outcomes.joints) is None:
            return
        corrected = self.outcomes.corrected
        for rows, _ in self.outcomes.program.joint_columns():
            self.outcomes.after[rows] = np.nan  # the program gives them no position
            left = rows[~corrected[rows]]
            joints.after[left], joints.remaining[left], joints.change[left] = np.nan, np.nan, 0.0


class _Written(NamedTuple):
    """Written joints: numbers (n, 6), robot's joints (n, dof) [rad], and positions (n, 3) [mm], base frame.

    `remaining` (n,) [mm] are the distances to the wanted positions, `reach` (n,) [mm] what half a digit of every joint
    can move the tool, and `found` (n,) whether joints were found for the wanted pose.
    """

    after: FloatArray
    q: FloatArray
    p: FloatArray
    remaining: FloatArray
    reach: FloatArray
    found: BoolArray

    def objections(self, robot: Robot, length: FloatArray, resolution: float) -> tuple[dict[int, str], dict[int, str]]:
        """Return why some joints must not be written, and of which others the digits are too coarse.

        `length` (n,) [mm] are the lengths of the corrections.
        """
        why = _objections(robot, self.q, "would be")
        for k in np.flatnonzero(self.remaining > np.maximum(resolution, _LINEARISED * self.reach)).tolist():
            why[k] = f"its digits would leave {self.remaining[k]:.3f} mm, more than half a digit of each can explain"
        for k in np.flatnonzero(~self.found).tolist():
            why[k] = "no joints near its own reach the corrected pose"
        coarse = np.flatnonzero((self.remaining > _SHARE * length) & (length > resolution)).tolist()
        left = "its digits are too coarse: {:.3f} mm of a correction of {:.3f} mm would remain"
        return why, {k: left.format(self.remaining[k], length[k]) for k in coarse if k not in why}


def _unlike(form: JointForm, robot: Robot, maker: str) -> str:
    """Return why joints in a form are not those of a robot; `maker`: of another robot that the program is for."""
    if form.count != robot.dof:
        return f"it has {form.count} joints, {robot.name} has {robot.dof}"
    if maker:
        return f"whether {robot.name} of {robot.maker} counts its joints as a controller of {maker} is not known"
    if form.ground and robot.coupling is None and (reason := ground_objection(robot)):
        return f"J3 counts from the ground, and {reason}: joint 3 is not J3 + J2; state coupling in its robot file"
    return ""


def _objections(robot: Robot, q: FloatArray, verb: str) -> dict[int, str]:
    """Return why joints (n, dof) [rad] cannot be corrected: limits, singularities."""
    why: dict[int, str] = {}
    sigma = smallest_singular(robot, q)
    for k in np.flatnonzero(sigma < SINGULAR).tolist():
        why[k] = f"near a singularity: smallest singular value {sigma[k]:.2g} m/rad, limit {SINGULAR:g} m/rad"
    for k, j in reversed(np.argwhere(~robot.within_limits(q)).tolist()):
        low, high = np.rad2deg(robot.limits[j])
        why[k] = f"joint {j + 1} {verb} at {np.rad2deg(q[k, j]):.3f}°, limits {low:g}° to {high:g}°"
    return dict(sorted(why.items()))


def _moved(poses: FloatArray, change: FloatArray) -> FloatArray:
    """Return poses (n, 4, 4) [mm] moved by (n, 3) [mm] or (n, 6) [mm, rad], base frame."""
    moved = poses.copy()
    moved[:, :3, 3] += change[:, :3]
    if change.shape[1] > 3:
        moved[:, :3, :3] = Rotation.from_rotvec(change[:, 3:]).as_matrix() @ poses[:, :3, :3]
    return moved


def _as_poses(columns: TargetColumns, robot: Robot, q: FloatArray, poses: FloatArray) -> TargetColumns:
    """Return targets as poses (n, 4, 4) [mm] in the base frame, with the branch of their joints (n, dof) [rad]."""
    quaternions = euler("abb", Rotation.from_matrix(poses[:, :3, :3]))
    try:
        status = status_turn(robot, q)[0]
    except RobotError:
        status = np.full(len(q), -1)  # an arm of another kind
    changed = {"controller": "abb", "tf_base_frame": IDENTITY, "configuration": "", "unit": 1.0, "joint_form": None}
    alike = list(columns.alike)
    for kind in np.unique(columns.kind).tolist():
        alike[kind] = replace(alike[kind], **changed)
    values = np.concatenate([poses[:, :3, 3], quaternions], axis=1)
    nothing, spans = np.full(len(q), -1), np.full((*values.shape, 2), -1)
    return TargetColumns(alike, columns.kind, columns.line, status, nothing, values, spans, columns.names)
