"""The tools and bases that a controller stores, joined with those that the user gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.programs.backups.controller import StoredFrame, StoredFrames
from truepose.programs.core.program import Key, frame_key
from truepose.programs.frame_table import FrameTable

_SAME_MM: Final = 1e-3
_SAME_RAD: Final = float(np.deg2rad(1e-3))
_KINDS: Final = {"tool": "tools", "base": "bases"}


def joined_frames(given: FrameTable, stored: StoredFrames, where: str) -> FrameTable:
    """Return the frames of the user and those that a controller stores, relative to the robot's base.

    `FrameTable.problems` says why some cannot be used: the controller itself gives a reason, the user states another
    value, or the controller stores zeros without a name, which is how it stores a frame that is not set.

    Parameters
    ----------
    given : FrameTable
        The frames of the user: of the cell file, or of a ``$config.dat``.
    stored : StoredFrames
        The frames of the controller.
    where : str
        The controller, for messages.

    Raises
    ------
    DataError
        If the user's place of the robot in the controller's world is another one.
    """
    table = given if stored.tf_world_base is None else given.standing_at(stored.tf_world_base, where)
    problems, held = dict(table.problems), dict(table.of_held_parts)
    found: dict[str, dict[Key, FloatArray]] = {"tool": {}, "base": {}}
    for which, kind in _KINDS.items():
        own: Mapping[Key, FloatArray] = getattr(table, kind)
        frames: Mapping[Key, StoredFrame] = getattr(stored, kind)
        for key, frame in ((frame_key(key), frame) for key, frame in frames.items()):
            tf = table.bases[0] @ frame.tf if which == "base" and stored.in_world else frame.tf
            if frame.of_held_part is not None:
                held[which, key] = frame.of_held_part
            if why := _problem(frame, tf, own.get(key), f"[frames.{kind}.{key}]"):
                problems[which, key] = why
            else:
                found[which][key] = tf
    tools, bases = ({**getattr(table, kind), **found[which]} for which, kind in _KINDS.items())
    return replace(table, tools=tools, bases=bases, problems=problems, of_held_parts=held)


def is_zero(tf: FloatArray) -> bool:
    """Return whether a transform is the identity, as frames that are not set are stored."""
    return same_frame(tf, np.eye(4))


def same_frame(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two transforms are equal to a micrometre and a thousandth of a degree."""
    turned = float(Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude())
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) <= _SAME_MM and turned <= _SAME_RAD)


def _problem(frame: StoredFrame, tf: FloatArray, own: FloatArray | None, key: str) -> str:
    """Return why a stored frame cannot be used, or "" if it can; `own` is what the user states."""
    place = f" ({frame.place})" if frame.place else ""
    if frame.problem:
        return f"cannot be used{place}: {frame.problem}"
    if own is None:
        if is_zero(frame.tf) and not frame.name.strip():
            return (
                f"is stored as zeros and without a name{place}, as controllers store what is not set; if it is meant, "
                f"give it in {key} of the cell file (two lines: {key} and x_mm = 0.0)"
            )
        return ""
    if same_frame(tf, own):
        return ""
    return (
        f"contradicts the backup: {key} of the cell file is at {_shown(own)}, the controller's{place} at {_shown(tf)}, "
        f"or turned; correct {key}, or leave it out"
    )


def _shown(tf: FloatArray) -> str:
    return "(" + ", ".join(f"{x:g}" for x in tf[:3, 3].round(3) + 0.0) + ") mm"
