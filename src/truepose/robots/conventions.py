"""Conventions of kinematic parameters: the motions and nominal values that describe the links of an arm.

Only the line of the next axis determines a link: a turn about it and a shift along it pass through the next joint into
the next link. Each convention factors a link as ``form(parameters) Rz Tz``, and multiplies Rz Tz into the next link.

- "hayati": modified D-H (Craig) with Hayati's beta, theory (1).
- "dh": standard D-H, Rz(theta) Tz(d) Tx(a) Rx(alpha); where the next axis is nearly parallel d is zero and Ry(beta)
  follows (Hayati and Mirmirani 1985), because the common normal would be far away.
- "s-model": Rz(beta) Tz(d) Tx(a) Rx(alpha) Rz(gamma) Tz(b) (Stone and Sanderson 1987); six parameters for each
  link, not continuous at parallel axes.
- "cpc": complete and parametrically continuous (Zhuang, Roth and Hamano 1992): the smallest rotation of z to b, then
  Tx(x) Ty(y). The largest component of b is dependent, the other two are parameters.
- "mcpc": modified CPC (Zhuang, Wang and Roth 1993): Rx(alpha) Ry(beta) Tx(x) Ty(y).
- "poe": product of exponentials in adjoint form (Chen et al. 2014): each axis is displaced by two shifts and two turns
  square to it; four parameters for each joint, no singularity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.geometry.transforms import axis_rotation, invert_transform
from truepose.robots.chain import Chain, tool_transform
from truepose.robots.convert import mdh_of_fixed, to_mdh
from truepose.robots.motions import Kind, Motion, Parameter, tilt, transform

_NEARLY_PARALLEL: Final = 0.05  # sine of the angle between axes: Hayati and Mirmirani (1985)
_PARALLEL: Final = 1e-13
_FARTHEST: Final = 1e7  # mm: rounding of positions exceeds 1e-8 mm if the common normal is farther away
_STEEP: Final = 0.7  # sine of MCPC's beta: its singularity is at 1
_BACKWARD: Final = 0.2  # 1 + b_z of CPC: its singularity is at 0

_BASE: Final = tuple(Parameter(f"base {axis}", "mm", "base") for axis in "xyz") + tuple(
    Parameter(f"base r{axis}", "rad", "base") for axis in "xyz"
)
_TOOL: Final = tuple(Parameter(p.name.replace("base", "tool"), p.unit, "tool") for p in _BASE)


class _Part(NamedTuple):
    """A motion whose parameters have names and values, but no indices yet."""

    kind: Kind
    axis: int
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    factor: float = 1.0
    tf: FloatArray | None = None


class Parametrisation(NamedTuple):
    """A convention's parameters, their nominal values (p,), and the motions of the dof + 1 links."""

    parameters: tuple[Parameter, ...]
    nominal: FloatArray
    links: tuple[tuple[Motion, ...], ...]


def parametrise(robot: Chain, convention: str = "hayati", tool: ArrayLike | None = None) -> Parametrisation:
    """Return a robot's parameters in a convention; "hayati" keeps the numbers of an "mdh" robot."""
    tf_flange_tool = tool_transform(tool)
    if convention == "hayati":
        return _hayati(robot if robot.convention == "mdh" else to_mdh(robot), tf_flange_tool)
    return parametrise_links(robot, robot.links(tf_flange_tool), convention)


def parametrise_links(robot: Chain, links: FloatArray, convention: str) -> Parametrisation:
    """Return the arm L_0 Rz(s_1 q_1) L_1 … L_n, links (dof + 1, 4, 4) [mm], in a convention."""
    if convention not in CONVENTIONS:
        known = ", ".join(CONVENTIONS)
        raise RobotError(f'{robot.name}: unknown convention "{convention}"; expected one of {known}')
    if convention == "hayati":
        return _hayati(mdh_of_fixed(replace(robot, offset=np.zeros(robot.dof)), links), np.eye(4))
    if convention == "poe":
        return _exponentials(robot, links)
    form = _FORMS[convention]
    parts, carry = [[_fixed(links[0])]], np.eye(4)
    for k, link in enumerate(links[1:], start=1):
        wanted = carry @ link
        found = form(wanted, k, robot)
        parts.append(found)
        carry = invert_transform(_product(found)) @ wanted
        carry[:3, :3] = axis_rotation(2, np.arctan2(carry[1, 0], carry[0, 0]))[:3, :3]
        carry[:2, 3] = 0.0
    # the last frame is matched exactly: no link follows that could take up the remainder
    parts[-1].append(_fixed(invert_transform(_product(parts[-1])) @ wanted))
    return _place(convention, parts)


def _place(convention: str, parts: list[list[_Part]], groups: list[str] | None = None) -> Parametrisation:
    """Assign indices to the parameters, in the order of their groups, and add those of base and tool."""
    named: dict[str, float] = {}
    for link in parts:
        for part in link:
            named |= {name: value for name, value in zip(part.names, part.values, strict=True) if name not in named}
    groups = groups or list(dict.fromkeys(name.rstrip("0123456789") for name in named))
    order = sorted(named, key=lambda name: (groups.index(name.rstrip("0123456789")), _number(name)))
    angles = ("theta", "alpha", "beta", "gamma", "rx", "ry")
    parameters = []
    for name in order:
        group = name.rstrip("0123456789")
        direction = convention == "cpc" and group.startswith("b")
        parameters.append(Parameter(name, "1" if direction else "rad" if group in angles else "mm", group))
    place = {name: i for i, name in enumerate(order)}
    links = [[Motion(p.kind, p.axis, tuple(place[n] for n in p.names), p.factor, p.tf) for p in link] for link in parts]
    first = len(order)
    links[0] = _six(first) + links[0]
    links[-1] = links[-1] + _six(first + 6)
    nominal = np.concatenate([[named[name] for name in order], np.zeros(12)])
    nominal.setflags(write=False)
    return Parametrisation((*parameters, *_BASE, *_TOOL), nominal, tuple(map(tuple, links)))


def _six(first: int) -> list[Motion]:
    shifts = [Motion("shift", axis, (first + axis,)) for axis in range(3)]
    return shifts + [Motion("turn", axis, (first + 3 + axis,)) for axis in range(3)]


def _number(name: str) -> int:
    return int(name[len(name.rstrip("0123456789")) :])


def _hayati(robot: Chain, tf_flange_tool: FloatArray) -> Parametrisation:
    parts: list[list[_Part]] = [[_fixed(robot.tf_base_first)]]
    columns = ("theta", "offset"), ("d", "d"), ("a", "a"), ("alpha", "alpha"), ("beta", "beta")
    value = {f"{name}{j + 1}": float(getattr(robot, key)[j]) for name, key in columns for j in range(robot.dof)}
    for j in range(1, robot.dof + 1):
        parts[-1] += [_named("turn", 0, f"alpha{j}", value), _named("shift", 0, f"a{j}", value)]
        parts.append([_named("turn", 2, f"theta{j}", value), _named("shift", 2, f"d{j}", value)])
        parts[-1] += [_named("turn", 1, f"beta{j}", value)]
    parts[-1].append(_fixed(robot.tf_last_flange @ tf_flange_tool))
    return _place("hayati", parts, [name for name, _ in columns])


def _named(kind: Kind, axis: int, name: str, value: dict[str, float]) -> _Part:
    return _Part(kind, axis, (name,), (value[name],))


def _fixed(tf: FloatArray) -> _Part:
    return _Part("fixed", 0, tf=tf)


def _product(parts: list[_Part]) -> FloatArray:
    tf = np.eye(4)
    for part in parts:
        motion = Motion(part.kind, part.axis, tuple(range(len(part.values))), part.factor, part.tf)
        tf = tf @ transform(motion, np.array(part.values))
    return tf


def _standard(tf: FloatArray, k: int, robot: Chain) -> list[_Part]:
    z, p = tf[:3, 2], tf[:3, 3]
    if np.hypot(z[0], z[1]) >= _NEARLY_PARALLEL:
        theta, d, a, alpha = _common_normal(z, p)
        beta: tuple[_Part, ...] = ()
    else:
        origin = p - p[2] / z[2] * z  # where the axis intersects the plane of the joint
        theta, a = _half_turn(origin[0], origin[1])
        d = 0.0
        x, y, up = axis_rotation(2, -theta)[:3, :3] @ z
        alpha, tilted = np.arctan2(-y, up), np.arctan2(x, np.hypot(y, up))
        beta = (_Part("turn", 1, (f"beta{k}",), (float(tilted),)),)
    shift = () if beta else (_Part("shift", 2, (f"d{k}",), (d,)),)
    return [
        _Part("turn", 2, (f"theta{k}",), (theta,)),
        *shift,
        _Part("shift", 0, (f"a{k}",), (a,)),
        _Part("turn", 0, (f"alpha{k}",), (float(alpha),)),
        *beta,
    ]


def _stone(tf: FloatArray, k: int, robot: Chain) -> list[_Part]:
    beta, d, a, alpha = _common_normal(tf[:3, 2], tf[:3, 3])
    if abs(d) > _FARTHEST:
        raise RobotError(
            f"{robot.name}: the S-model cannot describe axes {k} and {k + 1}, parallel to within "
            f"{np.hypot(*tf[:2, 2]):.1g} rad: their common normal is {abs(d):.1e} mm away; "
            'use "hayati", "cpc", "mcpc" or "poe"'
        )
    head = [
        _Part("turn", 2, (f"beta{k}",), (beta,)),
        _Part("shift", 2, (f"d{k}",), (d,)),
        _Part("shift", 0, (f"a{k}",), (a,)),
        _Part("turn", 0, (f"alpha{k}",), (alpha,)),
    ]
    rest = invert_transform(_product(head)) @ tf
    gamma, b = float(np.arctan2(rest[1, 0], rest[0, 0])), float(rest[2, 3])
    return [*head, _Part("turn", 2, (f"gamma{k}",), (gamma,)), _Part("shift", 2, (f"b{k}",), (b,))]


def _continuous(tf: FloatArray, k: int, robot: Chain) -> list[_Part]:
    before: list[_Part] = []
    z, p = tf[:3, 2], tf[:3, 3]
    if 1.0 + z[2] < _BACKWARD:  # reverse the axis, so that b_z >= 0
        half = np.diag([1.0, -1.0, -1.0, 1.0])
        before, z, p = [_fixed(half)], half[:3, :3] @ z, half[:3, :3] @ p
    dependent = int(np.argmax(np.abs(z)))
    free = [i for i in range(3) if i != dependent]
    names = tuple(f"b{'xyz'[i]}{k}" for i in free)
    factor = float(np.sign(z[dependent]))
    x, y, _ = tilt(z)[:3, :3].T @ p
    parts = [*before, _Part("tilt", dependent, names, (float(z[free[0]]), float(z[free[1]])), factor)]
    return [*parts, _Part("shift", 0, (f"x{k}",), (float(x),)), _Part("shift", 1, (f"y{k}",), (float(y),))]


def _modified_continuous(tf: FloatArray, k: int, robot: Chain) -> list[_Part]:
    before: list[_Part] = []
    z, p = tf[:3, 2], tf[:3, 3]
    if abs(z[0]) > _STEEP:  # another zero of the joint keeps beta small
        zero = axis_rotation(2, np.arctan2(z[1], z[0]) + np.pi / 2)
        before, z, p = [_fixed(zero)], zero[:3, :3].T @ z, zero[:3, :3].T @ p
    alpha, beta = float(np.arctan2(-z[1], z[2])), float(np.arctan2(z[0], np.hypot(z[1], z[2])))
    x, y, _ = (axis_rotation(0, alpha) @ axis_rotation(1, beta))[:3, :3].T @ p
    return [
        *before,
        _Part("turn", 0, (f"alpha{k}",), (alpha,)),
        _Part("turn", 1, (f"beta{k}",), (beta,)),
        _Part("shift", 0, (f"x{k}",), (float(x),)),
        _Part("shift", 1, (f"y{k}",), (float(y),)),
    ]


def _exponentials(robot: Chain, links: FloatArray) -> Parametrisation:
    parts = [[_fixed(link)] for link in links]
    motions: tuple[tuple[Kind, int, str], ...] = (
        ("shift", 0, "x"),
        ("shift", 1, "y"),
        ("turn", 0, "rx"),
        ("turn", 1, "ry"),
    )
    for k in range(1, robot.dof + 1):
        parts[k - 1] += [_Part(kind, axis, (f"{name}{k}",), (0.0,)) for kind, axis, name in motions]
        back = [_Part(kind, axis, (f"{name}{k}",), (0.0,), -1.0) for kind, axis, name in reversed(motions)]
        parts[k] = back + parts[k]
    return _place("poe", parts)


def _common_normal(z: FloatArray, p: FloatArray) -> tuple[float, float, float, float]:
    """Return theta, d, a, alpha of Rz Tz Tx Rx to the line through p along z; d = 0 for a parallel line."""
    sine = np.hypot(z[0], z[1])
    if sine < _PARALLEL:
        theta, a = _half_turn(p[0], p[1])
        return theta, 0.0, a, 0.0 if z[2] > 0 else float(np.pi)
    theta, flip = _half_turn(-z[1], z[0])  # z × z' turned into the half circle about x
    side = float(np.sign(flip))
    alpha = float(np.arctan2(side * sine, z[2]))
    along = (p[0] * z[0] + p[1] * z[1]) / sine**2
    foot = p - along * z  # of the common normal on the next axis
    return theta, float(foot[2]), float(foot[0] * np.cos(theta) + foot[1] * np.sin(theta)), alpha


def _half_turn(x: float, y: float) -> tuple[float, float]:
    """Return the angle within ±90 degrees, and the signed length, of a vector; zero for none."""
    length = float(np.hypot(x, y))
    if length == 0.0:
        return 0.0, 0.0
    angle = float(np.arctan2(y, x))
    if abs(angle) > np.pi / 2 + 1e-12:
        return angle - np.copysign(np.pi, angle), -length
    return angle, length


_FORMS: Final[dict[str, Callable[[FloatArray, int, Chain], list[_Part]]]] = {
    "dh": _standard,
    "s-model": _stone,
    "cpc": _continuous,
    "mcpc": _modified_continuous,
}
CONVENTIONS: Final = ("hayati", *_FORMS, "poe")
"""The names of all conventions."""
