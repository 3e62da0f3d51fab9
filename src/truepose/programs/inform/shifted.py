"""Motions that SFTON shifts by P variables with constant values."""

from __future__ import annotations

import re
from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.points import Derived, Frame, Place, Problem
from truepose.programs.core.program import KnownFrames
from truepose.programs.inform.controller import Controller, Displacement

_USER: Final = re.compile(r"UF#\((\d+)\)")
_TURNED: Final = 1e-9


def derived_by(
    shift: Displacement, frame: Frame, frames: KnownFrames, controller: Controller, place: Place
) -> Derived | Problem:
    """Return the positions to which a shift moves a position; or the problem, where it is not a constant one.

    Parameters
    ----------
    shift : Displacement
        The shift.
    frame : Frame
        The frame of the position.
    frames : KnownFrames
        The controller's frames.
    controller : Controller
        The knowledge of all jobs.
    place : Place
        The motion.
    """
    values = None if shift.number is None else controller.values(shift.number)
    if values is None:
        return Problem("skip", f"{shift.text} shifts it at run time")
    if any(abs(angle) > _TURNED for pose in values for angle in pose.numbers[3:]):
        return Problem("skip", f"{shift.text} turns it: P{shift.number:03} holds angles")
    axes: Literal["frame", "tool"] = "frame"
    steps = np.array([pose.numbers[:3] for pose in values])
    if shift.along == "TF":
        axes = "tool"
    else:
        turn = _turn(shift.along, values[0].frame, frame, frames, controller)
        if turn is None:
            return Problem("skip", f"{shift.text} shifts it along axes that are not known")
        steps = (steps @ turn.T).round(9)
    shifts = tuple([(x, y, z) for x, y, z in np.unique(steps, axis=0).tolist()])
    return Derived(place, f"shifted by {shift.text}", shifts, axes)


def _turn(along: str, of_variable: str, frame: Frame, frames: KnownFrames, controller: Controller) -> FloatArray | None:
    """Return the rotation from the axes of a shift to those of a frame, (3, 3); None where one is not known."""
    if along in ("BF", "RF") or (not along and of_variable in ("BASE", "ROBOT")):
        own: int | None = 0
    else:
        m = _USER.fullmatch(along)
        own = int(m[1]) if m else None
    if own is None or not isinstance(frame.key, int):
        return None
    if own == frame.key:
        return np.eye(3)
    if own != 0 and {("base", own), ("base", None)} & controller.changed.keys():
        return None
    if own not in frames.bases or frame.key not in frames.bases:
        return None
    turn: FloatArray = frames.bases[frame.key][:3, :3].T @ frames.bases[own][:3, :3]
    return turn
