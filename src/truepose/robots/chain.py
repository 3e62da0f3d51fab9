"""Serial chains of revolute joints: nominal parameters and forward kinematics on arrays, theory (1) and (2).

Every convention is reduced to fixed transforms between rotations about z. This module does not import the functions
on chains; `truepose.robots.robot.Robot` adds the methods that need them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import BoolArray, FloatArray
from truepose.errors import DataError, RobotError
from truepose.geometry.arrays import as_floats, check_finite, name_rows
from truepose.geometry.transforms import axis_rotation, axis_translation, check_transforms, make_transform
from truepose.robots.coupling import Coupling, check_coupling
from truepose.robots.data_sheet import DataSheet

LinkConvention = Literal["mdh", "dh"]
LINK_CONVENTIONS: tuple[LinkConvention, ...] = ("mdh", "dh")

ChainT = TypeVar("ChainT", bound="Chain")

_CHUNK = 2048  # poses at once, so that their transforms stay in the cache
_LIMIT_ROUNDING = 1e-9  # rad, by which a joint may exceed its limit


def _not_given() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True, eq=False, repr=False)
class Chain:
    """The nominal parameters of a serial arm, and its forward kinematics.

    `truepose.robots.Robot` describes the parameters; functions of this package take either class.
    """

    name: str
    alpha: FloatArray
    a: FloatArray
    d: FloatArray
    offset: FloatArray
    beta: FloatArray = field(default_factory=_not_given)
    sign: FloatArray = field(default_factory=_not_given)
    limits: FloatArray = field(default_factory=_not_given)
    gear_ratio: FloatArray = field(default_factory=_not_given)
    coupling: Coupling | None = None
    convention: LinkConvention = "mdh"
    tf_base_first: FloatArray = field(default_factory=_not_given)
    tf_last_flange: FloatArray = field(default_factory=_not_given)
    maker: str = ""
    model: str = ""
    source: str = ""
    data_sheet: DataSheet | None = None

    def __post_init__(self) -> None:
        dof = np.size(self.alpha)
        absent = {
            "beta": np.zeros(dof),
            "sign": np.ones(dof),
            "limits": np.tile([-np.inf, np.inf], (dof, 1)),
            "tf_base_first": np.eye(4),
            "tf_last_flange": np.eye(4),
        }
        for key in ("alpha", "a", "d", "offset", "gear_ratio", *absent):
            given = np.array(getattr(self, key), dtype=np.float64)
            array = given if given.size else absent.get(key, given)
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        self._check(dof)

    def _check(self, dof: int) -> None:
        if dof < 1:
            raise RobotError(f"{self.name}: no joints; expected at least one")
        if self.convention not in LINK_CONVENTIONS:
            known = '"mdh" (Craig\'s modified D-H) or "dh" (standard D-H)'
            raise RobotError(f'{self.name}: unknown convention "{self.convention}"; expected {known}')
        for key in ("alpha", "a", "d", "offset", "beta", "sign"):
            array = getattr(self, key)
            if array.shape != (dof,) or not np.isfinite(array).all():
                raise RobotError(f"{self.name}: {key} must be {dof} finite numbers, one for each joint; got {array}")
        self._check_gears(dof)
        if self.coupling is not None:
            try:
                object.__setattr__(self, "coupling", check_coupling(self.coupling, dof))
            except RobotError as error:
                raise RobotError(f"{self.name}: {error}") from None
        if not np.isin(self.sign, (-1.0, 1.0)).all():
            raise RobotError(f"{self.name}: sign must be -1 or +1 for each joint; got {self.sign}")
        if self.convention == "dh" and self.beta.any():
            raise RobotError(f'{self.name}: beta needs the convention "mdh"; standard D-H has no beta')
        if self.limits.shape != (dof, 2):
            raise RobotError(f"{self.name}: limits must have shape ({dof}, 2); got {self.limits.shape}")
        if not (valid := self.limits[:, 0] < self.limits[:, 1]).all():
            joint = int(np.argmin(valid))
            low, high = np.rad2deg(self.limits[joint])
            raise RobotError(
                f"{self.name}: joint {joint + 1}: the lower limit {low:g}° is not below the upper {high:g}°"
            )
        for key in ("tf_base_first", "tf_last_flange"):
            try:
                check_transforms(key, getattr(self, key)[None])
            except DataError as error:
                raise RobotError(f"{self.name}: {error}") from None

    def _check_gears(self, dof: int) -> None:
        ratio = self.gear_ratio
        if ratio.size and ratio.shape != (dof,):
            raise RobotError(f"{self.name}: gear_ratio must be {dof} numbers, one for each joint; got {ratio}")
        if len(wrong := np.flatnonzero(~((ratio > 0.0) & np.isfinite(ratio)))):
            raise RobotError(
                f"{self.name}: joint {wrong[0] + 1}: gear_ratio is {ratio[wrong[0]]:g}; expected the motor turns "
                "for one turn of the joint, above 0; leave gear_ratio out if the gears are not known"
            )

    def __repr__(self) -> str:
        plate = f": {self.maker} {self.model}".rstrip(": ")
        return f"<{type(self).__name__} {self.name}{plate}, {self.dof} joint{'s' * (self.dof > 1)}, {self.convention}>"

    def __str__(self) -> str:
        """Return the title and one line of parameters and limits [mm], [deg] for each joint."""
        columns = (self.alpha, self.offset, self.beta, *self.limits.T)
        alpha, offset, beta, lower, upper = (np.rad2deg(column) + 0.0 for column in columns)
        head = "joint  alpha deg      a mm      d mm  offset deg  beta deg  sign          limits deg"
        rows = [
            f"{j + 1:5d}{alpha[j]:11.3f}{self.a[j]:10.3f}{self.d[j]:10.3f}{offset[j]:12.3f}{beta[j]:10.3f}"
            f"{self.sign[j]:6.0f}{lower[j]:10.6g}{upper[j]:10.6g}"
            for j in range(self.dof)
        ]
        coupled = ", ".join(f"J{joint} + {factor:g} J{other}" for joint, other, factor in self.coupling or ())
        return "\n".join([repr(self), head, *rows, *([f"coupling: {coupled}, J as shown"] if coupled else [])])

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.alpha)

    @property
    def world_height_mm(self) -> float | None:
        """The height of the base above the mounting face as the data sheet states it; None if it does not."""
        return None if self.data_sheet is None else self.data_sheet.world_height_mm

    @cached_property
    def link_before(self) -> FloatArray:
        """The part of each A_i before its rotation by theta_i: (dof, 4, 4) [mm]."""
        if self.convention == "dh":
            return np.tile(np.eye(4), (self.dof, 1, 1))
        return axis_rotation(0, self.alpha) @ axis_translation(0, self.a)

    @cached_property
    def link_after(self) -> FloatArray:
        """The part of each A_i after its rotation by theta_i: (dof, 4, 4) [mm]."""
        if self.convention == "dh":
            return axis_translation(2, self.d) @ axis_translation(0, self.a) @ axis_rotation(0, self.alpha)
        return axis_translation(2, self.d) @ axis_rotation(1, self.beta)

    @cached_property
    def fixed(self) -> FloatArray:
        """The fixed transforms, (dof + 1, 4, 4) [mm]: T = fixed_0 Rz(theta_1) fixed_1 … Rz(theta_n) fixed_n."""
        before = np.concatenate([self.link_before, self.tf_last_flange[None]])
        after = np.concatenate([self.tf_base_first[None], self.link_after])
        return np.asarray(after @ before)

    def links(self, tool: FloatArray) -> FloatArray:
        """Return L of T = L_0 Rz(sign_1 q_1) L_1 … L_n, offsets and a tool (4, 4) included: (dof + 1, 4, 4) [mm]."""
        links = self.fixed.copy()
        links[1:] = axis_rotation(2, self.offset) @ links[1:]
        links[-1] = links[-1] @ tool
        return links

    @cached_property
    def link_points(self) -> FloatArray:
        """The origin of each frame of `frames` after the joint, before the offset has turned it: (dof, 3) [mm]."""
        return np.asarray((axis_rotation(2, self.offset) @ self.link_after)[:, :3, 3])

    def theta(self, q: FloatArray) -> FloatArray:
        """Return the angles of theory (1), sign · q + offset: (…, dof) [rad]."""
        return self.sign * q + self.offset

    def forward(self, q: ArrayLike, tool: ArrayLike | None = None) -> FloatArray:
        """Return the pose of the flange, or of the TCP, in the robot base frame, theory (2).

        Parameters
        ----------
        q : (dof,) or (n, dof) array [rad]
            Joint vectors, in the robot's own order and sign; more leading axes are kept.
        tool : (4, 4) array or (3,) array [mm], optional
            tf_flange_tool, or the TCP's position in the flange frame.

        Returns
        -------
        (4, 4) or (n, 4, 4) array [mm], base frame

        Raises
        ------
        DataError
            If the shape is wrong, joints are NaN, or look like degrees.
        """
        joints = self.check_joints(q)
        fixed = self.fixed.copy()
        fixed[-1] = fixed[-1] @ tool_transform(tool)
        return end_poses(self.theta(joints.reshape(-1, self.dof)), fixed).reshape(*joints.shape[:-1], 4, 4)

    def frames(self, q: ArrayLike) -> FloatArray:
        """Return the cumulative transforms tf_base_first A_1 … A_i in the robot's own convention.

        With "mdh" they hold the axes of an error Jacobian, theory (3): the x axis of frame i-1 (a, alpha), the z axis
        of frame i turned back by beta (theta, d), the y axis of frame i (beta).

        Parameters
        ----------
        q : (dof,) or (n, dof) array [rad]

        Returns
        -------
        (dof + 1, 4, 4) or (n, dof + 1, 4, 4) array [mm], base frame
            Frame 0 is tf_base_first; the flange is `frames[..., -1] @ tf_last_flange`.

        Raises
        ------
        DataError
            As `forward`.
        """
        joints = self.check_joints(q)
        theta = self.theta(joints.reshape(-1, self.dof))
        tf = np.zeros((len(theta), self.dof + 1, 4, 4))
        tf[..., 3, 3] = 1.0
        tf[:, 0] = self.tf_base_first
        for start in range(0, len(theta), _CHUNK):
            part = tf[start : start + _CHUNK]
            steps = walk(theta[start : start + _CHUNK], self.fixed)
            for i, (after, (axes, p)) in enumerate(zip(self.link_after, steps, strict=False), start=1):
                axes, p = _moved(axes, p, after)
                part[:, i, :3, :3] = axes.transpose(2, 1, 0)
                part[:, i, :3, 3] = p.T
        return tf.reshape(*joints.shape[:-1], self.dof + 1, 4, 4)

    def within_limits(self, q: ArrayLike) -> BoolArray:
        """Return whether each joint lies within its limits: bool, shape of `q`; False where `q` is NaN."""
        joints = as_floats("joints", q)
        lower, upper = self.limits.T
        return np.asarray((joints >= lower - _LIMIT_ROUNDING) & (joints <= upper + _LIMIT_ROUNDING))

    def check_limits(self, q: ArrayLike) -> None:
        """Raise `RobotError` if joints are beyond their limits; the message names rows, joints and limits [deg].

        Parameters
        ----------
        q : (dof,) or (n, dof) array [rad]

        Raises
        ------
        RobotError
            If a joint is beyond its limits.
        DataError
            If the shape is wrong, joints are NaN, or look like degrees.
        """
        joints = np.atleast_2d(self.check_joints(q))
        beyond = np.argwhere(~self.within_limits(joints))
        if len(beyond):
            listed = "; ".join(
                f"row {row} joint {j + 1} at {np.rad2deg(joints[row, j]):.3f} deg, limits "
                f"{np.rad2deg(self.limits[j, 0]):.6g} to {np.rad2deg(self.limits[j, 1]):.6g}"
                for row, j in beyond[:3]
            )
            more = f" and {len(beyond) - 3} more" if len(beyond) > 3 else ""
            raise RobotError(
                f"{self.name}: joints beyond their limits: {listed}{more}; check joint order, sign and unit"
            )

    def check_joints(self, q: ArrayLike) -> FloatArray:
        """Return `q` as a float array (…, dof); raise `DataError` for another shape, NaN, or values in degrees."""
        joints = as_floats("joints", q)
        if joints.ndim < 1 or joints.shape[-1] != self.dof:
            raise DataError(f"expected joints of shape (n, {self.dof}) for {self.name}, got {joints.shape}")
        if not joints.size:
            raise DataError("joints are empty, expected at least one joint vector")
        rows = joints.reshape(-1, self.dof)
        check_finite("joints", rows)
        if np.abs(rows).max() > 4 * np.pi:
            far = (np.abs(rows) > 4 * np.pi) & np.isfinite(self.limits).all(axis=1)
            if far.any():
                where = name_rows(np.flatnonzero(far.any(axis=1)))
                value = rows[far][0]
                raise DataError(f"joints reach {value:.6g} rad in {where}: looks like degrees; convert with np.deg2rad")
        return joints


def walk(theta: FloatArray, fixed: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Walk along the chain fixed_0 Rz(theta_1) fixed_1 … Rz(theta_n) fixed_n for all poses at once.

    Parameters
    ----------
    theta : (n, dof) array [rad]
    fixed : (dof + 1, 4, 4) array [mm]

    Yields
    ------
    axes : (3, 3, n) array
        The columns x, y, z of the rotation (first axis), after each joint's rotation and finally after fixed_n.
    p : (3, n) array [mm]
    """
    n = len(theta)
    cos, sin = _cos_sin(np.ascontiguousarray(theta.T))
    axes = np.broadcast_to(fixed[0, :3, :3].T[..., None], (3, 3, n))
    p = np.broadcast_to(fixed[0, :3, 3, None], (3, n))
    for c, s, link in zip(cos, sin, fixed[1:], strict=True):
        turned = np.empty((3, 3, n))
        np.add(c * axes[0], s * axes[1], out=turned[0])
        np.subtract(c * axes[1], s * axes[0], out=turned[1])
        turned[2] = axes[2]
        yield turned, p
        axes, p = _moved(turned, p, link)
    yield axes, p


def end_poses(theta: FloatArray, fixed: FloatArray) -> FloatArray:
    """Return the last frame: (n, 4, 4) [mm], base frame."""
    tf = np.zeros((len(theta), 4, 4))
    tf[:, 3, 3] = 1.0
    for start in range(0, len(theta), _CHUNK):
        part = tf[start : start + _CHUNK]
        *_, (axes, p) = walk(theta[start : start + _CHUNK], fixed)
        part[:, :3, :3], part[:, :3, 3] = axes.transpose(2, 1, 0), p.T
    return tf


def _cos_sin(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine from the tangent of half the angle: one vectorised function instead of two.

    Both are exact to 3e-16. At pi the tangent is 1.6e16; the formulas neither overflow nor cancel there.
    """
    tangent = np.tan(0.5 * angle)
    square = tangent * tangent
    scale = 1.0 / (1.0 + square)
    return (1.0 - square) * scale, 2.0 * tangent * scale


def _moved(axes: FloatArray, p: FloatArray, link: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Append one fixed transform (4, 4) to axes (3, 3, n) and origins (3, n), in one product."""
    n = p.shape[1]
    moved = link[:3].T @ axes.reshape(3, 3 * n)
    return moved[:3].reshape(3, 3, n), p + moved[3].reshape(3, n)


def tool_transform(tool: ArrayLike | None) -> FloatArray:
    """Return tf_flange_tool (4, 4) [mm] from a transform, a position (3,) in the flange frame, or None (identity)."""
    if tool is None:
        return np.eye(4)
    array = as_floats("tool", tool)
    if array.shape == (3,):
        check_finite("tool", array[None])
        return make_transform(translation=array)
    if array.shape != (4, 4):
        raise DataError(f"expected tool of shape (4, 4), or (3,) for a position in the flange frame, got {array.shape}")
    return check_transforms("tool", array)
