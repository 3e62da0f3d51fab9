"""Collisions of the arm with boxes, and the tracker's line of sight to the reflector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray, FloatArray
from truepose.robots import Robot

_ALONG: Final = np.linspace(0.0, 1.0, 9)  # points that stand for a link
_WAY: Final = 24  # configurations that stand for a motion
_CHUNK: Final = 20_000


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """Boxes, a tracker, and an arm whose links are rods.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array [mm]
        The transform from flange to reflector.
    boxes : mapping of str to (2, 3) array [mm], base frame
        The lowest and the highest corner of each box, by name.
    link_radius : float [mm]
        The radius of the rods.
    p_tracker : (3,) array [mm], base frame, optional
        The position of the tracker; without it the line of sight is not checked.
    reflector_axis : (3,) array, optional
        The direction in which the reflector faces, tool frame; without it a reflector is seen from all sides.
    acceptance : float [rad]
        The largest angle between the beam and this axis.
    """

    robot: Robot
    tf_flange_tool: FloatArray
    boxes: Mapping[str, FloatArray] = field(default_factory=dict)
    link_radius: float = 150.0
    p_tracker: FloatArray | None = None
    reflector_axis: FloatArray | None = None
    acceptance: float = np.deg2rad(30.0)

    def touched(self, q: FloatArray) -> NDArray[np.str_]:
        """Return the name of a box that the arm touches at joints (n, dof) [rad], "" where there is none: (n,)."""
        name = np.full(len(q), "", dtype=f"<U{max(map(len, self.boxes), default=1)}")
        if not self.boxes:
            return name
        for start in range(0, len(q), _CHUNK):
            part = slice(start, start + _CHUNK)
            p, radius = self._rods(q[part])
            for box, (low, high) in self.boxes.items():
                gap = np.maximum(np.maximum(low - p, p - high), 0.0)
                name[part][(np.linalg.norm(gap, axis=2) <= radius).any(axis=1)] = box
        return name

    def way_touches(self, q_from: FloatArray, q_to: FloatArray) -> NDArray[np.str_]:
        """Return the name of a box that straight joint motions touch, from (n, dof) to (n, dof) [rad]: (n,)."""
        if not self.boxes:
            return np.full(len(q_to), "")
        share = np.linspace(0.0, 1.0, _WAY)[:, None]
        way = q_from[:, None] + share * (q_to - q_from)[:, None]
        names = self.touched(way.reshape(-1, way.shape[2])).reshape(-1, _WAY)
        return np.asarray(names[np.arange(len(names)), np.argmax(names != "", axis=1)])

    def sees(self, q: FloatArray) -> BoolArray:
        """Return whether the tracker sees the reflector at joints (n, dof) [rad]: (n,)."""
        if self.p_tracker is None:
            return np.ones(len(q), np.bool_)
        tf = self.robot.forward(q, tool=self.tf_flange_tool)
        beam = self.p_tracker - tf[:, :3, 3]
        length = np.linalg.norm(beam, axis=1)
        beam /= length[:, None]
        seen = np.ones(len(q), np.bool_)
        if self.reflector_axis is not None:
            axis = self.reflector_axis / np.linalg.norm(self.reflector_axis)
            seen &= np.einsum("nij,j,ni->n", tf[:, :3, :3], axis, beam) > np.cos(self.acceptance)
        p, radius = self._rods(q)
        away = p - tf[:, None, :3, 3]
        along = np.clip(np.einsum("nki,ni->nk", away, beam), 0.0, length[:, None])
        gap = np.linalg.norm(away - along[..., None] * beam[:, None], axis=2)
        near = np.linalg.norm(away, axis=2) <= 2.0 * self.link_radius  # the reflector's own mount does not hide it
        hidden: BoolArray = ((gap < radius) & ~near).any(axis=1)
        for low, high in self.boxes.values():
            hidden |= _crossed(tf[:, :3, 3], beam, length, low, high)
        return np.asarray(seen & ~hidden)

    def _rods(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points along the links from joint 2 to the tool point, (n, k, 3) [mm], and the radius at each (k,)."""
        frames = self.robot.frames(q)[:, 2:, :3, 3]
        tip = self.robot.forward(q, tool=self.tf_flange_tool)[:, None, :3, 3]
        knots = np.concatenate([frames, tip], axis=1)
        p = knots[:, :-1, None] + _ALONG[:, None] * (knots[:, 1:] - knots[:, :-1])[:, :, None]
        tool = len(_ALONG)  # a tool is thinner than a link, and its tip is a point
        radius = np.full((p.shape[1], tool), self.link_radius)
        radius[-1] = np.linspace(self.link_radius, 0.0, tool)
        return p.reshape(len(q), -1, 3), radius.ravel()


def _crossed(p: FloatArray, beam: FloatArray, length: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    """Return whether beams from p (n, 3) with directions (n, 3) and lengths (n,) cross a box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.stack([(low - p) / beam, (high - p) / beam])
    enter, leave = np.nanmax(at.min(axis=0), axis=1), np.nanmin(at.max(axis=0), axis=1)
    beside = ((beam == 0.0) & ((p < low) | (p > high))).any(axis=1)
    return np.asarray((enter <= leave) & (leave > 0.0) & (enter < length) & ~beside)
