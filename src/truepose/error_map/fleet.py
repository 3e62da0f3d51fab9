"""The maps of other robots of a type as a prior for the next one: checks, and what a fit takes from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from truepose.error_map.map import ErrorMap
from truepose.errors import DataError
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kinematic.fleet import Fleet
from truepose.robots import Robot
from truepose.samples import Samples

_SAME: Final = 1e-6  # mm, rad
_REMEDY: Final = "leave it out of the maps of the fleet"


def fleet_of(maps: Sequence[ErrorMap], robot: Robot, samples: Samples, convention: str = "hayati") -> Fleet:
    """Return what maps of other robots of a type say of the next one.

    Parameters
    ----------
    maps : sequence of ErrorMap
        Their maps, fitted with kinematic Kriging.
    robot : Robot
        The nominal robot of the next one.
    samples : Samples
        Its samples.
    convention : str
        The convention of its geometry.

    Raises
    ------
    DataError
        If there is no map, or one is of another type of robot, has another predictor or convention, was made of these
        samples, or stands twice; the message names it.
    """
    if not maps:
        raise DataError("a fleet needs the map of at least one other robot")
    names = [_name(one, k) for k, one in enumerate(maps)]
    for k, (one, name) in enumerate(zip(maps, names, strict=True)):
        _check(one, name, robot, convention)
        if _same_readings(one.samples, samples):
            raise DataError(f"{name}: this map was made of the samples that are to be fitted; {_REMEDY}")
        for other, earlier in zip(maps[:k], names[:k], strict=True):
            if _same_readings(one.samples, other.samples):
                raise DataError(f"{name}: a map of the same samples as {earlier}; {_REMEDY}")
    members = [_predictor(one).member(name, _hash(one)) for one, name in zip(maps, names, strict=True)]
    return Fleet.of(members)


def _predictor(error_map: ErrorMap) -> KinematicKriging:
    assert isinstance(error_map.predictor, KinematicKriging)
    return error_map.predictor


def _name(error_map: ErrorMap, k: int) -> str:
    return f"map {k + 1}" if error_map.stored is None else error_map.stored.path.name


def _hash(error_map: ErrorMap) -> str:
    return "" if error_map.stored is None else error_map.stored.sha256


def _check(error_map: ErrorMap, name: str, robot: Robot, convention: str) -> None:
    """Refuse a map whose parameters are not those of the robot."""
    if not _same_arm(error_map.robot, robot):
        raise DataError(f"{name}: a map of {error_map.robot.name}, not of a {robot.name}; {_REMEDY}")
    model = error_map.predictor
    if not isinstance(model, KinematicKriging):
        raise DataError(
            f"{name}: its predictor is {error_map.predictor_name}, and only kinematic Kriging says what robots of a "
            f"type have in common; fit it with --predictor kinematic-kriging, or {_REMEDY}"
        )
    if model.convention != convention:
        raise DataError(
            f"{name}: its geometry has the convention {model.convention!r}, expected {convention!r}; fit it again with "
            f"kinematic-kriging:convention={convention}, or {_REMEDY}"
        )


def _same_arm(one: Robot, other: Robot) -> bool:
    """Return whether two robots have the same nominal links, signs and axes; names and limits may differ."""
    if one.dof != other.dof or not np.array_equal(one.sign, other.sign):
        return False
    flange = np.eye(4)
    return bool(np.abs(one.links(flange) - other.links(flange)).max() < _SAME)


def _same_readings(one: Samples, other: Samples) -> bool:
    """Return whether most readings of the smaller set are in the other one."""
    few, many = sorted((one.p_meas, other.p_meas), key=len)
    known = set(map(bytes, np.ascontiguousarray(many)))
    return sum(bytes(row) in known for row in np.ascontiguousarray(few)) > len(few) / 2
