"""The arrays of a frozen map in its file: names, shapes, and the checks before the compiled loops trust them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray
from truepose.geometry import check_transforms
from truepose.numerics.frozen import UNROLLED, Constants
from truepose.numerics.frozen_deviation import Deviation

Arrays = dict[str, NDArray[Any]]


def to_arrays(constants: Constants, deviation: Deviation | None) -> Arrays:
    """Return the arrays of a file by name; the longest axis comes first, because only that is unlimited there."""
    arrays: Arrays = {f"constants.{name}": array for name, array in constants._asdict().items()}
    arrays["constants.links"] = constants.links.reshape(-1, 3, 4)
    arrays["constants.tables"] = constants.tables.T
    if deviation is not None:
        arrays |= {f"deviation.{name}": array for name, array in deviation._asdict().items()}
        arrays["deviation.tables"] = np.swapaxes(deviation.tables, 0, 1)
        arrays["deviation.rest"] = np.swapaxes(deviation.rest, 0, 1)
    return arrays


def from_arrays(arrays: Arrays) -> tuple[Constants, Deviation | None]:
    """Return the parts in the arrays of a file, and remove them from `arrays`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If an array is missing, of another type, shape or value than `to_arrays` writes.
    """
    given = _floats(arrays, "constants", Constants._fields)
    if given["links"].ndim != 3:
        raise ValueError(f"links has shape {given['links'].shape}, expected (2 dof + 2, 3, 4)")
    given["links"] = given["links"].reshape(2, -1, 3, 4)
    given["tables"] = np.ascontiguousarray(given["tables"].T)
    constants = Constants(**given)
    _check(constants)
    if not any(name.startswith("deviation.") for name in arrays):
        return constants, None
    arrays.setdefault("deviation.waves", np.zeros((0, 2, arrays["deviation.drift"].shape[-1])))  # not in older files
    given = _floats(arrays, "deviation", Deviation._fields)
    for name in ("tables", "rest"):
        given[name] = np.ascontiguousarray(np.swapaxes(given[name], 0, 1))
    deviation = Deviation(**given)
    _check_deviation(constants, deviation)
    return constants, deviation


def _floats(arrays: Arrays, part: str, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return some arrays of floating-point numbers, removed from `arrays`."""
    found = {name: arrays.pop(f"{part}.{name}") for name in names}
    if wrong := [name for name, array in found.items() if array.dtype != np.float64]:
        raise TypeError(f"{wrong[0]} is not an array of floating-point numbers")
    return found


def _check(constants: Constants) -> None:
    """Require the shapes and values with which the compiled loop stays within its arrays; ValueError otherwise."""
    dof, places = len(constants.sign), len(constants.place_scale)
    blocks, width = len(constants.anchors), constants.anchors.shape[-1]
    shapes = {
        "links": (2, dof + 1, 3, 4),
        "sign": (dof,),
        "limits": (dof, 2),
        "twist": (dof + 1, 6),
        "tables": (dof, constants.tables.shape[-1]),
        "harmonics": (len(constants.harmonics), 4),
        "moment": (dof, dof + 1),
        "mass": (dof + 1, 3),
        "anchors": (blocks, places + 1, width),
        "weights": (blocks, 3, width),
        "place_scale": (places,),
        "by_joints": (1,),
        "away": (3,),
        "linear": (1,),
    }
    _require_shapes(constants._asdict(), shapes)
    for links in constants.links:
        check_transforms("links", np.concatenate([links, np.tile([0.0, 0.0, 0.0, 1.0], (dof + 1, 1, 1))], axis=1))
    joint, by_joints = constants.harmonics[:, 0], float(constants.by_joints[0])
    fits = {
        "sign": dof > 0 and bool(np.isin(constants.sign, (-1.0, 1.0)).all()),
        "limits": bool((constants.limits[:, 0] < constants.limits[:, 1]).all()),
        "tables": constants.tables.shape[1] != 1,
        "harmonics": bool(np.isin(joint, np.arange(dof)).all()),
        "place_scale": places % UNROLLED == 0,
        "by_joints": by_joints in (0.0, 2.0 * dof) and by_joints <= max(places, 0),
        "linear": bool(constants.linear[0] in (0.0, 1.0)),
    }
    if wrong := [name for name, right in fits.items() if not right]:
        raise ValueError(f"{wrong[0]} has impossible values")


def _check_deviation(constants: Constants, deviation: Deviation) -> None:
    """Require shapes that agree with the constants, and variances that are none below zero; ValueError otherwise."""
    dof, kept, rows = len(constants.sign), deviation.drift.shape[-1], 6 * len(constants.twist)
    shapes = {
        "drift": (rows, kept),
        "gravity": (dof, dof + 1, kept),
        "tables": (dof, deviation.tables.shape[1], kept),
        "rest": (3, constants.anchors.shape[0] * constants.anchors.shape[2], kept),
        "prior_drift": (rows, rows),
        "prior_gravity": (dof, dof + 1),
        "prior_joint": (dof,),
        "prior_rest": (1,),
        "inflation": (1,),
        "added": (3,),
        "margin": (1,),
        "waves": (len(constants.harmonics), 2, kept),
    }
    _require_shapes(deviation._asdict(), shapes)
    if constants.linear[0] != 1.0 or deviation.tables.shape[1] < 4:
        raise ValueError("deviation has tables that are too short, or belongs to another kind of map")
    for name in ("prior_gravity", "prior_joint", "prior_rest", "inflation", "added", "margin"):
        if (getattr(deviation, name) < 0.0).any():
            raise ValueError(f"{name} has impossible values")


def _require_shapes(arrays: dict[str, FloatArray], shapes: dict[str, tuple[int, ...]]) -> None:
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name} has shape {arrays[name].shape}, expected {shape}")
