"""Parametric shells of an arm: tapered links and joint drums, sized by the lengths of the chain.

Every part belongs to one body: body 0 is the base, body i turns with joint i. A picture needs only the fixed
transforms between the joints to move the parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.robots import Robot
from truepose.robots.chain import tool_transform
from truepose.robots.inverse.newton import smallest_singular

PartKind = Literal["foot", "drum", "link", "tool"]
_SLENDEST, _TAPER = 0.022, 0.05  # radius of the last link, and growth towards the base; shares of the arm's length
_DRUM, _HALF_DRUM, _FOOT = 1.2, 1.1, 1.7  # radii and half length of drum and foot; multiples of the link's radius
_TOOL: Final = 0.4
_SHORTEST: Final = 1e-3  # of the arm's length: shorter links are not drawn
_TRIES: Final = 400
_WIDEST: Final = 2.0  # rad from the middle, of a resting pose


@dataclass(frozen=True)
class Part:
    """A truncated cone of an arm's picture.

    Attributes
    ----------
    body : int
        The body that it belongs to; 0 is the base.
    kind : str
        What it stands for.
    start, end : (3,) array [mm]
        The ends of its axis, in the frame of the body.
    radii : pair of float [mm]
        The radii at both ends.
    """

    body: int
    kind: PartKind
    start: FloatArray
    end: FloatArray
    radii: tuple[float, float]


def body_transforms(robot: Robot, tf_flange_tool: FloatArray | None = None) -> FloatArray:
    """Return L of T = L_0 Rz(sign_1 q_1) L_1 … L_n with the tool, (dof + 1, 4, 4) [mm]."""
    return robot.links(tool_transform(tf_flange_tool))


def shells(robot: Robot, tf_flange_tool: FloatArray | None = None) -> list[Part]:
    """Return the parts of an arm's picture.

    A link goes along the axis of its joint and then across to the next joint, as the lengths d and a do.

    Parameters
    ----------
    robot : Robot
        The arm.
    tf_flange_tool : (4, 4) array [mm], optional
        The tool, drawn as a thin link from the flange to its point.
    """
    links = body_transforms(robot)
    ways = [_way(link[:3, 3]) for link in links]
    lengths = [float(sum(np.linalg.norm(np.diff(way, axis=0), axis=1))) for way in ways]
    whole = sum(lengths) or 1.0
    ahead = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
    radius = whole * (_SLENDEST + _TAPER * ahead / whole)
    parts = [_foot(float(radius[0]))]
    for body, way in enumerate(ways):
        if body:
            parts.append(_drum(body, float(radius[body])))
        parts += _links(body, way, (float(radius[body]), float(radius[body + 1])), _SHORTEST * whole)
    if tf_flange_tool is not None:
        flange = links[-1]
        end = (flange @ tf_flange_tool)[:3, 3]
        if np.linalg.norm(end - flange[:3, 3]) > _SHORTEST * whole:
            thin = _TOOL * float(radius[-1])
            parts.append(Part(robot.dof, "tool", flange[:3, 3], end, (thin, thin / 2)))
    return parts


def _way(p: FloatArray) -> FloatArray:
    """Return the corners of a link: the joint, the foot of the next joint on its axis, the next joint."""
    return np.array([[0.0, 0.0, 0.0], [0.0, 0.0, p[2]], p])


def _links(body: int, way: FloatArray, radii: tuple[float, float], shortest: float) -> list[Part]:
    """Return the parts of one body's way, tapered over its whole length."""
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    at = np.interp(np.append(0.0, np.cumsum(steps)), [0.0, max(float(steps.sum()), shortest)], radii)
    return [
        Part(body, "link", way[k], way[k + 1], (float(at[k]), float(at[k + 1])))
        for k in range(len(steps))
        if steps[k] > shortest
    ]


def _foot(radius: float) -> Part:
    return Part(0, "foot", np.zeros(3), np.array([0.0, 0.0, 0.5 * radius]), (_FOOT * radius, _DRUM * radius))


def _drum(body: int, radius: float) -> Part:
    """Return the drum of a joint; that of the first stands on the foot."""
    half = np.array([0.0, 0.0, _HALF_DRUM * radius])
    start = 0.0 * half if body == 1 else -half
    return Part(body, "drum", start, half, (_DRUM * radius, _DRUM * radius))


def resting_pose(robot: Robot) -> FloatArray:
    """Return joints of an arm at rest, (dof,) [rad]: bent, above its base, in front of it, far from singularities.

    The best of some configurations drawn within the limits; always the same one.
    """
    low, high = np.clip(robot.limits.T, -_WIDEST, _WIDEST)
    q = np.random.default_rng(0).uniform(low, np.maximum(high, low), (_TRIES, robot.dof))
    q[:, 0] = np.clip(0.0, low[0], high[0])
    frames = robot.frames(q)[..., :3, 3]
    ends = robot.forward(q)[:, :3, 3]
    size = float(np.abs(frames).max()) or 1.0
    score = np.zeros(_TRIES) if robot.dof < 6 else smallest_singular(robot, q)
    below = np.minimum(frames[:, 2:, 2].min(axis=1, initial=0.0), ends[:, 2]) < 0.0
    return np.asarray(q[int(np.argmax(score - below + 0.3 * ends[:, 0] / size))])
